"""Detectors of faults in motion, listed in ``table.py``; may import `model.metrics`."""
