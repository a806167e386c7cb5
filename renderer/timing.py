"""The rate that all pictures share."""

FPS = 30
"""Motion frames per second."""
