"""Requests of all tasks, as frozen dataclasses made of shared parts; it imports no task."""
