"""Training loop for any network; may import networks and data."""
