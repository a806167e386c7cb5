"""Findings of a run in words, made from its numbers; imports nothing else of `app`."""
