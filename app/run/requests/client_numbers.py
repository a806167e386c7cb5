"""Numbers of a browser's, which may be anything."""

from __future__ import annotations

import math


def finite(value: object) -> float:
    """A number of a client's.

    Raises:
        ValueError: if it is none.
    """
    try:
        if not isinstance(value, bool) and isinstance(value, int | float) and math.isfinite(value):
            return float(value)
    except OverflowError:  # JSON has whole numbers of any length
        raise ValueError("A whole number of hundreds of digits is no number.") from None
    raise ValueError(f"{value!r} is no number.")


def whole(value: object) -> int:
    """A whole number of a client's.

    Raises:
        ValueError: if it is none.
    """
    number = finite(value)
    if number != int(number):
        raise ValueError(f"{number:g} is no whole number.")
    return int(number)
