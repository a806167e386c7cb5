"""Web page of the workbench; may import all of app but the commands."""
