"""Metrics of a motion, with or without a reference; may import `model.generation`."""
