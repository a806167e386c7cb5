"""One training from the first step to the last, of anything; may import networks and data."""
