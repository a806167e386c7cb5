"""JSON written by others, read without trusting it: caps, then typed look-ups with a sentence."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn, TypeGuard

MAX_TEXT = 2000
"""Longest text, in characters, that any field may hold."""

MAX_NUMBER = 1e15
"""No count, time or measure comes near it; far larger ones do not even fit a float."""


class FieldError(ValueError):
    """What is wrong with one field, as the end of a sentence about its file."""


def read_object(path: Path, max_bytes: int) -> Fields:
    """The JSON object in a file.

    The cap on bytes bounds the number of items; nesting is bounded by the parser's own recursion
    limit, which is reported and not suffered.

    Raises:
        FieldError: if it is too large, unreadable, no JSON, or no object.
    """
    try:
        with path.open("rb") as file:
            content = file.read(max_bytes + 1)
    except OSError as error:
        raise FieldError(f"it cannot be read ({error.strerror or 'unknown reason'})") from error
    if len(content) > max_bytes:
        raise FieldError(f"it is larger than the {max_bytes:,} bytes that are read")
    try:
        value = json.loads(
            content, parse_constant=_refuse_constant, object_pairs_hook=_without_doubles
        )
    except FieldError:
        raise
    except RecursionError as error:
        raise FieldError("it is nested too deeply") from error
    except ValueError as error:  # also bytes that are no UTF-8, and integers of endless digits
        raise FieldError("it is no whole JSON file (cut off or damaged)") from error
    if not isinstance(value, Mapping):
        raise FieldError("it holds no JSON object")
    return Fields(value)


def _refuse_constant(name: str) -> NoReturn:
    raise FieldError(f"it holds {name}, which is no JSON number")


def _without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    fields = dict(pairs)
    if len(fields) != len(pairs):
        raise FieldError("it names the same field twice")
    return fields


class Fields:
    """A JSON object whose values are asked for by name and type."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        self._values = values

    def raw(self, name: str) -> Any:
        """The value as it stands; None when it is missing."""
        return self._values.get(name)

    def text(self, name: str) -> str:
        """A text of 1 to `MAX_TEXT` characters."""
        value = self.raw(name)
        if not is_text(value) or not value:
            raise FieldError(f"`{name}` must be a text of 1 to {MAX_TEXT} characters")
        return value

    def text_or_none(self, name: str) -> str | None:
        return None if self.raw(name) is None else self.text(name)

    def one_of(self, name: str, allowed: tuple[str, ...]) -> str:
        value = self.raw(name)
        if value not in allowed:
            raise FieldError(f"`{name}` must be one of {', '.join(allowed)}")
        return value

    def whole(self, name: str, least: int, most: int) -> int:
        """A whole number within both limits."""
        value = self.raw(name)
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
            raise FieldError(f"`{name}` must be a whole number from {least} to {most}")
        return value

    def texts(self, name: str, most: int) -> tuple[str, ...]:
        """A list of at most so many texts."""
        value = self.raw(name)
        if not isinstance(value, list) or not all(is_text(item) for item in value):
            raise FieldError(f"`{name}` must be a list of texts")
        if len(value) > most:
            raise FieldError(f"`{name}` has {len(value)} items; at most {most} are read")
        return tuple(value)

    def inner(self, name: str) -> Fields:
        """An object."""
        value = self.raw(name)
        if not isinstance(value, Mapping):
            raise FieldError(f"`{name}` must be an object")
        return Fields(value)

    def objects(self, name: str, most: int) -> list[Fields]:
        """A list of at most so many objects."""
        value = self.raw(name)
        if not isinstance(value, list) or not all(isinstance(item, Mapping) for item in value):
            raise FieldError(f"`{name}` must be a list of objects")
        if len(value) > most:
            raise FieldError(f"`{name}` has {len(value)} items; at most {most} are read")
        return [Fields(item) for item in value]

    def named_objects(self, name: str) -> dict[str, Fields]:
        """An object of objects."""
        inner = self.inner(name)
        return {key: inner.inner(key) for key in inner.names()}

    def names(self) -> tuple[str, ...]:
        return tuple(self._values)


def is_text(value: object) -> TypeGuard[str]:
    """Whether it is a text of bearable length that can be written to a file."""
    if not isinstance(value, str) or len(value) > MAX_TEXT:
        return False
    return not any("\ud800" <= letter <= "\udfff" for letter in value)  # halves of a pair


def is_number(value: object) -> TypeGuard[float]:
    """Whether it is a JSON number (true and false are none) of bearable size."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return -MAX_NUMBER <= value <= MAX_NUMBER  # false for NaN
