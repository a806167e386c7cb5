"""Procedural corpus in BEAT2's layout, made without torch; may import motion, speech, storage."""
