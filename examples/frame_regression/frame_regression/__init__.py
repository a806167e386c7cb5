"""Regression from a second of speech to the pose of a frame, as a family outside the workbench."""
