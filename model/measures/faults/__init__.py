"""Faults of a motion: one detector each, in the table of ``table.py``; may import its siblings in
measures, but for diagnostics, which asks it.
"""
