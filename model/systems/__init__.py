"""Families of systems, a folder for each, and their registry; may import all below."""
