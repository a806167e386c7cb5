"""The tab of the systems: how constraints work, steps, and whether they hear."""
