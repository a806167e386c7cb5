"""What a person can do to a plan, as it comes from outside: checked, not yet done."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from app.errors import RunError
from conventions.names import printable

MAX_EDITS = 60
"""At once."""
MAX_LOCKED = 2000
MAX_SECONDS = 3600.0
MAX_PLAN_CHARACTERS = 2_000_000
SIDES = ("left", "right")
HANDS = ("left", "right", "both")
LISTS = ("nods", "looks", "blinks")
SLIDERS = ("gestures_per_min", "size_m", "height_m", "stroke_s", "both", "smile")


@dataclass(frozen=True)
class Edit:
    """One change: what is done, and with which values."""

    do: str
    values: Mapping[str, Any]


Locked = tuple[str, float]
"""A hand, and when its gesture lands."""


def edits_of(told: object) -> tuple[Edit, ...]:
    """
    Args:
        told: a list of objects, as app/page/web/player/editing.js writes it (docs/formats.md).

    Raises:
        RunError: if it is anything else.
    """
    if not isinstance(told, list) or len(told) > MAX_EDITS:
        raise RunError(f"Edits come as a list of at most {MAX_EDITS}.")
    return tuple(_edit(one) for one in told)


def locked_of(told: object) -> tuple[Locked, ...]:
    """Gestures that shall stay; arguments and errors as of `edits_of`."""
    if not isinstance(told, list) or len(told) > MAX_LOCKED:
        raise RunError(f"Locked gestures come as a list of at most {MAX_LOCKED}.")
    try:
        return tuple((_one_of(SIDES)(side), _second(lands)) for side, lands in told)
    except (TypeError, ValueError) as error:
        raise RunError(f"A locked gesture is a hand and a time: {_why(error)}") from error


def _edit(told: object) -> Edit:
    if not isinstance(told, dict):
        raise RunError("An edit is an object that says what to do.")
    do = told.get("do")
    fields = _FIELDS.get(do) if isinstance(do, str) else None
    if not isinstance(do, str) or fields is None:
        known = ", ".join(_FIELDS)
        raise RunError(f"There is no edit {printable(str(do))[:40]!r}; there are {known}.")
    values = {name: value for name, value in told.items() if name != "do"}
    unknown = sorted(set(values) - set(fields), key=str)
    if unknown:
        raise RunError(f"The edit {do!r} has no {printable(str(unknown[0]))[:40]!r}.")
    try:
        found = {name: fields[name](value) for name, value in values.items()}
    except (TypeError, ValueError) as error:
        raise RunError(f"The edit {do!r} cannot be read: {_why(error)}") from error
    missing = [name for name in _NEEDED[do] if name not in found]
    if missing:
        raise RunError(f"The edit {do!r} lacks {missing[0]!r}.")
    if do in ("move", "add") and ("at" in found) == ("word" in found):
        raise RunError(f"The edit {do!r} goes to a time or a word; tell one of them.")
    return Edit(do, found)


def _why(error: Exception) -> str:
    return printable(str(error))[:120]


def _number(least: float, most: float) -> Callable[[object], float]:
    def read(value: object) -> float:
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not least <= value <= most:  # pyright: ignore[reportOperatorIssue]
            raise ValueError(f"{str(value)[:20]} is no number from {least:g} to {most:g}.")
        return float(value)  # pyright: ignore[reportArgumentType]

    return read


def _one_of(valid: tuple[str, ...]) -> Callable[[object], str]:
    def read(value: object) -> str:
        if not isinstance(value, str) or value not in valid:
            raise ValueError(f"{str(value)[:20]!r} is none of {', '.join(valid)}.")
        return value

    return read


def _words(most: int) -> Callable[[object], str]:
    def read(value: object) -> str:
        if not isinstance(value, str) or len(value) > most:
            raise ValueError(f"a text of at most {most} characters is missing.")
        return value

    return read


def _index(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 200_000:
        raise ValueError(f"{str(value)[:20]} is no number of a word.")
    return value


_second = _number(0.0, MAX_SECONDS)
_GESTURE = {"side": _one_of(SIDES), "lands": _second}
_FIELDS: dict[str, dict[str, Callable[[object], Any]]] = {
    "move": {**_GESTURE, "at": _second, "word": _index},
    "delete": _GESTURE,
    "add": {"kind": _words(40), "at": _second, "word": _index, "hands": _one_of(HANDS)},
    "hands": {**_GESTURE, "hands": _one_of(HANDS)},
    "hold": {**_GESTURE, "hold": _number(0.0, 60.0)},
    "end": {"side": _one_of(SIDES), "ends": _second, "at": _second},
    "size": {**_GESTURE, "size": _number(0.1, 4.0)},
    "height": {**_GESTURE, "by": _number(-1.0, 1.0)},
    "speed": {**_GESTURE, "speed": _number(0.2, 5.0)},
    "nod": {"at": _second, "depth": _number(1.0, 30.0)},
    "blink": {"at": _second},
    "look": {
        "at": _second,
        "lasts": _number(0.2, 60.0),
        "yaw": _number(-60, 60),
        "pitch": _number(-40, 40),
    },
    "remove": {"list": _one_of(LISTS), "at": _second},
    "style": {**dict.fromkeys(SLIDERS, _number(-1000, 1000)), "excite": _number(-1.0, 1.0)},
    "plan": {"name": _words(200), "text": _words(MAX_PLAN_CHARACTERS)},
}
_NEEDED: dict[str, tuple[str, ...]] = {
    "move": ("side", "lands"), "delete": ("side", "lands"), "add": ("kind",),
    "hands": ("side", "lands", "hands"), "hold": ("side", "lands", "hold"),
    "end": ("side", "ends", "at"),
    "size": ("side", "lands", "size"), "height": ("side", "lands", "by"),
    "speed": ("side", "lands", "speed"), "nod": ("at",), "blink": ("at",),
    "look": ("at", "yaw", "pitch"), "remove": ("list", "at"), "style": (),
    "plan": ("name", "text"),
}  # fmt: skip
