"""Faults of a motion, named, each with a sentence made from its numbers."""

from model.measures import Measures


def find_faults(raw: Measures, point: str, window_advance: int) -> list[dict]:
    return []
