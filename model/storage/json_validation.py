"""Validation of JSON from untrusted sources: a size limit, then types by pydantic."""

from __future__ import annotations

import functools
import reprlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from conventions.names import printable

STRICT = ConfigDict(strict=True, allow_inf_nan=False, validate_by_name=True)
"""Pydantic settings: text and booleans are not numbers; unknown fields are ignored. Fields with an
alias can be given by either name."""
MAX_TEXT = 2000
"""Longest text of a field in characters."""
Text = Annotated[str, Field(min_length=1, max_length=MAX_TEXT)]
NO_JSON = "it is not a valid JSON file (cut off or damaged)"
_UNKNOWN = "unexpected_keyword_argument", "extra_forbidden"
T = TypeVar("T")


class InvalidJsonError(ValueError):
    """An invalid JSON file; the message describes the problem as the end of a sentence."""


def rename_keys(values: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    """Return values with former keys replaced by the present ones in ``names``."""
    return {names.get(key, key): value for key, value in values.items()}


def read_json(path: Path, kind: type[T], max_bytes: int) -> T:
    """Read JSON of a ``kind``; raises InvalidJsonError if too large, unreadable or wrong."""
    try:
        with path.open("rb") as file:
            content = file.read(max_bytes + 1)
    except OSError as error:
        raise InvalidJsonError(
            f"it cannot be read ({error.strerror or 'unknown reason'})"
        ) from error
    if len(content) > max_bytes:
        raise InvalidJsonError(f"it is larger than the limit of {max_bytes:,} bytes")
    return parse_json(content, kind)


def parse_json(content: bytes | str, kind: type[T], context: Any = None) -> T:
    """Parse JSON as a ``kind``; raises InvalidJsonError if it is not of this type."""
    try:
        return type_adapter(kind).validate_json(content, context=context)
    except ValidationError as error:
        raise InvalidJsonError(first_error_clause(error)) from error


@functools.cache
def type_adapter(kind: Any) -> TypeAdapter:
    return TypeAdapter(kind)


def first_error_clause(error: ValidationError) -> str:
    """Describe the first error as the end of a sentence; unknown names take precedence."""
    return printable(_why(error))[:300]


def _why(error: ValidationError) -> str:
    errors = error.errors(include_url=False)
    first = next((one for one in errors if one["type"] in _UNKNOWN), errors[0])
    name = "`" + ".".join(map(str, first["loc"]))[:80] + "`" if first["loc"] else "it"
    if first["type"] == "json_invalid":
        is_deep = "recursion" in str(first.get("ctx"))
        return "it is nested too deeply" if is_deep else NO_JSON
    if first["type"] == "value_error":
        return first["msg"].removeprefix("Value error, ").rstrip(".")
    if first["type"] == "missing":
        return f"{name} is missing"
    if first["type"] in _UNKNOWN:
        return f"{name} is not a known key"
    rule = first["msg"][0].lower() + first["msg"][1:]
    return f"{name} cannot be {reprlib.repr(first['input'])}: {rule}"
