"""The strength of the speech as forms offer it: a number, or what suits each system."""

from __future__ import annotations

from collections.abc import Sequence

from app import text

USUAL = -1.0
"""As suits each system: no strength is below 0."""


def strength_choices(values: Sequence[float]) -> list[tuple[str, float]]:
    """Labels and values of a field that offers these, and the usual one first."""
    named = ((text.GUIDANCE_NAMES.get(value, f"{value:g}"), value) for value in values)
    return [(text.USUAL_GUIDANCE, USUAL), *named]


def strength_of(chosen: float | None) -> float | None:
    """What a request asks for."""
    return None if chosen in (None, USUAL) else chosen
