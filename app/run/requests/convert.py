"""Conversion of requests to JSON, and from flat names as in forms, notebooks and old files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass, replace
from functools import cache, reduce
from operator import getitem
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

from tyro.constructors import PrimitiveConstructorSpec

from app.errors import RunError
from app.flags import CheckboxValuePair
from app.run.requests.parts import LiveRecording
from conventions.names import join_names, printable

Request = TypeVar("Request")
FORMER_FIELD_NAMES: Mapping[str, str] = {
    "told": "import_overrides",
    "take": "live_recording",
    "opened": "source_run",
    "shown": "visible",
    "is_kept": "is_incremental",
    "joint": "tracked_point",
    "words": "word_source",
    "window": "generation_window_frames",
    "overlap": "window_overlap_frames",
    "figure_forms": "figure_formats",
    "size": "picture_height_px",
    "has_poses": "has_figure_poses",
    "is_empty": "writes_empty_plan",
    "frame": "mesh_frame",
    "sheet_every": "contact_sheet_interval",
    "seeds": "num_seeds",
    "speeches": "inputs",
    "counts": "step_counts",
    "flame_to_arkit": "flame_to_arkit_matrix",
}
"""Former names of fields, which programs and files may still use."""
PRIVATE_FIELDS = frozenset(
    (
        "out",
        "weights",
        "body",
        "is_incremental",
        "source_run",
        "live_recording",
        "title",
        "max_total_frames",
    )
)
"""Fields that no file of a run contains: locations of files, and what users do not choose."""


def _is_part(kind: object) -> bool:
    return (
        isinstance(kind, type)
        and is_dataclass(kind)
        and kind.__module__.startswith(__package__ or "")
        and kind is not LiveRecording
    )


@dataclass(frozen=True)
class RequestField:
    """Field of a request or of one of its parts."""

    path: tuple[str, ...]
    """Names of the enclosing parts, outermost first, then the field's own name."""
    type: Any
    """Type with its annotations."""
    default: Any
    """Default value; None if there is none."""

    def value(self, request: object) -> Any:
        return reduce(getattr, self.path, request)


@cache
def request_fields(kind: type) -> Mapping[str, RequestField]:
    """Return the fields of a request and of its parts by name.

    The field ``path`` of a part has the part's name.
    """
    return _fields(kind, None)


def _fields(kind: type, default: object) -> dict[str, RequestField]:
    """Return the fields of a class, with the values of ``default`` unless it is None."""
    by_name: dict[str, RequestField] = {}
    own = {of.name: _own_default(of) for of in fields(kind)}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        value = own[name] if default is None else getattr(default, name)
        value = None if value is MISSING else value
        if not _is_part(hint):
            by_name[name] = RequestField((name,), hint, value)
            continue
        for inner, of in _fields(hint, value).items():
            by_name[name if inner == "path" else inner] = replace(of, path=(name, *of.path))
    return by_name


def request_field(kind: type, name: str) -> RequestField:
    """Return a field of a request by its name or a former one."""
    return request_fields(kind)[FORMER_FIELD_NAMES.get(name, name)]


def accepted_field_names(kind: type) -> frozenset[str]:
    """Return the accepted names of a request's fields, including former ones."""
    names = request_fields(kind)
    return frozenset((*names, *(old for old, name in FORMER_FIELD_NAMES.items() if name in names)))


def request_from(kind: type[Request], values: Mapping[str, Any]) -> Request:
    """Make a request from values by field name, or defaults; raises RunError for unknown names."""
    _check_names(kind, values)
    return _make_request(kind, nested_fields(kind, values))


def _check_names(kind: type, names: Iterable[str]) -> None:
    names_of_kind = accepted_field_names(kind)
    for name in names:
        if name not in names_of_kind:
            there = ", ".join(sorted(request_fields(kind)))
            raise RunError(f"There is no option {name!r}; choose from {there}.")


def nested_fields(kind: type, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by field name as nested dictionaries by part; unknown names are dropped."""
    nested: dict[str, Any] = {}
    for name, value in values.items():
        if name in accepted_field_names(kind):
            *parts, last = request_field(kind, name).path
            reduce(lambda place, part: place.setdefault(part, {}), parts, nested)[last] = value
    return nested


def replace_fields(request: Request, **values: Any) -> Request:
    """Return the request with fields of any part replaced; raises RunError for unknown names."""
    _check_names(type(request), values)
    return _replaced(request, nested_fields(type(request), values))


def _replaced(request: Any, values: Mapping[str, Any]) -> Any:
    changed = {
        name: _replaced(getattr(request, name), value)
        if _is_part(type(getattr(request, name)))
        else value
        for name, value in values.items()
    }
    return replace(request, **changed)


def flat_public_fields(request: object) -> dict[str, Any]:
    """Return `public_fields` by name without the nesting by part, from which no request is made."""
    nested = public_fields(request)
    return {
        name: reduce(getitem, field.path, nested)
        for name, field in request_fields(type(request)).items()
        if field.path[-1] not in PRIVATE_FIELDS
    }


def _make_request(kind: Any, values: Mapping[str, Any]) -> Any:
    hints, made = get_type_hints(kind), dict(values)
    for of in fields(kind):
        default = _own_default(of)
        if not _is_part(hints[of.name]) or (of.name not in made and default is not MISSING):
            continue
        inner = made.get(of.name, {})
        made[of.name] = (
            _make_request(hints[of.name], inner)
            if default is MISSING
            else replace(default, **inner)
        )
    return kind(**made)


def _own_default(of: Field[Any]) -> Any:
    """Return the default of a dataclass field, MISSING if it has none."""
    return of.default if of.default_factory is MISSING else of.default_factory()


def parse_form_value(kind: type, name: str, value: object) -> Any:
    """Parse the form value of a request's field; text and check boxes are converted.

    Text is parsed as on the command line, a check box selects one of two values, and anything else
    is returned unchanged. Raises RunError if the field does not accept the value.
    """
    for mark in getattr(request_field(kind, name).type, "__metadata__", ()):
        if isinstance(value, str) and isinstance(mark, PrimitiveConstructorSpec):
            return mark.instance_from_str([value.strip()])
        if isinstance(value, bool) and isinstance(mark, CheckboxValuePair):
            return mark.checked if value else mark.unchecked
    return value


def refuse_ignored(request: object, names: Sequence[str], why: str, **accepted: Any) -> None:
    """Raise RunError if a command would ignore fields that have neither default nor accepted value.

    The message names their flags.
    """
    ignored = []
    for name in names:
        field = request_field(type(request), name)
        if field.value(request) not in (field.default, accepted.get(name, field.default)):
            marks = getattr(field.type, "__metadata__", ())
            flag = next((mark.name for mark in marks if getattr(mark, "name", None)), name)
            ignored.append(f"--{flag.replace('_', '-')}")
    if ignored:
        raise RunError(f"{why}; remove {join_names(ignored)}.")


def map_paths(request: Request, change: Callable[[Path], Path]) -> Request:
    """Return the request with each of its paths changed."""
    changed: dict[str, Any] = {}
    for of in fields(request):  # type: ignore[arg-type]
        value = getattr(request, of.name)
        if isinstance(value, Path):
            changed[of.name] = change(value)
        elif isinstance(value, tuple) and value and all(isinstance(each, Path) for each in value):
            changed[of.name] = tuple(map(change, value))
        elif is_dataclass(value):
            changed[of.name] = map_paths(value, change)
    return replace(request, **changed)  # type: ignore[type-var]


def public_fields(request: object) -> dict[str, Any]:
    """Return a request for JSON, without private fields and with names in place of paths."""
    return {
        of.name: _json_value(getattr(request, of.name))
        for of in fields(request)  # type: ignore[arg-type]
        if of.name not in PRIVATE_FIELDS
    }


def _json_value(value: Any) -> Any:
    if isinstance(value, Path):
        return printable(value.name)
    if isinstance(value, Mapping):
        return {str(key): _json_value(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_json_value(each) for each in value]
    if is_dataclass(value):
        return public_fields(value)
    return value if isinstance(value, int | float | None) else printable(str(value))
