"""The fields of a form, each under the name of what it asks for, and what is sent for them, read as
the ask declares it.

A browser sends what the page's fields give; a program may send anything.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, fields
from inspect import Parameter, Signature
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import gradio as gr
from pydantic import ConfigDict, ValidationError, create_model
from tyro.constructors import PrimitiveConstructorSpec

from app.errors import RunError
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


def values_of(asked: type[Any], form: Fields, values: Sequence[Any]) -> dict[str, Any]:
    """What is asked for, by name, of what was sent in the order of the fields; of a field that is
    empty or off it is what is usual for the dataclass that the form fills in. Raises `RunError` if
    a value has another type than its field, is NaN or far too long, or cannot be asked for."""
    sent = dict(zip(form, values, strict=False))
    sent = {name: sent.get(name, part.value) for name, part in form.items()}
    kinds: dict[str, Any] = {name: (_kind(part), ...) for name, part in form.items()}
    config = ConfigDict(strict=True, allow_inf_nan=False, str_max_length=LONGEST_TEXT)
    try:
        create_model("Form", __config__=config, **kinds)(**sent)
    except ValidationError as error:
        raise RunError(f"The field {why(error)}.") from error
    hints, usual = get_type_hints(asked, include_extras=True), {of.name: of for of in fields(asked)}
    return {
        name: _read(part, sent[name], hints.get(name), usual.get(name))
        for name, part in form.items()
    }


def _kind(part: Any) -> Any:
    """What a part gives."""
    if getattr(part, "file_count", "") == "multiple" or getattr(part, "multiselect", False):
        return list[str] | None
    offered = getattr(part, "choices", None) or ()
    if isinstance(part, gr.Dropdown | gr.Radio) and any(type(each[1]) is float for each in offered):
        return float | Literal[""] | None
    return _KINDS.get(type(part), str | None)


def _read(part: Any, value: Any, hint: Any, of: Field[Any] | None) -> Any:
    """As the ask has it."""
    usual = MISSING if of is None else of.default
    if of is not None and of.default_factory is not MISSING:
        usual = of.default_factory()
    if isinstance(part, gr.File | gr.Audio):
        paths = tuple(map(Path, [value] if isinstance(value, str) else value or ()))
        return paths if _kind(part) != str | None else next(iter(paths), None)
    if isinstance(value, list):
        value = tuple(value)
    if isinstance(value, str):
        value = value.strip()
    if isinstance(part, gr.Number | gr.Slider) and not _has(hint, float):
        value = usual if value is None and usual is not MISSING else _whole(part, value)
    if not value and usual is not MISSING:
        return usual
    if value is True and get_origin(hint) is Literal:
        return next(each for each in get_args(hint) if each != usual)
    if isinstance(value, str):
        for spec in getattr(hint, "__metadata__", ()):
            if isinstance(spec, PrimitiveConstructorSpec):
                return spec.instance_from_str([value])
    return value


def _has(hint: Any, kind: type) -> bool:
    """Whether it is among the types of a hint."""
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
