"""One picture, by OpenGL or by compiled loops; may import `scene` and `body`."""
