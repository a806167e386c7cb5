"""Recordings in BEAT2's layout and their training windows; may import speech and plans."""
