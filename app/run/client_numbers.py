"""Numbers of a browser's, which may be anything."""

from __future__ import annotations

import math


def finite(value: object) -> float:
    """A number of a client's.

    Raises:
        ValueError: if it is none.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{value!r} is no number.")
    return float(value)


def whole(value: object) -> int:
    """A whole number of a client's.

    Raises:
        ValueError: if it is none.
    """
    number = finite(value)
    if number != int(number):
        raise ValueError(f"{number:g} is no whole number.")
    return int(number)
