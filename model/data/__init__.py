"""Recordings in BEAT2's layout and their windows for training; may import speech and plans."""
