"""Camera, floor and light around a posed body, without OpenGL; may import `body`."""
