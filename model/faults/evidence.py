"""What detectors look at, and the findings that they give: a sentence, its numbers, how grave and
where worst."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from conventions.joints import FACE, HANDS, LOWER_BODY, UPPER_BODY
from conventions.rates import FPS
from model.measures.posture import FEET
from model.measures.results import Measures, as_json
from model.measures.smoothness import angular_velocity
from model.motion.motion import Motion
from model.motion.tracks import Tracks

BODY = (*LOWER_BODY, *UPPER_BODY, *HANDS)
"""All joints but the face's."""
UPPER_AND_HANDS = (*UPPER_BODY, *HANDS)
assert not set(BODY) & set(FACE)


@dataclass(frozen=True, eq=False)
class Evidence:
    """One motion as it is, never filtered."""

    motion: Motion
    tracks: Tracks
    raw: Measures
    point: str
    """What the ``tip_`` measures follow."""
    reference: Evidence | None = None
    """Recorded motion of the same speech, of as many frames."""

    @property
    def num_frames(self) -> int:
        return self.motion.num_frames

    @cached_property
    def turning(self) -> Float[np.ndarray, "T1 55 3"]:
        """rad/s of each joint against its parent, from each frame to the next."""
        return angular_velocity(self.tracks.local_rot)

    @cached_property
    def turning_deg_s(self) -> Float[np.ndarray, "T1 55"]:
        """Its length in degrees per second."""
        return np.degrees(np.linalg.norm(self.turning, axis=-1))

    @cached_property
    def lower_foot_m(self) -> Float[np.ndarray, " T"]:
        """Height of the lower foot joint in the world."""
        return self.tracks.joints[:, list(FEET), 1].min(axis=1)

    @cached_property
    def floor_m(self) -> float:
        """Where the lower foot usually is: the median, which hardly moves while a foot is where
        no foot can be."""
        return float(np.median(self.lower_foot_m))


MOST_STRETCHES = 20
WRONG, SEEN, MEASURED = 3, 2, 1
"""Gravities: no person moves so; it shows in where points of the body are; it is in angles between
neighbours, or in numbers alone, and counts half."""


@dataclass(frozen=True)
class Finding:
    """One fault of one motion."""

    said: str
    """A sentence or two."""
    numbers: dict[str, Any]
    """What they were made from."""
    people: str = ""
    """What people do instead, a clause that is told last, and once of several motions."""
    excess: float = 1.0
    """How many times its limit; 1 where there is no measure."""
    span: float = 4.0
    """How many times as much one clip of people has of it as another, at most."""
    worst_frame: int | None = None
    """Where it is worst; None where it is everywhere alike."""
    stretches: tuple[tuple[int, int], ...] = ()
    """First and last frame of each place where it shows, the longest first, `MOST_STRETCHES` at
    most; none where it is everywhere."""
    gravity: int = SEEN
    kind: str = ""
    """Set by the table, as gravity is (`table.FAULTS`)."""

    @property
    def sentence(self) -> str:
        return f"{self.said.removesuffix('.')}; {self.people}." if self.people else self.said

    @property
    def worst_s(self) -> float | None:
        """Seconds from the start of the clip."""
        return None if self.worst_frame is None else self.worst_frame / FPS

    @property
    def severity(self) -> float:
        """How far it is outside of what people do, in steps by which they differ."""
        steps = np.log(max(self.excess, 1.0)) / np.log(self.span)
        return float(steps) * (0.5 if self.gravity == MEASURED else 1.0)

    def as_json(self) -> dict[str, Any]:
        return {
            "kind": self.kind,
            **as_json(self.numbers),
            "gravity": self.gravity,
            "excess": as_json(float(self.excess)),
            "worst_frame": self.worst_frame,
            "worst_s": as_json(self.worst_s),
            "frames": [list(stretch) for stretch in self.stretches],
            "sentence": self.sentence,
        }


def by_gravity(findings: Iterable[Finding]) -> list[Finding]:
    """What no person does first, then what is furthest outside of what people do."""
    return sorted(findings, key=_order)


def _order(finding: Finding) -> tuple[bool, float]:
    return finding.gravity != WRONG, -finding.severity


def ranked(findings: Mapping[str, Sequence[Finding]]) -> list[tuple[str, Finding]]:
    """Return the findings of several motions with their names: of each its gravest, the worst
    motion first, by all that is found in it together; then all others, by how far outside they are.
    """

    def badness(found: Sequence[Finding]) -> tuple[int, float]:
        return sum(each.gravity == WRONG for each in found), sum(
            (each.severity for each in found), 0.0
        )

    order = sorted(findings, key=lambda name: badness(findings[name]), reverse=True)
    told = [(name, by_gravity(findings[name])) for name in order]
    first = [(name, finding) for name, found in told for finding in found[:1]]
    others = [(name, finding) for name, found in told for finding in found[1:]]
    return first + sorted(others, key=lambda other: _order(other[1]))


def clock(frame: int) -> str:
    """A frame's time in the clip, as a player shows it: 1:05.3."""
    tenths = round(10 * frame / FPS)
    return f"{tenths // 600}:{tenths % 600 / 10:04.1f}"


def stretches_of(is_there: Bool[np.ndarray, " T"]) -> tuple[tuple[int, int], ...]:
    """First and last frame of each run of true, the longest first, `MOST_STRETCHES` at most."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_there, [False]])))
    runs = sorted(zip(edges[::2], edges[1::2] - 1, strict=True), key=lambda run: run[0] - run[1])
    return tuple((int(first), int(last)) for first, last in runs[:MOST_STRETCHES])


def most_in_a_second(values: Float[np.ndarray, " N"], is_least: bool = False) -> int | None:
    """The frame in the middle of the second with the highest, or the lowest, mean."""
    if len(values) < FPS:
        return None
    means = np.convolve(values, np.ones(FPS) / FPS, "valid")
    return int(means.argmin() if is_least else means.argmax()) + FPS // 2
