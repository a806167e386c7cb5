"""Baking of the open body from MakeHuman's CC0 data; may import `files` and `body`."""
