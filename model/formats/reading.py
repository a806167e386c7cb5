"""Readings of motion files, the assumptions about them, and what a user states of them."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from model.storage.json_validation import rename_keys
from model.storage.npz import MotionError

if TYPE_CHECKING:
    from model.motion.motion import Motion

Kind = Literal[
    "layout", "motion", "joints", "rotations", "hands", "up", "facing", "units", "rate", "place",
    "frames", "face", "shape", "lag",
]  # fmt: skip
"""Kinds of assumptions about a file; no file contains `lag`, which is against the speech."""
NOTE_TEXTS: dict[Kind, str] = {
    "up": "up axis {}",
    "facing": "facing direction {}",
    "hands": "hands relative to the {} pose",
    "rate": "frame rate {}",
    "place": "translation {}",
    "shape": "body shape {}",
}
"""Start of a note by kind, with its value; that of other kinds is the kind itself."""
Confidence = Literal["user", "stated", "sure", "likely", "unsure"]
"""Certainty: stated by the user, stated by the file, clear from the motion, likely, or a guess."""
Part = Literal["hands", "finger_angles", "face", "legs", "place", "detail"]
"""Parts that a motion may lack: `finger_angles` if our hand replaces the mean hand pose, `place`
for its translation, `detail` if frames were interpolated."""

MISSING_PART_TEXTS: dict[Part, tuple[str, str]] = {
    "detail": ("was upsampled from a lower frame rate", "jerk and jitter"),
    "finger_angles": ("has hands relative to an unknown mean pose", "finger angles"),
    "hands": ("has no finger motion", "fingers"),
    "face": ("has no face", "the face"),
    "place": ("has no translation", "feet, translation and jerk"),
    "legs": ("has no legs", "legs and feet"),
}
"""Text for a motion that lacks a part, and which of its metrics cannot be compared."""
Rotations = Literal[
    "axis-angle", "6d", "6d-columns", "6d-interleaved", "quaternion-wxyz", "quaternion-xyzw",
    "matrix",
]  # fmt: skip
AXES = ("y", "-y", "z", "-z", "x", "-x")
COMMON_FRAME_RATES = ("15", "20", "24", "25", "30", "50", "60", "120")
METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
OVERRIDE_VALUES: dict[str, tuple[str, ...]] = {
    "up": AXES,
    "facing": (*AXES[2:], "as-is"),
    "units": tuple(METRES),
    "rate": (),
    "hands": ("flat", "mean"),
    "rotations": get_args(Rotations),
    "motion": (),
    "frames": ("refuse", "bridge"),
    "lag": (),
}
"""Options of `--assume` and their values; an empty list allows a number, or a name in a file."""
MOTIONS, REFERENCE = "motions", "reference"
"""Names with which `ImportOverrides` addresses all motions but the reference, or the reference."""
_NUMBER = re.compile(r"-?(\d+\.?\d*|\.\d+)$")
_OVERRIDE_PART = re.compile("[^=]+=[^,]*|[^=]+$")
_FLAG = re.compile(r"^(?:(?P<name>.+):)?(?P<kind>[a-z]+)=(?P<value>.+)$")


def axis_vector(name: str) -> np.ndarray:
    """Return the unit vector of one of `AXES`."""
    return np.eye(3)["xyz".index(name[-1])] * (-1 if name[0] == "-" else 1)


@dataclass(frozen=True)
class Assumption:
    """An assumption about a file."""

    kind: Kind
    value: str
    """Value, as for `--assume` if that has this kind."""
    reason: str
    """Reason, half a sentence."""
    confidence: Confidence = "sure"
    alternatives: tuple[str, ...] = ()
    """Alternative values."""
    is_own_convention: bool = False
    """True if it is as in our own files, so that users need no note."""

    def __post_init__(self) -> None:
        alternatives = tuple(each for each in self.alternatives if each != self.value)
        object.__setattr__(self, "alternatives", alternatives)

    def sentence(self, name: str) -> str:
        """Format a note that names the file."""
        way = ""
        if (
            self.alternatives
            and self.confidence in ("likely", "unsure")
            and self.kind in OVERRIDE_VALUES
        ):
            values = "|".join(self.alternatives[:6])
            way = f" (if this is wrong, use --assume {self.kind}={values})"
        start = NOTE_TEXTS.get(self.kind, f"{self.kind} {{}}").format(self.value)
        return f"{name}: {start}, {self.reason}{way}."

    def as_json(self) -> dict[str, object]:
        """Return the assumption for JSON."""
        return {
            "kind": self.kind,
            "value": self.value,
            "reason": self.reason,
            "confidence": self.confidence,
            "alternatives": list(self.alternatives),
        }


_FORMER_KEYS = {"what": "kind", "why": "reason", "sure": "confidence", "others": "alternatives"}


def with_current_keys(assumption: Mapping[str, Any]) -> dict[str, Any]:
    """Return the JSON of an assumption with the present keys, also that of earlier versions."""
    renamed = rename_keys(assumption, _FORMER_KEYS)
    return renamed | ({"confidence": "user"} if renamed.get("confidence") == "told" else {})


@dataclass(frozen=True)
class ImportedMotion:
    """A motion that was read, at 30 frames per second, y up, in metres, with flat hands."""

    motion: Motion
    assumptions: tuple[Assumption, ...] = ()
    name: str = ""
    """Name of the file."""
    missing_parts: frozenset[Part] = frozenset()
    """Parts that the file lacks, for which there are no findings."""

    @property
    def source_fps(self) -> float:
        """Frame rate at which the file was read (Hz)."""
        assumption = self.assumption_of("rate")
        return 30.0 if assumption is None else float(assumption.value)

    def assumption_of(self, kind: Kind) -> Assumption | None:
        """Return the assumption of a kind; None if there was none."""
        return next((each for each in self.assumptions if each.kind == kind), None)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the assumptions that differ from our own files."""
        return tuple(
            each.sentence(self.name) for each in self.assumptions if not each.is_own_convention
        )


def assumption_difference_notes(readings: Mapping[str, ImportedMotion]) -> list[str]:
    """Return notes on differences between motions that make comparisons unfair."""
    sentences = []
    kinds: dict[Kind, str] = {"rate": "frame rate", "hands": "mean hand pose"}
    for kind, words in kinds.items():
        values = {
            name: assumption.value
            for name, each in readings.items()
            if (assumption := each.assumption_of(kind))
        }
        if len(set(values.values())) > 1:
            values_text = ", ".join(f"{name} {value}" for name, value in list(values.items())[:6])
            sentences.append(
                f"The motions differ in {words} ({values_text}), which may affect the metrics."
            )
    for part, (words, what) in MISSING_PART_TEXTS.items():
        without = [name for name, each in readings.items() if part in each.missing_parts]
        if without and len(without) < len(readings):
            values_text = ", ".join(without[:6])
            sentences.append(
                f"{values_text} {words}: do not compare metrics of {what} with the other motions."
            )
    return sentences


MIN_LENGTH_DIFFERENCE_S = 1.0
"""Difference in duration (s) that matching sound and motion do not reach."""


def length_notes(
    speech_s: float, durations_s: Mapping[str, float], rates: Mapping[str, float] | None = None
) -> list[str]:
    """Return a note on durations unlike the speech's, with the rate that would fit."""
    others = {
        name: duration_s
        for name, duration_s in durations_s.items()
        if abs(speech_s - duration_s) > MIN_LENGTH_DIFFERENCE_S
    }
    if not others:
        return []
    ends = dict.fromkeys(f"{end(others.values()):.1f}" for end in (min, max))
    ends_text = " to ".join(ends)
    if len(others) == 1:
        named = f"{next(iter(others))} lasts {ends_text} s"
    else:
        named = f"{len(others)} of the motions last {ends_text} s"
    fits = [
        duration_s * (rates or {}).get(name, 30.0) / speech_s
        for name, duration_s in others.items()
        if speech_s > 0
    ]
    fitting = [
        rate
        for rate in COMMON_FRAME_RATES
        if fits and all(abs(f / float(rate) - 1) < 0.01 for f in fits)
    ]
    hint = ""
    if fitting:
        it = "it" if len(others) == 1 else "each"
        hint = (
            f" At {fitting[0]} fps {it} would be as long as the speech (--assume "
            f"rate={fitting[0]})."
        )
    return [
        f"The speech lasts {speech_s:.1f} s, but {named}. Only the common duration is shown.{hint}"
    ]


@dataclass(frozen=True)
class ImportOverrides:
    """Properties that the user states for files with incomplete or wrong content."""

    entries: tuple[tuple[str, str, str], ...] = ()
    """File's name (or ``*.SUFFIX``, `MOTIONS`, `REFERENCE`, or "" for all), kind and value."""

    def for_file(self, *names: str) -> dict[str, str]:
        """Return a file's values by kind, of which specific names override patterns and ""."""
        kinds = {f"*{Path(name).suffix.lower()}" for name in names}
        order: tuple[Collection[str], ...] = ("",), kinds, names
        return {what: value for of in order for name, what, value in self.entries if name in of}

    def restricted_to(self, files: Sequence[Path], *names: str) -> ImportOverrides:
        """Return the statements on these files, and on all."""
        there = {"", MOTIONS, REFERENCE, *names}
        there |= {
            each for path in files for each in (path.name, path.stem, f"*{path.suffix.lower()}")
        }
        return ImportOverrides(tuple(each for each in self.entries if each[0] in there))

    def unknown_file_error(self, files: Sequence[Path], *names: str) -> str:
        """Return an error text about the first statement on a missing file, or ""."""
        applicable = self.restricted_to(files, *names).entries
        for name, kind, value in self.entries:
            if (name, kind, value) not in applicable:
                there = ", ".join(names or [path.name for path in files[:6]])
                return (
                    f"The import setting {kind}={value} is for a file {name[:80]!r}, which does "
                    f"not exist; the files are {there}."
                )
        return ""

    def check_files_exist(self, files: Sequence[Path], *names: str) -> None:
        """Check that files with a statement exist; raises MotionError as `unknown_file_error`."""
        if wrong := self.unknown_file_error(files, *names):
            raise MotionError(wrong)


def parse_import_overrides(text: str) -> ImportOverrides:
    """Parse `--assume`: ``up=z,NAME:rate=25``; a name may have commas; raises MotionError."""
    says = []
    for part in filter(None, (part.strip(" ,") for part in _OVERRIDE_PART.findall(text))):
        match = _FLAG.match(part)
        if match is None or match["kind"] not in OVERRIDE_VALUES:
            raise MotionError(
                f"{part[:60]!r} is not a valid import setting; use SETTING=VALUE or "
                f"FILE:SETTING=VALUE, with SETTING one of {', '.join(OVERRIDE_VALUES)}."
            )
        kind, value = match["kind"], match["value"].strip()
        allowed = OVERRIDE_VALUES[kind]
        if kind in ("rate", "lag") and not _NUMBER.match(value):
            raise MotionError(f"{kind} must be a number; found {value[:40]!r}.")
        if allowed and value not in allowed:
            raise MotionError(f"{kind} must be one of {', '.join(allowed)}; found {value[:40]!r}.")
        says.append((match["name"] or "", kind, value))
    return ImportOverrides(tuple(says))
