"""Commands of the command line; may import all of app but the page."""
