"""Do windows or codes show where they were put together? Jerk folded on any period.

Recorded people have no clock that runs in frames; systems that join windows, or decode codes of
some stride, have one. The jerk of each part of the body is taken in logarithms, less its local
level, and given normal scores, so that no gesture and no single glitch outweighs the rest. Two
tests follow, both with the null hypothesis that nothing repeats:

* **pulses**, 8 to 240 frames: the mean of the scores at one place of the period, over whole
  periods. It is normal, with deviation one over the root of their number.
* **ripple**, 2 to 16 frames: the power at the period's frequency and its multiples, over the power
  around them, which makes it chi-squared. It is added up from stretches of about two seconds whose
  amplitudes are cut at ``CUT``: a rhythm that a hand beats for a while does not add up, a clock
  that runs through the clip does.

Each probability is multiplied by the number of tests made (Bonferroni: periods, their places, and
parts of the body).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.ndimage import median_filter
from scipy.special import ndtri
from scipy.stats import chi2, norm, rankdata

from conventions.joints import FINGERTIP_NAMES, JOINT_INDEX, LEFT_HAND, NUM_JOINTS, RIGHT_HAND
from model.generation.base import Windowing
from model.measures.smoothness import STILL_M_S3, derivative_magnitudes
from model.motion.tracks import Tracks

MIN_PERIOD, MAX_PERIOD = 2, 240
LONGEST_RIPPLE, SHORTEST_PULSES = 16, 8
MIN_PERIODS = 4
"""Fewer whole periods, or stretches of ripple, tell nothing."""
CHANCE = 2.5e-4
"""Of a period in a clip that has none, for each of the two tests; see the table of false alarms in
``docs/others.md``."""
LEVEL_FRAMES = 31
STRETCH_FRAMES = 64
CUT = 1.4
"""Of amplitudes over the usual: hardly weaker against a faint clock, deaf to a loud minority."""
SAME_PERIOD = 0.75
"""Part of what repeats that a shorter period must explain; half of a true one explains half."""
WORST = 5
_LEAST_M_S3 = 1e-3
"""Added before the logarithm."""

Kind = Literal["pulses", "ripple"]


def _with_tips(joints: tuple[int, ...], side: str) -> tuple[int, ...]:
    tips = [i for i, name in enumerate(FINGERTIP_NAMES) if name.startswith(side)]
    return (*joints, *(NUM_JOINTS + tip for tip in tips))


def _joints(*names: str) -> tuple[int, ...]:
    return tuple(JOINT_INDEX[name] for name in names)


PARTS: dict[str, tuple[int, ...]] = {
    "trunk": _joints("pelvis", "spine1", "spine2", "spine3", "neck", "head"),
    "legs": _joints(
        *("left_knee", "right_knee", "left_ankle", "right_ankle", "left_foot", "right_foot")
    ),
    "left arm": _joints("left_elbow", "left_wrist"),
    "right arm": _joints("right_elbow", "right_wrist"),
    "left hand": _with_tips(LEFT_HAND, "left"),
    "right hand": _with_tips(RIGHT_HAND, "right"),
}
"""Points of each part: joints, and fingertips counted on from them."""


@dataclass(frozen=True, eq=False)
class Period:
    """A number of frames after which jerk comes again, of the part that shows it most."""

    frames: int
    kind: Kind
    part: str
    """One of `PARTS`."""
    phase_frame: int
    """Frame of the period, counted from the first of the clip, with the highest mean jerk."""
    periods: int
    """Whole ones in the clip."""
    peak_over_usual: float
    """Mean jerk of the part at that frame over the median of all frames of the period."""
    peak_over_least: float
    """The same over the lowest."""
    chance: float
    """Probability, after all tests that were made, that jerk without a period looks so."""
    worst_frames: tuple[int, ...]
    """Of the clip: where it jerks most at that frame of the period, at most `WORST`."""


@dataclass(frozen=True)
class _Candidate:
    log_chance: float
    """Natural logarithm, before the number of parts counts."""
    frames: int
    kind: Kind
    part: str


def find_period(tracks: Tracks) -> Period | None:
    """The period least likely to be chance, or None where all may be chance.

    A clip too short for four periods of some length is not searched for that length.
    """
    by_part = {part: _part_jerk(tracks, part) for part in PARTS}
    found: list[_Candidate] = []
    for part, values in by_part.items():
        if len(values) < MIN_PERIODS * MIN_PERIOD or values.mean() < STILL_M_S3:
            continue
        scores = _scores(values)
        if scores.any():
            found += _pulses(scores, part)
            found += _ripple(scores, part)
    limit = np.log(CHANCE / len(PARTS))
    found = [candidate for candidate in found if candidate.log_chance <= limit]
    if not found:
        return None
    best = min(found, key=lambda candidate: candidate.log_chance)
    scores = _scores(by_part[best.part])
    frames = _shortest(best.frames, _fold(scores, best.frames))
    kind = best.kind if frames >= SHORTEST_PULSES else "ripple"
    best = replace(best, frames=frames, kind=kind)
    return _described(best, by_part[best.part])


def _part_jerk(tracks: Tracks, part: str) -> Float[np.ndarray, " N"]:
    """Entry i is the mean third difference of the part's points over frames i to i + 3."""
    tips = [point - NUM_JOINTS for point in PARTS[part] if point >= NUM_JOINTS]
    joints = [point for point in PARTS[part] if point < NUM_JOINTS]
    points = np.concatenate([tracks.joints[:, joints], tracks.fingertips[:, tips]], axis=1)
    return derivative_magnitudes(points, 3).mean(axis=1)


def _scores(jerk: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    """Normal scores of the logarithm less its local median."""
    level = np.log(jerk + _LEAST_M_S3)
    level -= median_filter(level, LEVEL_FRAMES, mode="nearest")
    return ndtri((rankdata(level) - 0.5) / len(level))


def _pulses(scores: Float[np.ndarray, " N"], part: str) -> Iterator[_Candidate]:
    longest = min(MAX_PERIOD, len(scores) // MIN_PERIODS)
    periods = np.arange(SHORTEST_PULSES, longest + 1)
    highest = [_fold(scores, int(frames)).max() for frames in periods]
    deviations = np.sqrt(len(scores) // periods) / scores.std()
    tests = len(periods) * periods  # each has as many places as frames
    log_chances = norm.logsf(np.array(highest) * deviations) + np.log(np.maximum(tests, 1))
    for frames, log_chance in zip(periods.tolist(), log_chances.tolist(), strict=True):
        yield _Candidate(log_chance, frames, "pulses", part)


def _ripple(scores: Float[np.ndarray, " N"], part: str) -> Iterator[_Candidate]:
    usual, frequency = _background(scores)
    lengths = {
        frames: frames * round(STRETCH_FRAMES / frames)
        for frames in range(MIN_PERIOD, LONGEST_RIPPLE + 1)
    }
    searched = {f: n for f, n in lengths.items() if len(scores) // n >= MIN_PERIODS}
    of_real, of_complex = _cut_power()
    for frames, length in searched.items():
        stretches = len(scores) // length
        folded = scores[: stretches * length].reshape(stretches, -1, frames).mean(axis=1)
        harmonics = np.arange(1, frames // 2 + 1)
        expected = np.interp(harmonics / frames, frequency, usual)
        amplitude = np.fft.rfft(folded, axis=1)[:, 1:] * np.sqrt(length / expected) / frames
        amplitude *= np.minimum(1.0, CUT / np.maximum(np.abs(amplitude), 1e-9))
        power = np.abs(amplitude.sum(axis=0)) ** 2 / stretches
        is_real = 2 * harmonics == frames  # at half the frame rate there is no phase
        statistic = np.where(is_real, power / of_real, 2 * power / of_complex).sum()
        freedom = np.where(is_real, 1, 2).sum()
        log_chance = chi2.logsf(statistic, freedom) + np.log(len(searched))
        yield _Candidate(float(log_chance), frames, "ripple", part)


def _background(
    scores: Float[np.ndarray, " N"],
) -> tuple[Float[np.ndarray, " bins"], Float[np.ndarray, " bins"]]:
    """Usual power at each frequency, and the frequencies in cycles per frame.

    A running median, which lines do not raise; that of an exponential is its mean times ln 2.
    """
    power = np.abs(np.fft.rfft(scores)) ** 2 / len(scores)
    width = max(15, len(scores) // 40) | 1
    usual = median_filter(power, width, mode="nearest") / np.log(2)
    return np.maximum(usual, 1e-9), np.fft.rfftfreq(len(scores))


@cache
def _cut_power() -> tuple[float, float]:
    """Mean square of a cut standard normal, and of a cut complex one of mean square 1."""
    inside = chi2.cdf(CUT**2, 3)  # the integral of x^2 below the cut
    return float(inside + CUT**2 * chi2.sf(CUT**2, 1)), float(-np.expm1(-(CUT**2)))


def _fold(values: Float[np.ndarray, " N"], frames: int) -> Float[np.ndarray, " frames"]:
    whole = len(values) // frames
    return values[: whole * frames].reshape(whole, frames).mean(axis=0)


def by_phase(jerk: Float[np.ndarray, " N"], frames: int) -> Float[np.ndarray, " frames"]:
    """Mean jerk at each place of a period; a pop at any offset stands out. NaN where there is none.

    A third difference over frames i to i + 3 is counted at frame i + 2, the first frame after its
    middle: a jump between frames f - 1 and f is highest at phase f.
    """
    phase = (np.arange(len(jerk)) + 2) % frames
    count = np.bincount(phase, minlength=frames)
    total = np.bincount(phase, weights=jerk, minlength=frames)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _shortest(frames: int, folded: Float[np.ndarray, " frames"]) -> int:
    """What comes every 7 frames comes every 14 too: the shortest divisor that explains it all."""
    for shorter in (d for d in range(MIN_PERIOD, frames) if frames % d == 0):
        explained = _fold(folded, shorter)
        if (frames // shorter) * (explained**2).sum() > SAME_PERIOD * (folded**2).sum():
            return shorter
    return frames


def _described(chosen: _Candidate, jerk: Float[np.ndarray, " N"]) -> Period:
    folded = by_phase(jerk, chosen.frames)
    phase = int(folded.argmax())
    entries = np.arange((phase - 2) % chosen.frames, len(jerk), chosen.frames)
    worst = entries[np.argsort(-jerk[entries])][:WORST]
    return Period(
        frames=chosen.frames,
        kind=chosen.kind,
        part=chosen.part,
        phase_frame=phase,
        periods=len(jerk) // chosen.frames,
        peak_over_usual=float(folded[phase] / max(float(np.median(folded)), STILL_M_S3)),
        peak_over_least=float(folded[phase] / max(float(folded.min()), STILL_M_S3)),
        chance=float(np.exp(chosen.log_chance) * len(PARTS)),
        worst_frames=tuple(int(entry) + 2 for entry in worst),
    )


def seam_jerk_ratio(jerk: Float[np.ndarray, " N"], window_advance: int, overlap: int) -> float:
    """Peak jerk around the joins of windows over peak jerk of equally long stretches elsewhere.

    1 says that joins cannot be told from the rest. A join is the first frame of every window but
    the first, where the frames that two windows share start. Its stretch holds every third
    difference that touches frames ``join - 1`` to ``join + overlap``: a pop shows wherever in the
    shared frames it sits. NaN without a whole join or without a stretch clear of joins.

    Args:
        jerk: entry i: of frames i to i + 3, averaged over points.
    """
    stretch = overlap + 5
    is_interior = np.ones(len(jerk), dtype=bool)
    seam_peaks = []
    for join in range(window_advance, len(jerk) + 3, window_advance):
        first = join - 4
        is_interior[max(0, first) : first + stretch] = False
        if first >= 0 and first + stretch <= len(jerk):
            seam_peaks.append(jerk[first : first + stretch].max())
    interior_peaks = [
        jerk[start : start + stretch].max()
        for start in range(len(jerk) - stretch + 1)
        if is_interior[start : start + stretch].all()
    ]
    if not seam_peaks or not interior_peaks or np.mean(interior_peaks) < STILL_M_S3:
        return float("nan")
    return float(np.mean(seam_peaks) / np.mean(interior_peaks))


@dataclass(frozen=True)
class RecurringJerk:
    """The frame of a window at which the body jerks most, window after window."""

    phase_frame: int | None
    """None where there are too few windows."""
    windows: int
    """Whole windows that the medians are over."""
    ratio: float
    """Median over windows of the jerk at that frame, over the median of all frames."""
    chance: float = 1.0
    """Probability that jerk without a period stands out so at some frame of the window."""


def recurring_jerk(jerk: Float[np.ndarray, " N"], window_advance: int) -> RecurringJerk:
    """What `by_phase` peaks at, by medians, so that no single jump can do it.

    NaN under 4 whole windows, and where nothing moves.
    """
    by_frame = np.concatenate([np.full(2, np.nan), jerk])  # entry f: frames f - 2 to f + 1
    num_windows = len(by_frame) // window_advance
    if num_windows < MIN_PERIODS:
        return RecurringJerk(None, num_windows, float("nan"))
    windows = by_frame[: num_windows * window_advance].reshape(num_windows, window_advance)
    medians = np.nanmedian(windows, axis=0)
    usual = float(np.median(medians))
    if usual < STILL_M_S3:
        return RecurringJerk(None, num_windows, float("nan"))
    phase, chance, scores = int(medians.argmax()), 1.0, _scores(jerk)
    if len(jerk) >= MIN_PERIODS * window_advance and scores.any():
        whole = np.sqrt(len(scores) // window_advance)
        deviations = _fold(scores, window_advance).max() * whole / scores.std()
        chance = float(min(1.0, window_advance * norm.sf(deviations)))
    return RecurringJerk(phase, num_windows, float(medians[phase] / usual), chance)


@dataclass(frozen=True)
class SeamMeasures:
    """Of the joins of windows, or of the period that was found where no windows are known."""

    seam_jerk_ratio: float
    jerk_by_window_phase_m_s3: Float[np.ndarray, " window_advance"]
    """Empty where there are neither windows nor a period."""
    recurring_jerk: RecurringJerk
    folded_on_frames: int | None = None
    """From one window, or period, to the next."""
    period: Period | None = None
    """Found in the raw motion, whether or not windows are known."""


def seam_measures(tracks: Tracks, windows: Windowing | None, period: Period | None) -> SeamMeasures:
    """Folded on the windows, or else on the period; a period may start anywhere, so that joins are
    looked for in windows only."""
    if windows is not None:
        jerk = derivative_magnitudes(tracks.joints, 3).mean(axis=1)
        return SeamMeasures(
            seam_jerk_ratio(jerk, windows.advance, windows.overlap),
            by_phase(jerk, windows.advance),
            recurring_jerk(jerk, windows.advance),
            windows.advance,
            period,
        )
    unknown = RecurringJerk(None, 0, math.nan)
    if period is None:
        return SeamMeasures(math.nan, np.empty(0), unknown)
    folded = by_phase(_part_jerk(tracks, period.part), period.frames)
    return SeamMeasures(math.nan, folded, unknown, period.frames, period)
