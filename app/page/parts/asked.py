"""What a form or the API sends, held against the types that its fields are said to have.

A browser sends what the page's fields give; a program may send anything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, fields
from functools import cache
from typing import Any, TypeVar, get_type_hints

from pydantic import BaseModel, ConfigDict, ValidationError, create_model

from app.errors import RunError

FormType = TypeVar("FormType")
LONGEST_TEXT = 5000
NOT_WHOLE = "{what} must be a whole number from {least} to {most}; got {value:g}."


def form_of(form: type[FormType], values: Sequence[Any]) -> FormType:
    """The dataclass ``form`` of the values in the order of its fields.

    Raises:
        RunError: if a value has another type than its field, is NaN or is far too long.
    """
    named = dict(zip([field.name for field in fields(form)], values, strict=False))  # type: ignore[arg-type]
    try:
        _model_of(form)(**named)
    except ValidationError as error:
        found = error.errors(include_url=False, include_input=False)[0]
        raise RunError(
            f"The field {found['loc'][0]} cannot be used: {found['msg'].lower()}."
        ) from error
    return form(**named)


def whole_number(value: float, what: str, least: int, most: int) -> int:
    """
    Raises:
        RunError: for any other number.
    """
    if value != int(value) or not least <= value <= most:
        raise RunError(NOT_WHOLE.format(what=what, least=least, most=most, value=value))
    return int(value)


@cache
def _model_of(form: type) -> type[BaseModel]:
    hints = get_type_hints(form)
    of_fields: dict[str, Any] = {
        field.name: (hints[field.name], ... if field.default is MISSING else field.default)
        for field in fields(form)
    }
    config = ConfigDict(strict=True, allow_inf_nan=False, str_max_length=LONGEST_TEXT)
    return create_model(form.__name__, __config__=config, **of_fields)
