"""Runs over many clips in parallel processes or on a cluster, and their joint results."""
