"""The real server under visitors, by `make soak`."""
