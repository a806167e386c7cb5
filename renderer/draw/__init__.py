"""One picture, drawn by pyrender; may import `scene` and `body`."""
