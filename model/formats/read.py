"""One door for all motion files: each kind has its reader, and the motion itself says the rest.
What a file was understood as: a motion, and each thing that was assumed of it to get there.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from jaxtyping import Float

from model.storage.npz import MotionError, opened_archive, read_array, read_headers

if TYPE_CHECKING:
    from model.motion.motion import Motion

Kind = Literal[
    "layout", "motion", "joints", "rotations", "hands", "up", "facing", "units", "rate", "place",
    "frames", "face", "shape", "lag",
]  # fmt: skip
"""What can be assumed of a file; of `lag`, against the speech, no file tells anything."""
Sure = Literal["told", "stated", "sure", "likely", "unsure"]
"""Told by the user, stated by the file, evident from the motion, likely, a guess."""
Part = Literal["hands", "finger_angles", "face", "legs", "place", "detail"]
"""What a motion may lack: `finger_angles` where a hand of ours stands in for the mean hand, `place`
is its translation, `detail` what frames that were filled in never had."""

LACKS: dict[Part, tuple[str, str]] = {
    "detail": ("was filled in from fewer frames a second", "jerk and tremble"),
    "finger_angles": ("has hands whose mean is not known", "fingers' angles"),
    "hands": ("has no fingers that move", "fingers"),
    "face": ("has no face", "face"),
    "place": ("says nothing of where the body stands", "feet, place and jerk"),
    "legs": ("has no legs", "legs and feet"),
}
"""Of a motion that lacks some part, what to say of it, and what of it is not to be compared."""
Rotations = Literal[
    "axis-angle", "6d", "6d-columns", "6d-interleaved", "quaternion-wxyz", "quaternion-xyzw",
    "matrix",
]  # fmt: skip
AXES = ("y", "-y", "z", "-z", "x", "-x")
USUAL_RATES = ("15", "20", "24", "25", "30", "50", "60", "120")
METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
TELLABLE: dict[str, tuple[str, ...]] = {
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
"""What `--assume` takes, and its values; none stand for a number, or a name of what is in a
file."""
MOTIONS, REFERENCE = "motions", "reference"
"""Names by which `Assumptions` speaks of all motions but the reference, or of it alone."""
_NUMBER = re.compile(r"-?(\d+\.?\d*|\.\d+)$")
_SAID = re.compile("[^=]+=[^,]*|[^=]+$")
_FLAG = re.compile(r"^(?:(?P<name>.+):)?(?P<kind>[a-z]+)=(?P<value>.+)$")


def axis_of(name: str) -> np.ndarray:
    """The direction of one of `AXES`."""
    return np.eye(3)["xyz".index(name[-1])] * (-1 if name[0] == "-" else 1)


@dataclass(frozen=True)
class Assumption:
    """One thing that a file was taken to be."""

    kind: Kind
    value: str
    """As `--assume` takes it, where it does."""
    why: str
    """Half a sentence: what it rests on."""
    sure: Sure = "sure"
    others: tuple[str, ...] = ()
    """Values that it can be told to be."""
    is_usual: bool = False
    """Whether it is as our own files are, so that nobody needs to be told."""

    def __post_init__(self) -> None:
        others = tuple(each for each in self.others if each != self.value)
        object.__setattr__(self, "others", others)

    def sentence(self, name: str) -> str:
        """For a note that names the file."""
        way = ""
        if self.others and self.sure in ("likely", "unsure") and self.kind in TELLABLE:
            way = f" (if not, say --assume {self.kind}={'|'.join(self.others[:6])})"
        return f"{name}: {self.kind} {self.value}, {self.why}{way}."

    def as_json(self) -> dict[str, object]:
        """For programs."""
        return {
            "what": self.kind,
            "value": self.value,
            "why": self.why,
            "sure": self.sure,
            "others": list(self.others),
        }


@dataclass(frozen=True)
class Reading:
    """A motion as it was understood, at 30 frames a second, y up, in metres, with flat hands."""

    motion: Motion
    assumptions: tuple[Assumption, ...] = ()
    name: str = ""
    """Of the file."""
    lacks: frozenset[Part] = frozenset()
    """What the file does not tell, so that nothing is to be found of it."""

    @property
    def rate(self) -> float:
        """Frames a second at which the file was read."""
        found = self.of("rate")
        return 30.0 if found is None else float(found.value)

    def of(self, kind: Kind) -> Assumption | None:
        """What was assumed of one thing; None where nothing had to be."""
        return next((each for each in self.assumptions if each.kind == kind), None)

    @property
    def notes(self) -> tuple[str, ...]:
        """A sentence for each assumption that is not as in our own files."""
        return tuple(each.sentence(self.name) for each in self.assumptions if not each.is_usual)


def apart(readings: Mapping[str, Reading]) -> list[str]:
    """What differs between motions that are compared, so that numbers differ by it alone."""
    sentences = []
    kinds: dict[Kind, str] = {"rate": "frames a second", "hands": "the pose that hands start from"}
    for kind, words in kinds.items():
        values = {name: found.value for name, each in readings.items() if (found := each.of(kind))}
        if len(set(values.values())) > 1:
            said = ", ".join(f"{name} {value}" for name, value in list(values.items())[:6])
            sentences.append(f"The motions differ in {words} ({said}); numbers may differ by it.")
    for part, (words, what) in LACKS.items():
        without = [name for name, each in readings.items() if part in each.lacks]
        if without and len(without) < len(readings):
            said = ", ".join(without[:6])
            sentences.append(f"{said} {words}: do not compare its {what} with the others'.")
    return sentences


LENGTHS_APART_S = 1.0
"""Recordings of sound and motion that belong together differ by less."""


def lengths_apart(
    speech_s: float, durations_s: Mapping[str, float], rates: Mapping[str, float] | None = None
) -> list[str]:
    """Return one note for all motions that are clearly no match of the speech in length, and the
    usual rate at which they would be.

    Args:
        rates: frames a second at which each was read, where that is not 30.
    """
    others = {
        name: duration_s
        for name, duration_s in durations_s.items()
        if abs(speech_s - duration_s) > LENGTHS_APART_S
    }
    if not others:
        return []
    ends = dict.fromkeys(f"{end(others.values()):.1f}" for end in (min, max))
    who = next(iter(others)) if len(others) == 1 else f"{len(others)} of the motions"
    named = f"{who} {' to '.join(ends)} s"
    fits = [
        duration_s * (rates or {}).get(name, 30.0) / speech_s
        for name, duration_s in others.items()
        if speech_s > 0
    ]
    fitting = [
        rate for rate in USUAL_RATES if fits and all(abs(f / float(rate) - 1) < 0.01 for f in fits)
    ]
    hint = ""
    if fitting:
        it = "it" if len(others) == 1 else "each"
        hint = (
            f" At {fitting[0]} frames a second {it} would be as long as the speech (--assume"
            f" rate={fitting[0]})."
        )
    return [f"The speech lasts {speech_s:.1f} s and {named}; only what both have is seen.{hint}"]


@dataclass(frozen=True)
class Assumptions:
    """What the user says of files, where these say too little or lie."""

    says: tuple[tuple[str, str, str], ...] = ()
    """Name of the file, its kind as ``*.npz``, `MOTIONS`, `REFERENCE` or nothing for all; what;
    value."""

    def of(self, *names: str) -> dict[str, str]:
        """By what, for a file of these names; what is said of it alone comes before what is said of
        its kind, and that before what is said of all."""
        kinds = {f"*{Path(name).suffix.lower()}" for name in names}
        order: tuple[Collection[str], ...] = ("",), kinds, names
        return {what: value for of in order for name, what, value in self.says if name in of}

    def known(self, files: Sequence[Path], *names: str) -> Assumptions:
        """What is said of these files, and of all."""
        there = {"", MOTIONS, REFERENCE, *names}
        there |= {
            each for path in files for each in (path.name, path.stem, f"*{path.suffix.lower()}")
        }
        return Assumptions(tuple(each for each in self.says if each[0] in there))

    def unknown(self, files: Sequence[Path], *names: str) -> str:
        """Which file, of which something is said, is not there; nothing where all are."""
        known = self.known(files, *names).says
        for name, kind, value in self.says:
            if (name, kind, value) not in known:
                there = ", ".join(names or [path.name for path in files[:6]])
                said = f"of which {kind}={value} is said"
                return f"No file is called {name[:80]!r}, {said}; there are {there}."
        return ""

    def check(self, files: Sequence[Path], *names: str) -> None:
        """
        Raises:
            MotionError: as `unknown`.
        """
        if wrong := self.unknown(files, *names):
            raise MotionError(wrong)


def read_told(written: str) -> Assumptions:
    """``up=z,units=cm,NAME:rate=25``: what `--assume` takes; a name may have commas.

    Raises:
        MotionError: for unknown kinds and values; it lists those that are known.
    """
    says = []
    for part in filter(None, (part.strip(" ,") for part in _SAID.findall(written))):
        found = _FLAG.match(part)
        if found is None or found["kind"] not in TELLABLE:
            raise MotionError(
                f"{part[:60]!r} is no assumption; say WHAT=VALUE or NAME:WHAT=VALUE, of "
                f"{', '.join(TELLABLE)}."
            )
        kind, value = found["kind"], found["value"].strip()
        known = TELLABLE[kind]
        if kind in ("rate", "lag") and not _NUMBER.match(value):
            raise MotionError(f"{kind} must be a number; found {value[:40]!r}.")
        if known and value not in known:
            raise MotionError(f"{kind} must be one of {', '.join(known)}; found {value[:40]!r}.")
        says.append((found["name"] or "", kind, value))
    return Assumptions(tuple(says))


ENDINGS = (".npz", ".npy", ".bvh")
PICKLES = (".pkl", ".pickle", ".pt", ".pth", ".p", ".joblib", ".ckpt")
_MAGIC = {b"PK\x03\x04": ".npz", b"\x93NUMPY": ".npy", b"HIERARCHY": ".bvh"}
_WAYS = {
    ".fbx": "export it as BVH from Blender",
    ".glb": "export it as BVH from Blender",
    ".gltf": "export it as BVH from Blender",
    ".json": "save its arrays with numpy.savez",
    ".csv": "save its arrays with numpy.savez",
    ".c3d": "fit SMPL-X to its markers (SOMA, MoSh++)",
}


def read_any_motion(
    path: str | Path, told: Assumptions | None = None, body: Path | None = None, *names: str
) -> Reading:
    """Read a motion file, with all that was assumed of it.

    Taken are npz files as BEAT2, AMASS and many models write them, ``.npy`` arrays and BVH; see
    ``docs/formats.md``.

    Args:
        told: what the user says of files (`read_told`).
        body: a licensed SMPL-X file, whose mean hand is used.
        names: by which ``told`` may name this file besides its own name and stem.

    Raises:
        MotionError: for all else; one sentence that names the file.
    """
    path = Path(path)
    said = (told or Assumptions()).of(path.name, path.stem, *names)
    hands = mean_hands(body)
    try:
        return read_unguarded(path, said, hands)
    except MotionError as error:
        if path.name in str(error):
            raise
        raise MotionError(f"{path.name}: {error}") from error
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise MotionError(
            f"{path.name} cannot be read: it is damaged, or of a form that is not known here"
            f" ({type(error).__name__}). Save it again, or in another form ({', '.join(ENDINGS)})."
        ) from error


def read_unguarded(
    path: Path, said: dict[str, str], hands: Float[np.ndarray, "30 3"] | None = None
) -> Reading:
    """Read a motion file; what no reader has thought of is an error of the program's own."""
    from model.formats.bvh_reader import read_bvh
    from model.formats.judged import finished
    from model.formats.numpy_reader import CONVERT, read_npy, read_npz

    reader = {".npy": read_npy, ".bvh": read_bvh, ".npz": read_npz}[_kind(path, CONVERT)]
    return finished(reader(path, said), hands)


def _kind(path: Path, convert: str) -> str:
    """Of the ending, or of the first bytes where the ending tells nothing.

    Raises:
        MotionError: for what is not read, with what to do.
    """
    ending = path.suffix.lower()
    if ending in PICKLES:
        raise MotionError(
            f"{path.name} is a pickle, which can run programs when it is read, and is never loaded."
            f" If you trust it, convert it yourself: {convert}."
        )
    if ending in ENDINGS or not path.is_file():
        kind = ending if ending in ENDINGS else ".npz"
        if kind != ".npz" and not path.is_file():
            raise MotionError(f"{path.name} does not exist; give a motion file.")
        return kind
    with path.open("rb") as file:
        start = file.read(16)
    kind = next((kind for magic, kind in _MAGIC.items() if start.startswith(magic)), None)
    if kind is None:
        way = _WAYS.get(ending, "save it as one of these")
        raise MotionError(
            f"{path.name} is no motion file that can be read; {', '.join(ENDINGS)} are: {way}."
        )
    return kind


def mean_hands(body: Path | None) -> Float[np.ndarray, "30 3"] | None:
    """Of a licensed SMPL-X file; None where there is none, or it has none.

    Raises:
        MotionError: if the file cannot be read.
    """
    if body is None or body.suffix.lower() != ".npz":
        return None
    with opened_archive(body) as archive:
        headers = read_headers(archive, body.name, names_objects=True)
        keys = ("hands_meanl", "hands_meanr")
        if any(key not in headers or headers[key][1].kind != "f" for key in keys):
            return None
        hands = [read_array(archive, key) for key in keys]
    if any(hand.size != 45 for hand in hands):
        return None
    return np.concatenate([hand.reshape(15, 3) for hand in hands]).astype(np.float64)
