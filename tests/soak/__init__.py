"""The real server under visitors for long: opt-in, by `make soak`."""
