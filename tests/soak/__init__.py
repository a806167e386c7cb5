"""The real server under visitors and attackers: a minute of it always, the rest by `make soak`."""
