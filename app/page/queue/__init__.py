"""Whose run is next, and the processes that runs are worked off in; may import visitors."""
