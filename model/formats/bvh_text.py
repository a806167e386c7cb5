"""Parser of BVH text: joints and rows of numbers, with repairs that lose nothing."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

import numpy as np
from jaxtyping import Float

from model.motion.motion import check_num_frames
from model.storage.npz import MotionError, check_size

MAX_JOINTS = 400
MAX_WORD = 200
MAX_MAGNITUDE = 1e6
"""Largest offset or position, in any unit, and largest angle in degrees."""
_CHANNELS = {
    f"{axis}{kind}".lower(): f"{axis}{kind}" for axis in "XYZ" for kind in ("position", "rotation")
}
_FUSED = re.compile(r"(?<=[0-9])-(?=[0-9])")


@dataclass
class Joint:
    """A joint of the file."""

    name: str
    parent: int
    offset: tuple[float, ...] = (0.0, 0.0, 0.0)
    channels: list[str] = field(default_factory=list)
    first_channel: int = 0
    """Index of its first channel in a row."""


@dataclass
class BvhFile:
    """Parsed content of a BVH file."""

    joints: list[Joint]
    frame_duration_s: float
    rows: Float[np.ndarray, "T channels"]
    notes: list[str]
    """Repairs that were made, each half a sentence."""


def parse_bvh(path: Path) -> BvhFile:
    """Read joints, duration of a frame (s) and rows; raises MotionError with line and reason."""
    check_size(path)
    try:
        return _Reader(path.name, path.read_text("latin-1")).read()
    except OSError as error:
        raise MotionError(f"{path.name} could not be read: {error.strerror or error}.") from error


class _Reader:
    """State of parsing a file's text."""

    def __init__(self, name: str, text: str) -> None:
        self._name, self._text = name, text
        self._at = 0
        """Position of the current word or line in the text."""
        self._notes: list[str] = []

    def read(self) -> BvhFile:
        joints = self._hierarchy()
        channels = sum(len(joint.channels) for joint in joints)
        joints = self._largest_skeleton(joints)
        own = sum(len(joint.channels) for joint in joints)
        if not own:
            raise self._error("no joint has channels")
        lines = self._lines()
        frames, frame_duration_s = self._head(next(lines, ""), next(lines, ""))
        rows = self._rows(
            lines, frames, channels, own if joints[0].first_channel == 0 else channels
        )
        return BvhFile(joints, frame_duration_s, rows, self._notes)

    def _error(self, reason: str) -> MotionError:
        line = 1 + self._text.count("\n", 0, self._at)
        return MotionError(f"{self._name} is not a readable BVH file: line {line}, {reason}.")

    def _words(self) -> Iterator[str]:
        """Yield the words of the hierarchy, up to ``MOTION``."""
        for match in re.finditer(r"[{}]|[^\s{}]+", self._text):
            self._at = match.start()
            if match[0].upper() == "MOTION":
                self._at = match.end()
                return
            yield match[0][:MAX_WORD]
        raise self._error("there is no MOTION section")

    def _lines(self) -> Iterator[str]:
        """Yield the remaining lines that are not empty."""
        for match in re.compile(r"\S[^\n]*").finditer(self._text, self._at):
            self._at = match.start()
            yield match[0].rstrip()

    def _hierarchy(self) -> list[Joint]:
        """Parse the joints in the order of the file, which is that of the channels."""
        joints: list[Joint] = []
        blocks: list[int] = []
        current, width = -1, 0
        words = self._words()
        if next(words, "").lstrip("\ufeff\xef\xbb\xbf").upper() != "HIERARCHY":
            raise self._error("it does not begin with HIERARCHY")
        for word in words:
            match word.upper():
                case "ROOT" | "JOINT" | "END":
                    label = self._name_before_brace(words)
                    parent, current = blocks[-1] if blocks else -1, -1
                    if word.upper() != "END":
                        current = len(joints)
                        joints.append(Joint(label, parent))
                    blocks.append(parent if current < 0 else current)
                case "}":
                    if not blocks:
                        raise self._error("a } has no {")
                    blocks.pop()
                    current = blocks[-1] if blocks else -1
                case "OFFSET":
                    offset = tuple(self._number(next(words, "")) for _ in range(3))
                    if not np.abs(offset).max() < MAX_MAGNITUDE:
                        raise self._error(f"an offset must be under {MAX_MAGNITUDE:g}")
                    if current >= 0:
                        joints[current].offset = offset
                case "CHANNELS" if current >= 0:
                    if joints[current].channels:
                        raise self._error("a joint has CHANNELS twice")
                    count = next(words, "")
                    if not count.isdigit() or int(count) > 6:
                        raise self._error(f"a joint cannot have {count[:20]!r} channels")
                    names = [next(words, "").lower() for _ in range(int(count))]
                    if not set(names) <= set(_CHANNELS) or len(set(names)) < len(names):
                        raise self._error(f"these are not channels: {' '.join(names)[:80]}")
                    joints[current].channels = [_CHANNELS[each] for each in names]
                    joints[current].first_channel = width
                    width += len(names)
                case _:
                    raise self._error(f"{word[:40]!r} is none of ROOT, JOINT, OFFSET, CHANNELS")
            if len(joints) > MAX_JOINTS:
                raise self._error(f"it exceeds the limit of {MAX_JOINTS} joints")
        if not joints:
            raise self._error("it has no joints")
        return joints

    def _name_before_brace(self, words: Iterator[str]) -> str:
        label: list[str] = []
        for word in words:
            if word == "{":
                return " ".join(label).split(":")[-1].strip()
            label.append(word)
            if len(label) > 20:
                break
        raise self._error("a joint has no {")

    def _head(self, counted: str, timed: str) -> tuple[int, float]:
        frames = re.match(r"(?i)frames\s*:?\s*(\d+)\s*$", counted)
        if frames is None:
            raise self._error(f"'Frames: N' is expected; found {counted[:40]!r}")
        time = re.match(r"(?i)frame\s*time\s*:?\s*(\S+)", timed)
        if time is None:
            raise self._error(f"'Frame Time: S' is expected; found {timed[:40]!r}")
        frame_duration_s = self._number(time[1])
        if not 0 < frame_duration_s < 1e3:
            raise self._error(f"a frame cannot last {frame_duration_s:g} s")
        if int(frames[1]) == 0:
            raise self._error("it has no frames")
        check_num_frames(int(frames[1]), self._name)
        return int(frames[1]), frame_duration_s

    def _rows(self, lines: Iterator[str], frames: int, channels: int, own: int) -> np.ndarray:
        """Parse complete rows, at most as many as stated.

        They are of all joints, or of the first skeleton's alone.
        """
        first = next(lines, "").split()
        channels = own if len(first) == own else channels
        is_by_line = channels in (len(first), len(self._split_fused(first)))
        rows = np.empty((frames, channels))
        num_values, at, rest = 0, self._at, []
        for words in chain([first], (line.split() for line in lines)):
            words = self._split_fused(words) if is_by_line else words
            if is_by_line and (rest or len(words) > channels):
                self._at = at if rest else self._at
                short = (
                    f"a row has {len(rest or words)} numbers; the joints have {channels} channels"
                )
                raise self._error(short)
            at, words = self._at, rest + words
            whole = len(words) // channels * channels
            for start in range(0, min(whole, (frames - num_values) * channels), channels):
                rows[num_values] = self._row(words[start : start + channels])
                num_values += 1
            rest = words[whole:]
            if num_values == frames:
                break
        if not num_values:
            raise self._error(
                f"the only row has {len(rest)} numbers; the joints have {channels} channels"
            )
        if rest and num_values < frames:
            self._add_note(
                f"row {num_values + 1} of {frames} is cut off ({len(rest)} of {channels} numbers)"
            )
        elif num_values < frames:
            self._add_note(f"the file states {frames} frames but has {num_values}")
        bad = np.flatnonzero(~np.isfinite(rows[:num_values]).all(axis=1))
        if len(bad):
            raise MotionError(
                f"{self._name} contains values that are not finite in frames"
                f" {', '.join(map(str, bad[:8]))}; repair them first."
            )
        largest = np.abs(rows[:num_values]).max()
        if largest > MAX_MAGNITUDE:
            raise MotionError(
                f"{self._name} contains the value {largest:.3g}; the limit is {MAX_MAGNITUDE:g}."
            )
        return rows[:num_values]

    def _row(self, words: list[str]) -> list[float] | np.ndarray:
        try:
            return np.array(words, dtype=np.float64)
        except ValueError:
            return [self._number(word) for word in words]

    def _split_fused(self, words: list[str]) -> list[str]:
        """Split numbers that run together at their signs."""
        if not any(_FUSED.search(word) for word in words):
            return words
        self._add_note("numbers without a space between them were split at the minus sign")
        return [each for word in words for each in _FUSED.sub(" -", word).split()]

    def _number(self, word: str) -> float:
        try:
            return float(word)
        except ValueError:
            pass
        try:
            value = float(word.replace(",", "."))
        except ValueError:
            raise self._error(f"{word[:40]!r} is not a number") from None
        self._add_note("decimal commas were read as decimal points")
        return value

    def _add_note(self, note: str) -> None:
        if note not in self._notes:
            self._notes.append(note)

    def _largest_skeleton(self, joints: list[Joint]) -> list[Joint]:
        """Return the largest of several skeletons, with its channels unchanged."""
        roots = [index for index, joint in enumerate(joints) if joint.parent < 0]
        if len(roots) == 1:
            return joints
        ends = [*roots[1:], len(joints)]
        start, end = max(zip(roots, ends, strict=True), key=lambda pair: pair[1] - pair[0])
        self._add_note(f"the file has {len(roots)} roots; {joints[start].name[:40]!r} was used")
        subtree = joints[start:end]
        for joint in subtree:
            joint.parent = joint.parent - start if joint.parent >= 0 else -1
        return subtree
