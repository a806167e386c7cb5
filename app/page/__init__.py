"""The page in a browser; may import all of app but the commands."""
