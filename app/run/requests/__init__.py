"""What each task is asked to do, as frozen dataclasses made of shared parts; imports no task."""
