"""Detection of window seams and code strides: periods of jerk, and jerk folded on a period.

Motion of people does not repeat at a fixed number of frames; that of systems that join windows, or
decode codes with a stride, can. For each part of the body, the series is the logarithm of jerk
minus its running median, replaced by normal scores (the normal quantiles of its ranks), so that
neither a gesture nor a single glitch dominates. The null hypothesis H0 of both tests is that the
scores have no period:

* **pulses**, periods of 8 to 240 frames: the statistic is the mean score at one phase of the
  period, over N whole periods. Under H0 it is normal with standard deviation 1 / sqrt(N).
* **ripple**, periods of 2 to 16 frames: the statistic is the power at the period's frequency and
  its multiples, divided by the background power around them; under H0 it is chi-squared. The
  complex amplitudes of stretches of about two seconds are clipped at `MAX_AMPLITUDE_RATIO` and
  summed, so that a rhythmic gesture of some seconds adds little, and a period of the clip all.

Each p-value is multiplied by the number of tests (Bonferroni: periods, phases and body parts).
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
from model.metrics.smoothness import STILL_M_S3, derivative_magnitudes
from model.motion.tracks import Tracks

MIN_PERIOD, MAX_PERIOD = 2, 240
LONGEST_RIPPLE, SHORTEST_PULSES = 16, 8
MIN_PERIODS = 4
"""Smallest number of whole periods, or stretches of ripple, for a test."""
CHANCE = 2.5e-4
"""Probability of a false alarm under H0, for each of the two tests; see ``docs/others.md``."""
LEVEL_FRAMES = 31
STRETCH_FRAMES = 64
MAX_AMPLITUDE_RATIO = 1.4
"""Amplitude, as a ratio to the background, at which it is clipped. The test is then robust to a few
stretches with large amplitudes, and loses little power for a weak period of the whole clip."""
MIN_DIVISOR_POWER_SHARE = 0.75
"""Share of a period's power that a divisor needs to replace it; half the true period has half."""
WORST = 5
_MIN_M_S3 = 1e-3
"""Jerk added before the logarithm (m/s³)."""

Kind = Literal["pulses", "ripple"]


def _with_tips(joints: tuple[int, ...], side: str) -> tuple[int, ...]:
    tips = [i for i, name in enumerate(FINGERTIP_NAMES) if name.startswith(side)]
    return (*joints, *(NUM_JOINTS + tip for tip in tips))


def _joints(*names: str) -> tuple[int, ...]:
    return tuple(JOINT_INDEX[name] for name in names)


PARTS: dict[str, tuple[int, ...]] = {
    "trunk": _joints("pelvis", "spine1", "spine2", "spine3", "neck", "head"),
    "legs": _joints(
        "left_knee", "right_knee", "left_ankle", "right_ankle", "left_foot", "right_foot"
    ),
    "left arm": _joints("left_elbow", "left_wrist"),
    "right arm": _joints("right_elbow", "right_wrist"),
    "left hand": _with_tips(LEFT_HAND, "left"),
    "right hand": _with_tips(RIGHT_HAND, "right"),
}
"""Points of each part: joints, and fingertips with indices that continue those of the joints."""


@dataclass(frozen=True, eq=False)
class JerkPeriod:
    """A number of frames after which jerk repeats, in the part that shows it most."""

    frames: int
    kind: Kind
    part: str
    """Name in `PARTS` of the part with this period."""
    frame_in_period: int
    """Frame of the period, counted from the first of the clip, with the highest mean jerk."""
    periods: int
    """Number of whole periods in the clip."""
    peak_over_median: float
    """Mean jerk of the part at that frame over the median of all frames of the period."""
    peak_over_minimum: float
    """Mean jerk of the part at that frame over the lowest of all frames of the period."""
    p_value: float
    """P-value of the period, Bonferroni-corrected for all periods, phases and body parts."""
    worst_frames: tuple[int, ...]
    """Frames of the clip with the highest jerk at that frame of the period, at most `WORST`."""


@dataclass(frozen=True)
class _Candidate:
    log_p_value: float
    """Natural logarithm of the probability, without the correction for the number of parts."""
    frames: int
    kind: Kind
    part: str


def find_jerk_period(tracks: Tracks) -> JerkPeriod | None:
    """Find the period that is least likely to be chance; None if all may be chance.

    A clip too short for four periods of some length is not searched for that length.
    """
    by_part = {part: _part_jerk(tracks, part) for part in PARTS}
    candidates: list[_Candidate] = []
    for part, values in by_part.items():
        if len(values) < MIN_PERIODS * MIN_PERIOD or values.mean() < STILL_M_S3:
            continue
        scores = _scores(values)
        if scores.any():
            candidates += _pulses(scores, part)
            candidates += _ripple(scores, part)
    limit = np.log(CHANCE / len(PARTS))
    candidates = [candidate for candidate in candidates if candidate.log_p_value <= limit]
    if not candidates:
        return None
    best = min(candidates, key=lambda candidate: candidate.log_p_value)
    scores = _scores(by_part[best.part])
    frames = _shortest(best.frames, _fold_by_period(scores, best.frames))
    kind = best.kind if frames >= SHORTEST_PULSES else "ripple"
    best = replace(best, frames=frames, kind=kind)
    return _described(best, by_part[best.part])


def _part_jerk(tracks: Tracks, part: str) -> Float[np.ndarray, " N"]:
    """Compute at entry i the mean third difference of the part's points over frames i to i + 3."""
    tips = [point - NUM_JOINTS for point in PARTS[part] if point >= NUM_JOINTS]
    joints = [point for point in PARTS[part] if point < NUM_JOINTS]
    points = np.concatenate([tracks.joints[:, joints], tracks.fingertips[:, tips]], axis=1)
    return derivative_magnitudes(points, 3).mean(axis=1)


def _scores(jerk: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    """Compute normal scores of the logarithm less its local median."""
    level = np.log(jerk + _MIN_M_S3)
    level -= median_filter(level, LEVEL_FRAMES, mode="nearest")
    return ndtri((rankdata(level) - 0.5) / len(level))


def _pulses(scores: Float[np.ndarray, " N"], part: str) -> Iterator[_Candidate]:
    longest = min(MAX_PERIOD, len(scores) // MIN_PERIODS)
    periods = np.arange(SHORTEST_PULSES, longest + 1)
    highest = [_fold_by_period(scores, int(frames)).max() for frames in periods]
    deviations = np.sqrt(len(scores) // periods) / scores.std()
    tests = len(periods) * periods  # each has as many places as frames
    log_p_values = norm.logsf(np.array(highest) * deviations) + np.log(np.maximum(tests, 1))
    for frames, log_p_value in zip(periods.tolist(), log_p_values.tolist(), strict=True):
        yield _Candidate(log_p_value, frames, "pulses", part)


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
        amplitude *= np.minimum(1.0, MAX_AMPLITUDE_RATIO / np.maximum(np.abs(amplitude), 1e-9))
        power = np.abs(amplitude.sum(axis=0)) ** 2 / stretches
        is_real = 2 * harmonics == frames  # at half the frame rate there is no phase
        statistic = np.where(is_real, power / of_real, 2 * power / of_complex).sum()
        freedom = np.where(is_real, 1, 2).sum()
        log_p_value = chi2.logsf(statistic, freedom) + np.log(len(searched))
        yield _Candidate(float(log_p_value), frames, "ripple", part)


def _background(
    scores: Float[np.ndarray, " N"],
) -> tuple[Float[np.ndarray, " bins"], Float[np.ndarray, " bins"]]:
    """Compute the background power by frequency, and the frequencies in cycles per frame.

    It is a running median over ln 2 (the mean of an exponential): spectral lines do not raise it.
    """
    power = np.abs(np.fft.rfft(scores)) ** 2 / len(scores)
    width = max(15, len(scores) // 40) | 1
    usual = median_filter(power, width, mode="nearest") / np.log(2)
    return np.maximum(usual, 1e-9), np.fft.rfftfreq(len(scores))


@cache
def _cut_power() -> tuple[float, float]:
    """Compute the mean square of a clipped standard normal, real and complex."""
    inside = chi2.cdf(MAX_AMPLITUDE_RATIO**2, 3)  # the integral of x^2 below the cut
    return float(inside + MAX_AMPLITUDE_RATIO**2 * chi2.sf(MAX_AMPLITUDE_RATIO**2, 1)), float(
        -np.expm1(-(MAX_AMPLITUDE_RATIO**2))
    )


def _fold_by_period(values: Float[np.ndarray, " N"], frames: int) -> Float[np.ndarray, " frames"]:
    whole = len(values) // frames
    return values[: whole * frames].reshape(whole, frames).mean(axis=0)


def mean_jerk_by_frame_of_period(
    jerk: Float[np.ndarray, " N"], period_frames: int
) -> Float[np.ndarray, " period_frames"]:
    """Compute the mean jerk at each frame of a period; NaN where there is none.

    A third difference over frames i to i + 3 is counted at frame i + 2, the first frame after its
    middle: a jump between frames f - 1 and f is highest at phase f.
    """
    phase = (np.arange(len(jerk)) + 2) % period_frames
    count = np.bincount(phase, minlength=period_frames)
    total = np.bincount(phase, weights=jerk, minlength=period_frames)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _shortest(frames: int, folded: Float[np.ndarray, " frames"]) -> int:
    """Return the shortest divisor that explains a period: a period of 7 frames shows at 14 too."""
    for shorter in (d for d in range(MIN_PERIOD, frames) if frames % d == 0):
        explained = _fold_by_period(folded, shorter)
        if (frames // shorter) * (explained**2).sum() > MIN_DIVISOR_POWER_SHARE * (folded**2).sum():
            return shorter
    return frames


def _described(chosen: _Candidate, jerk: Float[np.ndarray, " N"]) -> JerkPeriod:
    folded = mean_jerk_by_frame_of_period(jerk, chosen.frames)
    phase = int(folded.argmax())
    entries = np.arange((phase - 2) % chosen.frames, len(jerk), chosen.frames)
    worst = entries[np.argsort(-jerk[entries])][:WORST]
    return JerkPeriod(
        frames=chosen.frames,
        kind=chosen.kind,
        part=chosen.part,
        frame_in_period=phase,
        periods=len(jerk) // chosen.frames,
        peak_over_median=float(folded[phase] / max(float(np.median(folded)), STILL_M_S3)),
        peak_over_minimum=float(folded[phase] / max(float(folded.min()), STILL_M_S3)),
        p_value=float(np.exp(chosen.log_p_value) * len(PARTS)),
        worst_frames=tuple(int(entry) + 2 for entry in worst),
    )


def seam_jerk_ratio(jerk: Float[np.ndarray, " N"], window_advance: int, overlap: int) -> float:
    """Compute peak jerk around window seams over peak jerk of equally long stretches elsewhere.

    At 1, seams do not differ from the rest. A seam is the first frame of every window but the
    first, where the frames that two windows share start. Its stretch holds every third difference
    that touches frames ``join - 1`` to ``join + overlap``: a pop shows wherever in the shared
    frames it sits. NaN without a whole seam or without a stretch clear of seams. Entry i of
    ``jerk`` is over frames i to i + 3, averaged over points (m/s³).
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
    """Frame of a window with the highest jerk, window after window."""

    frame_in_period: int | None
    """Frame in the window with the highest jerk; None if there are too few windows."""
    windows: int
    """Number of whole windows in the medians."""
    ratio: float
    """Median over windows of the jerk at that frame, over the median of all frames."""
    p_value: float = 1.0
    """P-value of that peak, Bonferroni-corrected for the frames of a window; 1 if not tested."""


def recurring_jerk(jerk: Float[np.ndarray, " N"], window_advance: int) -> RecurringJerk:
    """Find the peak of the mean jerk by medians, so that no single jump can cause it.

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
    phase, p_value, scores = int(medians.argmax()), 1.0, _scores(jerk)
    if len(jerk) >= MIN_PERIODS * window_advance and scores.any():
        whole = np.sqrt(len(scores) // window_advance)
        deviations = _fold_by_period(scores, window_advance).max() * whole / scores.std()
        p_value = float(min(1.0, window_advance * norm.sf(deviations)))
    return RecurringJerk(phase, num_windows, float(medians[phase] / usual), p_value)


@dataclass(frozen=True)
class SeamMetrics:
    """Metrics of window seams, or of the detected period if the windows are unknown."""

    seam_jerk_ratio: float
    jerk_by_frame_in_period_m_s3: Float[np.ndarray, " window_advance"]
    """Mean jerk by frame of the window or period (m/s³); empty without both."""
    recurring_jerk: RecurringJerk
    fold_period_frames: int | None = None
    """Frames from one window, or period, to the next."""
    period: JerkPeriod | None = None
    """Period detected in the unfiltered motion, with known windows or without."""


def seam_metrics(
    tracks: Tracks, windows: Windowing | None, period: JerkPeriod | None
) -> SeamMetrics:
    """Compute the metrics of seams on windows, or of a period, which may start anywhere."""
    if windows is not None:
        jerk = derivative_magnitudes(tracks.joints, 3).mean(axis=1)
        return SeamMetrics(
            seam_jerk_ratio(jerk, windows.advance, windows.overlap),
            mean_jerk_by_frame_of_period(jerk, windows.advance),
            recurring_jerk(jerk, windows.advance),
            windows.advance,
            period,
        )
    unknown = RecurringJerk(None, 0, math.nan)
    if period is None:
        return SeamMetrics(math.nan, np.empty(0), unknown)
    folded = mean_jerk_by_frame_of_period(_part_jerk(tracks, period.part), period.frames)
    return SeamMetrics(math.nan, folded, unknown, period.frames, period)
