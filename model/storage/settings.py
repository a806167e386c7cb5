"""Frozen dataclasses of settings as JSON beside the weights, and back."""

import json
from dataclasses import asdict, fields, is_dataclass
from typing import Any, TypeVar, get_type_hints

T = TypeVar("T")


def to_json(config: Any) -> str:
    """The config as indented JSON, nested dataclasses as objects."""
    return json.dumps(asdict(config), indent=1)


def from_dict(cls: type[T], values: dict[str, Any]) -> T:
    """Rebuild a (nested) config from parsed JSON.

    Raises:
        ValueError: if a field is unknown to this version.
    """
    if not is_dataclass(cls):
        raise TypeError(f"{cls} is no config.")
    known = {f.name for f in fields(cls)}
    unknown = sorted(set(values) - known)
    if unknown:
        raise ValueError(f"{cls.__name__} has no field {', '.join(unknown)}.")
    hints = get_type_hints(cls)
    return cls(**{name: _restored(hints[name], value) for name, value in values.items()})


def _restored(hint: Any, value: Any) -> Any:
    """A field's value as parsed from JSON, in the type that the field has."""
    if is_dataclass(hint):
        return from_dict(hint, value)  # type: ignore[arg-type]
    return tuple(value) if isinstance(value, list) else value
