"""What would tell participants the systems; may import `make` and `design`."""
