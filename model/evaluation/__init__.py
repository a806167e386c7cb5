"""Evaluation of systems on many clips, with intervals; may import systems and all below."""
