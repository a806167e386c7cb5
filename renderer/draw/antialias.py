"""How edges are smoothed, and what drawing asks of a picture's size."""

from typing import Literal

Antialias = Literal["none", "supersample"]
SUPERSAMPLE = 2
"""Samples along each side of a pixel."""


def check_picture_size(width: int, height: int) -> None:
    """
    Raises:
        ValueError: if there is no pixel.
    """
    if width < 1 or height < 1:
        raise ValueError(f"A picture of {width} x {height} pixels cannot be drawn.")
