"""One picture, by OpenGL or by compiled loops; may import `stage` and `body`."""
