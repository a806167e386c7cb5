"""A procedural corpus in BEAT2's layout: people who talk with their hands; may import motion,
speech and storage. Making it needs no torch, so that a worker process starts quickly.
"""
