"""Runs whose turn has come, and the worker that does them; may import visitors."""
