"""Measured jitter of each clip joined with what people preferred and why."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import stats

from app.errors import RunError
from app.study.design.fields import FieldError, Fields, is_number, read_object
from app.study.statistics.preference import Share, share_of
from app.study.statistics.votes import Votes
from conventions.names import REFERENCE_NAME

MAX_DIAGNOSTICS_BYTES = 64 * 2**20
MEASURE = "tip_jerk_m_s3"
"""Mean jerk of the fingertip in m/s³, of the motion as it stands in the file ("raw")."""

Jitter = dict[tuple[str, str], float]
"""(clip, system) -> `MEASURE`."""


@dataclass(frozen=True)
class Point:
    """One clip shown with two systems."""

    clip: str
    smoother: str
    rougher: str
    jerk_ratio: float
    """Jerk of the rougher over that of the smoother; 1 or more."""
    share: float
    """Of votes, for the smoother."""
    because_smooth: int
    """How many named motion smoothness."""


@dataclass(frozen=True)
class JitterJoin:
    """Votes turned so that the video with the lower jerk is on the left."""

    points: tuple[Point, ...]
    because_smooth: Share | None
    """Decided votes that named motion smoothness; None if there are none."""
    other_reasons: Share | None
    """Decided votes that did not."""
    correlation: float | None
    """Spearman's, of jerk ratio and share over the points; None with fewer than 4."""
    correlation_p: float | None


def read_jitter(folder: Path, clips: tuple[str, ...], systems: tuple[str, ...]) -> Jitter:
    """`MEASURE` from ``folder``/CLIP/diagnostics.json or ``folder``/CLIP.json.

    A system is looked up by its name; the measured recording by the name `REFERENCE_NAME`.

    Raises:
        RunError: if there is no file for any clip, or one is damaged.
    """
    jitter: Jitter = {}
    for clip in clips:
        if (
            Path(clip).name != clip or clip == ".."
        ):  # a name from the key must not lead out of the folder
            continue
        for path in (folder / clip / "diagnostics.json", folder / f"{clip}.json"):
            if path.is_file():
                jitter.update(_jitter_of(path, clip, systems))
    if not jitter:
        raise RunError(
            f"No diagnostics of this study's clips are in {folder}; "
            f"expected {clips[0]}/diagnostics.json or {clips[0]}.json there, and so on."
        )
    return jitter


def _jitter_of(path: Path, clip: str, systems: tuple[str, ...]) -> Jitter:
    found: Jitter = {}
    try:
        diagnostics = read_object(path, MAX_DIAGNOSTICS_BYTES)
        measured = diagnostics.inner("systems")
        for name in systems:
            owner: Fields = measured
            if name not in measured.names():
                if name != REFERENCE_NAME or diagnostics.raw(REFERENCE_NAME) is None:
                    continue
                owner = diagnostics
            value = owner.inner(name).inner("raw").raw(MEASURE)
            if is_number(value) and value > 0:
                found[clip, name] = float(value)
    except FieldError as error:
        raise RunError(f"{path} holds no diagnostics: {error}; measure that clip again.") from error
    return found


def join_jitter(
    votes: Votes, jitter: Jitter, clips: tuple[str, ...], systems: tuple[str, ...]
) -> JitterJoin | None:
    """Whether the smoother of two videos is preferred; None without a measured pair."""
    jerk = np.full((len(clips), len(systems)), np.nan)
    for (clip, system), value in jitter.items():
        jerk[clips.index(clip), systems.index(system)] = value
    left, right = jerk[votes.clip, votes.left], jerk[votes.clip, votes.right]
    is_usable = np.isfinite(left) & np.isfinite(right) & (left != right)
    if not is_usable.any():
        return None
    turned = votes[is_usable].turned((left > right)[is_usable])
    is_decided = turned.score != 0.5
    points = _points(turned, jerk, clips, systems)
    correlation = _correlation(points)
    return JitterJoin(
        points=points,
        because_smooth=_share(turned[is_decided & turned.because_smooth]),
        other_reasons=_share(turned[is_decided & ~turned.because_smooth]),
        correlation=correlation[0] if correlation else None,
        correlation_p=correlation[1] if correlation else None,
    )


def _points(
    votes: Votes, jerk: np.ndarray, clips: tuple[str, ...], systems: tuple[str, ...]
) -> tuple[Point, ...]:
    keys = np.stack([votes.clip, votes.left, votes.right])
    found, index = np.unique(keys, axis=1, return_inverse=True)
    points = []
    for place, (clip, left, right) in enumerate(found.T):
        rows = index.ravel() == place
        ratio = float(jerk[clip, right] / jerk[clip, left])
        share = float(votes.score[rows].mean())
        named = int(votes.because_smooth[rows].sum())
        points.append(Point(clips[clip], systems[left], systems[right], ratio, share, named))
    return tuple(points)


def _share(votes: Votes) -> Share | None:
    return share_of(votes) if len(votes) else None


def _correlation(points: tuple[Point, ...]) -> tuple[float, float] | None:
    """Spearman's rho and its p; None where it says nothing."""
    ratios, shares = [point.jerk_ratio for point in points], [point.share for point in points]
    if len(points) < 4 or len(set(shares)) < 2 or len(set(ratios)) < 2:
        return None
    rho, p = stats.spearmanr(ratios, shares)
    return float(rho), float(p)  # pyright: ignore[reportArgumentType]
