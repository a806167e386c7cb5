"""Folder of results of a run, which is published whole or not at all, and its provenance."""
