"""Faults of a motion: one detector each, in the table of ``table.py``; may import measures."""
