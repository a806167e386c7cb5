"""How fast drawing is, beside a naive way; may import `video`, `draw`, `stage`, `body`."""
