"""How the open body is made from MakeHuman's CC0 data; may import `files` and `body`."""
