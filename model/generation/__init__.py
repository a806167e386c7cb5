"""Interface of systems, and generation of any length from windows; may import `model.training`."""
