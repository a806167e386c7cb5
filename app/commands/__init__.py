"""The command line; may import all of app but the page."""
