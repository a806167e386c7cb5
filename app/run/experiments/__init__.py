"""Runs of their own: does it hear, how steps change it, how a constraint works."""
