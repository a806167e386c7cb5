"""JSON cards of weights, and configurations as dataclasses; imports no torch."""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

from conventions.names import safe_file_stem
from model.storage.files import read_within_limit

MAX_CARD_BYTES = 10**7
BUNDLED_WEIGHTS = Path(__file__).parents[1] / "weights"
DEFAULT_SPEAKER_PAIR = "hana", "june"
"""The calmest speaker of the bundled weights, and a lively one."""


def parse_calm_and_lively_speaker(text: str) -> tuple[str, str]:
    """Parse the names of the calm and the lively speaker; raises ValueError if they are not two."""
    calm, comma, lively = text.partition(",")
    if not (calm and comma and lively) or calm == lively:
        raise ValueError(
            f"Give two speaker names, the calmer one first, as CALM,LIVELY; got {text!r}."
        )
    return calm, lively


class CheckpointError(ValueError):
    """Weights that are missing, damaged or of another shape than their card states."""


T = TypeVar("T")


class WeightsCard(dict[str, Any]):
    """The JSON object that describes weights: their identity and how they were trained.

    What every card states has a property; reading what one lacks raises a message for the user.
    """

    def __init__(self, content: Mapping[str, Any], weights: str) -> None:
        super().__init__(content)
        self.weights = weights
        """Name of the weights' files, without the suffix."""

    @contextmanager
    def reporting_errors(self) -> Iterator[None]:
        """Convert errors from missing or invalid entries to CheckpointError in the context."""
        try:
            yield
        except (KeyError, TypeError, AttributeError) as error:
            sentence = (
                f"The weights card (JSON) of {self.weights} has a missing or wrong entry: {error}."
            )
            raise CheckpointError(sentence) from None

    @property
    def sha256(self) -> str:
        """SHA-256 of the weights."""
        with self.reporting_errors():
            return str(self["sha256"])

    @property
    def speakers(self) -> dict[str, int]:
        """Index in the network's speaker table of each speaker that the weights were trained on."""
        with self.reporting_errors():
            return {str(name): _number(place, int) for name, place in self["speakers"].items()}

    @property
    def encoder(self) -> str:
        """Name of the speech encoder of the network."""
        return str(self.setting("encoder"))

    def setting(self, name: str) -> Any:
        """Return one setting of the training."""
        with self.reporting_errors():
            return self["config"][name]

    def config(self, kind: type[T], part: str) -> T:
        """Return a part of the settings as a dataclass; raises CheckpointError if invalid."""
        try:
            with self.reporting_errors():
                return from_dict(kind, self["config"][part])
        except CheckpointError:
            raise
        except ValueError as error:
            raise CheckpointError(
                f"The weights card (JSON) of {self.weights} has a wrong entry: {error}"
            ) from None

    @property
    def training_data_hours(self) -> float:
        """Duration of the training data (h); 0 if unknown."""
        with self.reporting_errors():
            return _number(self.get("training_hours") or 0.0, float)

    @property
    def training_steps(self) -> int | None:
        """Number of training steps; None if unknown."""
        return self.get("steps")

    @property
    def origin_note(self) -> str | None:
        """Description of weights that are not of this project; None for our own."""
        return self.get("weights_are")


def _number(value: Any, kind: Callable[[Any], T]) -> T:
    """Convert a value to a number; raises `TypeError` if it is none."""
    try:
        return kind(value)
    except (ValueError, OverflowError) as error:
        raise TypeError(str(error)) from None


def load_card(folder: Path, system: str) -> WeightsCard:
    """Load the card of a system; raises CheckpointError if it is missing or no JSON object."""
    path = folder / f"{safe_file_stem(system)}.json"
    if not path.exists():
        raise CheckpointError(f"{path} is missing; train {system} or pass --weights.")
    content = read_within_limit(path, MAX_CARD_BYTES, CheckpointError)
    try:
        card = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise CheckpointError(f"{path} cannot be read: {error}") from None
    if not isinstance(card, dict) or "sha256" not in card:
        raise CheckpointError(f"{path} is not a weights card: it has no sha256.")
    return WeightsCard(card, system)


def override_setting(config: T, setting: str) -> T:
    """Return the config with one field changed by ``outer.inner=value``; raises ValueError."""
    path, equals, value_text = setting.partition("=")
    if not equals:
        raise ValueError(f"{setting!r} is not a setting; write it as field=value.")
    try:
        value = json.loads(value_text)
    except json.JSONDecodeError:
        value = value_text
    *outer, name = path.split(".")
    values = asdict(config)  # type: ignore[call-overload]
    place = values
    for step in outer:
        place = place.get(step)
        if not isinstance(place, dict):
            break
    if not isinstance(place, dict) or name not in place:
        raise ValueError(f"{type(config).__name__} has no field {path}.")
    place[name] = _of_kind(path, place[name], value)
    return from_dict(type(config), values)


def _of_kind(path: str, old: Any, new: Any) -> Any:
    """Return ``new``, converted if needed, if its type fits that of ``old``."""
    if old is None or new is None:
        return new
    if isinstance(old, float) and isinstance(new, int) and not isinstance(new, bool):
        return float(new)
    same = isinstance(new, list) if isinstance(old, tuple) else type(new) is type(old)
    if not same:
        raise ValueError(f"{path} must have the type of its present value {old!r}; got {new!r}.")
    return new


def to_json(config: Any) -> str:
    """Format the config as indented JSON, nested dataclasses as objects."""
    return json.dumps(asdict(config), indent=1)


def from_dict(cls: type[T], values: dict[str, Any]) -> T:
    """Make a (nested) config from parsed JSON; raises ValueError for an unknown field."""
    if not is_dataclass(cls):
        raise TypeError(f"{cls} is not a config.")
    unknown = sorted(set(values) - {f.name for f in fields(cls)})
    if unknown:
        raise ValueError(f"{cls.__name__} has no field {', '.join(unknown)}.")
    hints = get_type_hints(cls)
    return cls(**{name: _restored(hints[name], value) for name, value in values.items()})


def _restored(hint: Any, value: Any) -> Any:
    """Convert a parsed JSON value to the type of its field."""
    if is_dataclass(hint):
        return from_dict(hint, value)  # type: ignore[arg-type]
    return tuple(value) if isinstance(value, list) else value
