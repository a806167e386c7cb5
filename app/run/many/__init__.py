"""Many clips at once, shared out over processes or a cluster, and what is told of all together."""
