"""The families of systems, a folder for each, and who knows them; may import what is below."""
