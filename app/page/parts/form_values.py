"""Form fields named after the request fields that they set, and validation of their values.

A browser sends the values of the page's fields; a program may send anything.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from inspect import Parameter, Signature
from pathlib import Path
from typing import Any, Literal, get_args

import gradio as gr
from pydantic import ConfigDict, ValidationError, create_model

from app.errors import RunError
from app.run.requests.convert import accepted_field_names, parse_form_value, request_field
from model.storage.json_validation import first_error_clause

LONGEST_TEXT = 5000
_KINDS = {
    gr.CheckboxGroup: list[str],
    gr.Checkbox: bool,
    gr.Number: float | None,
    gr.Slider: float,
    gr.Textbox: str,
}
"""Types of the values of Gradio components; those of others are text or a file name."""
Fields = Mapping[str, Any]
"""Gradio components by name of the field."""


def parse_form_values(request: type[Any], form: Fields, values: Sequence[Any]) -> dict[str, Any]:
    """Validate the values of a form, and return them by field name.

    Empty fields get the defaults of the request. Raises RunError if a value has the wrong type, is
    NaN, too long or not accepted by the request.
    """
    sent = dict(zip(form, values, strict=False))
    sent = {name: sent.get(name, part.value) for name, part in form.items()}
    kinds: dict[str, Any] = {name: (_kind(part), ...) for name, part in form.items()}
    config = ConfigDict(strict=True, allow_inf_nan=False, str_max_length=LONGEST_TEXT)
    try:
        create_model("Form", __config__=config, **kinds)(**sent)
    except ValidationError as error:
        raise RunError(f"The field {first_error_clause(error)}.") from error
    return {name: _read(part, sent[name], request, name) for name, part in form.items()}


def _kind(part: Any) -> Any:
    """Return the type of a component's value."""
    if getattr(part, "file_count", "") == "multiple" or getattr(part, "multiselect", False):
        return list[str] | None
    offered = getattr(part, "choices", None) or ()
    if isinstance(part, gr.Dropdown | gr.Radio) and any(type(each[1]) is float for each in offered):
        return float | Literal[""] | None
    return _KINDS.get(type(part), str | None)


def _read(part: Any, value: Any, request: type, name: str) -> Any:
    """Convert a value to the type of the request's field."""
    if isinstance(part, gr.File | gr.Audio):
        paths = tuple(map(Path, [value] if isinstance(value, str) else value or ()))
        return paths if _kind(part) != str | None else next(iter(paths), None)
    if name not in accepted_field_names(request):
        return tuple(value) if isinstance(value, list) else value
    if isinstance(value, str):
        value = value.strip()
    if value in (None, ""):
        return request_field(request, name).default
    if isinstance(part, gr.Number | gr.Slider) and not _has(
        request_field(request, name).type, float
    ):
        value = _whole(part, value)
    return parse_form_value(request, name, tuple(value) if isinstance(value, list) else value)


def _has(hint: Any, kind: type) -> bool:
    """Check whether a type is among those of a type hint."""
    return hint is kind or any(_has(each, kind) for each in get_args(hint))


def _whole(part: Any, value: float | None) -> int:
    least, most = int(part.minimum), int(part.maximum)
    if value is None or value != int(value) or not least <= value <= most:
        shown = "no value" if value is None else f"{value:.15g}"
        raise RunError(f"{part.label} must be a whole number from {least} to {most}; got {shown}.")
    return int(value)


def with_named_parameters(
    run: Callable[..., Iterator[Any]], form: Fields
) -> Callable[..., Iterator[Any]]:
    """Return ``run`` with a named parameter for each field, all optional but the first.

    Gradio takes the names of the API's parameters from them.
    """

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
