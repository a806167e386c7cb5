"""The fields of a form, each under the name of what it asks for, and what is sent for them, read as
the ask declares it.

A browser sends what the page's fields give; a program may send anything.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from inspect import Parameter, Signature
from pathlib import Path
from typing import Any, Literal, get_args

import gradio as gr
from pydantic import ConfigDict, ValidationError, create_model

from app.errors import RunError
from app.run.requests.convert import all_names, default_of, field_type, parse_field
from model.storage.checked import why

LONGEST_TEXT = 5000
_KINDS = {
    gr.CheckboxGroup: list[str],
    gr.Checkbox: bool,
    gr.Number: float | None,
    gr.Slider: float,
    gr.Textbox: str,
}
"""What parts give; others a text, or the name of a file."""
Fields = Mapping[str, Any]
"""Parts of the page."""


def values_of(request: type[Any], form: Fields, values: Sequence[Any]) -> dict[str, Any]:
    """Return what a form asks for, by the names of its fields, from what was sent in their order; a
    field that is empty has the request's default. Raises `RunError` if a value has another type
    than its field, is NaN or far too long, or cannot be asked for."""
    sent = dict(zip(form, values, strict=False))
    sent = {name: sent.get(name, part.value) for name, part in form.items()}
    kinds: dict[str, Any] = {name: (_kind(part), ...) for name, part in form.items()}
    config = ConfigDict(strict=True, allow_inf_nan=False, str_max_length=LONGEST_TEXT)
    try:
        create_model("Form", __config__=config, **kinds)(**sent)
    except ValidationError as error:
        raise RunError(f"The field {why(error)}.") from error
    return {name: _read(part, sent[name], request, name) for name, part in form.items()}


def _kind(part: Any) -> Any:
    """What a part gives."""
    if getattr(part, "file_count", "") == "multiple" or getattr(part, "multiselect", False):
        return list[str] | None
    offered = getattr(part, "choices", None) or ()
    if isinstance(part, gr.Dropdown | gr.Radio) and any(type(each[1]) is float for each in offered):
        return float | Literal[""] | None
    return _KINDS.get(type(part), str | None)


def _read(part: Any, value: Any, request: type, name: str) -> Any:
    """Return a value as the request has it."""
    if isinstance(part, gr.File | gr.Audio):
        paths = tuple(map(Path, [value] if isinstance(value, str) else value or ()))
        return paths if _kind(part) != str | None else next(iter(paths), None)
    if name not in all_names(request):
        return tuple(value) if isinstance(value, list) else value
    if isinstance(value, str):
        value = value.strip()
    if value in (None, ""):
        return default_of(request, name)
    if isinstance(part, gr.Number | gr.Slider) and not _has(field_type(request, name), float):
        value = _whole(part, value)
    return parse_field(request, name, tuple(value) if isinstance(value, list) else value)


def _has(hint: Any, kind: type) -> bool:
    """Return whether a type is among those of a hint."""
    return hint is kind or any(_has(each, kind) for each in get_args(hint))


def _whole(part: Any, value: float | None) -> int:
    least, most = int(part.minimum), int(part.maximum)
    if value is None or value != int(value) or not least <= value <= most:
        told = "nothing" if value is None else f"{value:.15g}"
        raise RunError(f"{part.label} must be a whole number from {least} to {most}; got {told}.")
    return int(value)


def named_fields(run: Callable[..., Iterator[Any]], form: Fields) -> Callable[..., Iterator[Any]]:
    """``run`` with one parameter for each field, of which all but the first may be left out: Gradio
    names the parameters of the page's API by them."""

    def named(request: gr.Request, *values: Any) -> Iterator[Any]:
        yield from run(request, *values)

    kind = Parameter.POSITIONAL_OR_KEYWORD
    defaults = [Parameter.empty, *(part.value for part in list(form.values())[1:])]
    parameters = [Parameter("request", kind, annotation=gr.Request)]
    parameters += [
        Parameter(name, kind, default=default) for name, default in zip(form, defaults, strict=True)
    ]
    named.__dict__["__signature__"] = Signature(parameters)
    return named
