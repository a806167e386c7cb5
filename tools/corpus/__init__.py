"""Procedural corpus in BEAT2's layout of speakers who gesture; may import motion, speech, storage.

Making it needs no torch, so that a worker process starts quickly.
"""
