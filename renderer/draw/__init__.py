"""Drawing of one picture with pyrender; may import `scene` and `body`."""
