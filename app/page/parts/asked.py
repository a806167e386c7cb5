"""The fields of a form, each under the name of what it asks for, and what is sent for them.

A browser sends what the page's fields give; a program may send anything.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gradio as gr
from pydantic import ConfigDict, ValidationError, create_model

from app.errors import RunError

LONGEST_TEXT = 5000
_KINDS = {
    gr.CheckboxGroup: list[str],
    gr.Checkbox: bool,
    gr.Number: float | None,
    gr.Slider: float,
    gr.Textbox: str,
}
"""What parts give; others a text, or the name of a file."""
NOT_WHOLE = "{what} must be a whole number from {least} to {most}; got {value}."


@dataclass(frozen=True)
class Field:
    """One of a form."""

    part: Any
    """Of the page."""
    read: Callable[[Any], Any] = lambda value: value
    """What is asked for, of what the part gives. May raise `RunError`."""

    @property
    def kind(self) -> Any:
        """What the part gives."""
        part = self.part
        if getattr(part, "file_count", "") == "multiple" or getattr(part, "multiselect", False):
            return list[str] | None
        if isinstance(part, gr.Dropdown | gr.Radio) and isinstance(part.value, float):
            return float | None
        return _KINDS.get(type(part), str | None)


Fields = Mapping[str, Field]


def values_of(form: Fields, values: Sequence[Any]) -> dict[str, Any]:
    """What is asked for, by name, of what was sent in the order of the fields.

    Raises:
        RunError: if a value has another type than its field, is NaN or is far too long; or what
            `Field.read` raises.
    """
    sent = dict(zip(form, values, strict=False))
    sent = {name: sent.get(name, field.part.value) for name, field in form.items()}
    kinds: dict[str, Any] = {name: (field.kind, ...) for name, field in form.items()}
    config = ConfigDict(strict=True, allow_inf_nan=False, str_max_length=LONGEST_TEXT)
    try:
        create_model("Form", __config__=config, **kinds)(**sent)
    except ValidationError as error:
        found = error.errors(include_url=False, include_input=False)[0]
        raise RunError(
            f"The field {found['loc'][0]} cannot be used: {found['msg'].lower()}."
        ) from error
    return {name: field.read(sent[name]) for name, field in form.items()}


def whole(
    what: str, least: int, most: int, usual: int | None = None
) -> Callable[[float | None], int | None]:
    """Reads a whole number.

    Args:
        usual: of an empty field; None refuses that.
    """

    def read(value: float | None) -> int | None:
        if value is None and usual is not None:
            return usual
        if value is None or value != int(value) or not least <= value <= most:
            told = "nothing" if value is None else f"{value:.15g}"
            raise RunError(NOT_WHOLE.format(what=what, least=least, most=most, value=told))
        return int(value)

    return read


def a_file(value: str | None) -> Path | None:
    """Where an upload lies, if there is one."""
    return Path(value) if value else None


def some_files(values: Sequence[str] | None) -> tuple[Path, ...]:
    """Where uploads lie."""
    return tuple(map(Path, values or ()))
