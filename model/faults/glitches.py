"""Detectors of wrong frames and frame rates, noise and recurring jerk, and of time shifts.

They also detect a motion that is the reference, or that is late or early against it or the speech.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Float

from conventions.joints import JOINT_NAMES, UPPER_BODY
from conventions.names import join_names
from conventions.rates import FPS
from model.faults.analysis import (
    BODY,
    UPPER_AND_HANDS,
    AnalysedMotion,
    Finding,
    format_time,
    longest_true_ranges,
)
from model.metrics.face import correlation
from model.motion.tracks import point_label

NOISE_DEG = 0.4
"""Largest `joint_rotation_noise_deg`; clean: at most 0.26. Noise of 0.01 rad shows as 0.58."""
HARDLY_VISIBLE_NOISE_DEG = 0.6
"""Noise up to which the sentence calls it hardly visible; the severity starts here."""
NAMED = 3
POP_DEG = 17.0
"""Distance of one frame from both its neighbours, beyond twice their own distance; clean: 6.6."""
SNAP_DEG = 30.0
"""Turn of a joint in one step, beyond twice the steps before and after; recorded clips: at most 7.1
and 15.3, hence `SNAP_SPAN`."""
SNAP_SPAN = 2.2
COPY_DEG_S = 0.3
"""Speed of the fastest joint below which a frame is a copy; clean: over 1."""
MIN_DUPLICATES = 2
MIN_TURN_DEG_S = 3.0
"""Mean angular speed around a frame below which nothing is concluded from it."""
SKIP_RATIO, MIN_SKIP_COSINE = (1.6, 2.6), 0.9
"""Limits for a missing frame: a step's ratio to those around it, along them, and cosine to them."""
MIN_SKIPS, FRAMES_A_SKIP = 3, 300
"""Least skips, and most frames per skip, that are reported: people skip in 2 of 1,876 frames."""
MIN_RAD_S = 1e-3
MAX_ALTERNATING_RATIO = 0.35
"""Median change of speed at the quieter of every two frames, over that at the other. Frames
interpolated between others change no speed."""


def rotation_noise(analysed: AnalysedMotion) -> Iterator[Finding]:
    metrics = analysed.metrics
    measured = metrics.rotations.joint_rotation_noise_deg.tolist()
    noise = {
        name: value for name, value in zip(JOINT_NAMES, measured, strict=True) if value > NOISE_DEG
    }
    if not noise:
        return
    worst = sorted(noise, key=lambda name: -noise[name])[:NAMED]
    named = join_names([f"{point_label(name)} ({noise[name]:.1f}°)" for name in worst])
    if len(noise) > len(worst):
        where = f"{len(noise)} of the {len(JOINT_NAMES)} joints, strongest in the {named}"
    else:
        where = f"the {named}"
    little = ", hardly visible" if noise[worst[0]] <= HARDLY_VISIBLE_NOISE_DEG else ""
    message = f"Rotation noise{little}, in {where} (recorded clips: under 0.3°)."
    numbers: dict[str, Any] = {"noise_deg": noise}
    attribution = metrics.point.tip_jerk_attribution
    shares = dict(zip(attribution.joints, np.nan_to_num(attribution.share).tolist(), strict=True))
    blamed = max(shares, key=lambda name: shares[name], default=None)
    if blamed in noise and shares[blamed] > 0.1:
        numbers |= {"attributed_joint": blamed, "attributed_share": shares[blamed]}
        message += (
            f" Filtering the {point_label(blamed)} alone reduces the jerk of the "
            f"{point_label(analysed.point)} by {100 * shares[blamed]:.0f} %."
        )
    limit_ratio = max(1.0, noise[worst[0]] / HARDLY_VISIBLE_NOISE_DEG)
    yield Finding(message, numbers, limit_ratio=limit_ratio)


def single_frame_pops(analysed: AnalysedMotion) -> Iterator[Finding]:
    """Detect single frames far from both their neighbours, which are near each other."""
    if len(analysed.angular_velocity_rad_s) < 2:
        return
    before, after = analysed.angular_velocity_rad_s[:-1], analysed.angular_velocity_rad_s[1:]
    off = np.linalg.norm(before - after, axis=-1) / 2
    across = np.linalg.norm(before + after, axis=-1)
    beyond = np.degrees(off - 2 * across)[:, list(BODY)] / FPS
    is_pop = beyond > POP_DEG
    if not is_pop.any():
        return
    frame, joint = np.unravel_index(beyond.argmax(), beyond.shape)
    frames = np.flatnonzero(is_pop.any(axis=1)) + 1
    name = JOINT_NAMES[BODY[joint]]
    degrees = float(np.degrees(off[frame, BODY[joint]]) / FPS)
    count = f"{len(frames)} frames" if len(frames) > 1 else "one frame"
    yield Finding(
        f"In {count} a joint jumps away and back; the largest jump is {degrees:.0f}° "
        f"({point_label(name)}, at {format_time(int(frame) + 1)}).",
        {"frames_popping": len(frames), "joint": name, "pop_deg": degrees},
        limit_ratio=float(beyond.max() / POP_DEG),
        worst_frame=int(frame) + 1,
        frame_ranges=tuple((int(each), int(each)) for each in frames[:20]),
    )


def joint_snaps(analysed: AnalysedMotion) -> Iterator[Finding]:
    """Detect joints that jump to another angle from one frame to the next, and stay there."""
    if len(analysed.angular_velocity_rad_s) < 3:
        return
    steps = analysed.angular_speed_deg_s[:, list(BODY)] / FPS
    beside = np.pad(steps, ((1, 1), (0, 0)))
    beyond = steps - 2 * np.maximum(beside[:-2], beside[2:])
    is_snap = (beyond > SNAP_DEG).any(axis=1)
    if not is_snap.any():
        return
    at, joint = np.unravel_index(beyond.argmax(), beyond.shape)
    frames = np.flatnonzero(is_snap) + 1
    name = JOINT_NAMES[BODY[joint]]
    count = f"{len(frames)} times" if len(frames) > 1 else "once"
    yield Finding(
        f"A joint jumps to another angle within one frame, {count}; the largest jump is "
        f"{steps[at, joint]:.0f}° ({point_label(name)}, at {format_time(int(at) + 1)}).",
        {"snaps": len(frames), "joint": name, "snap_deg": float(steps[at, joint])},
        limit_ratio=float(beyond.max() / SNAP_DEG),
        max_ratio_between_clips=SNAP_SPAN,
        worst_frame=int(at) + 1,
        frame_ranges=tuple((int(each), int(each)) for each in frames[:20]),
    )


def duplicate_frames(analysed: AnalysedMotion) -> Iterator[Finding]:
    """Detect frames that are copies of the one before while the body moves."""
    fastest = analysed.angular_speed_deg_s[:, list(BODY)].max(axis=1, initial=0.0)
    if len(fastest) < 3:
        return
    mean = analysed.angular_speed_deg_s[:, list(UPPER_AND_HANDS)].mean(axis=1)
    moves = np.maximum(np.roll(mean, 1), np.roll(mean, -1)) > MIN_TURN_DEG_S
    is_copy = (fastest < COPY_DEG_S) & moves
    is_copy[:1] = is_copy[-1:] = False  # clips are often filled up at their ends
    frames = np.flatnonzero(is_copy) + 1
    if len(frames) < MIN_DUPLICATES:
        return
    share = len(frames) / analysed.num_frames
    yield Finding(
        f"{len(frames)} frames ({100 * share:.1f} %) repeat the previous frame, first at "
        f"{format_time(int(frames[0]))}.",
        {"copies": len(frames), "share": share},
        "recorded clips: none",
        limit_ratio=len(frames) / MIN_DUPLICATES,
        worst_frame=int(frames[0]),
        frame_ranges=longest_true_ranges(np.concatenate([[False], is_copy])),
    )


def skipped_frames(analysed: AnalysedMotion) -> Iterator[Finding]:
    """Detect steps twice as long as those around them, in all joints and the same direction."""
    turning = analysed.angular_velocity_rad_s[:, list(UPPER_AND_HANDS)]
    if len(turning) < 3:
        return
    steps = turning.reshape(len(turning), -1)
    around = (steps[:-2] + steps[2:]) / 2
    middle = steps[1:-1]
    usual, length = np.linalg.norm(around, axis=1), np.linalg.norm(middle, axis=1)
    along = (middle * around).sum(axis=1)
    moves = (
        analysed.angular_speed_deg_s[1:-1, list(UPPER_AND_HANDS)].mean(axis=1) > 2 * MIN_TURN_DEG_S
    )
    is_onward = (steps[:-2] * steps[2:]).sum(axis=1) > 0.0
    ratio = along / np.maximum(usual**2, 1e-12)
    cosine = along / np.maximum(usual * length, 1e-12)
    is_skip = moves & (ratio > SKIP_RATIO[0]) & (ratio < SKIP_RATIO[1])
    is_skip &= is_onward & (cosine > MIN_SKIP_COSINE)
    frames = np.flatnonzero(is_skip) + 2
    usual_skips = max(MIN_SKIPS, analysed.num_frames / FRAMES_A_SKIP)
    if len(frames) < usual_skips:
        return
    yield Finding(
        f"Frames seem to be missing in {len(frames)} places: there the whole body moves about "
        "twice as far in one frame as in the frames before and after, first at "
        f"{format_time(int(frames[0]))}.",
        {"skips": len(frames)},
        limit_ratio=len(frames) / usual_skips,
        worst_frame=int(frames[0]),
        frame_ranges=tuple((int(each) - 1, int(each)) for each in frames[:20]),
    )


def upsampled_rate(analysed: AnalysedMotion) -> Iterator[Finding]:
    """Detect motion of 15 fps stretched to 30: every second frame lies between its neighbours."""
    turning = analysed.angular_velocity_rad_s[:, list(BODY)]
    if len(turning) <= FPS:
        return
    change = np.linalg.norm(np.diff(turning, axis=0), axis=-1).mean(axis=1)
    ratio = min(
        _alternating_ratio(change),
        _alternating_ratio(np.linalg.norm(turning, axis=-1).mean(axis=1)),
    )
    if not ratio < MAX_ALTERNATING_RATIO:
        return
    yield Finding(
        "Every second frame is interpolated or repeated: the motion seems to have been upsampled "
        f"to 30 fps from 15 fps or less (in these frames, the median angular speed or acceleration "
        f"is {100 * ratio:.0f} % of that of the other frames). It cannot contain jitter above 7.5 "
        "Hz.",
        {"change_ratio": ratio},
        limit_ratio=MAX_ALTERNATING_RATIO / max(ratio, 0.01),
    )


def _alternating_ratio(track: Float[np.ndarray, " N"]) -> float:
    """Return the quieter half's median over the other's, of every two; 1 if all is still."""
    medians = sorted(float(np.median(track[start::2])) for start in (0, 1))
    return medians[0] / medians[1] if medians[1] > MIN_RAD_S else 1.0


SEAM_CHANCE = 1e-3
"""Largest p-value of `recurring_jerk`; clean: at least 0.0026 in 3,540 clips or parts of 10 s."""


def window_seams(analysed: AnalysedMotion) -> Iterator[Finding]:
    jerk = analysed.metrics.seams.recurring_jerk
    advance = analysed.metrics.seams.fold_period_frames
    if advance is None or jerk.frame_in_period is None or jerk.p_value > SEAM_CHANCE:
        return
    joins = range(jerk.frame_in_period, analysed.num_frames, advance)
    yield Finding(
        f"The body jumps every {advance} frames ({advance / FPS:.2f} s): at frame "
        f"{jerk.frame_in_period} of each window, the jerk is {jerk.ratio:.1f} times the median.",
        {
            "window_advance_frames": advance,
            "frame_in_period": jerk.frame_in_period,
            "jerk_ratio": jerk.ratio,
        },
        limit_ratio=jerk.ratio,
        worst_frame=joins[len(joins) // 2],
        frame_ranges=tuple((frame, frame) for frame in joins[:20]),
    )


def other_periodic_jerk(analysed: AnalysedMotion) -> Iterator[Finding]:
    """Detect jerk that recurs after another number of frames than the known windows."""
    measured = analysed.metrics.seams
    period, windows = measured.period, measured.fold_period_frames
    if period is None or (windows != period.frames and windows and period.frames % windows == 0):
        return
    if windows == period.frames and any(window_seams(analysed)):
        return
    if period.kind == "pulses":
        peak = (
            f"at frame {period.frame_in_period} of each period, it is "
            f"{period.peak_over_median:.1f} times the median"
        )
    else:
        peak = (
            f"the highest jerk within the period is {period.peak_over_minimum:.1f} times the lowest"
        )
    yield Finding(
        f"The jerk of the {period.part} peaks every {period.frames} frames "
        f"({period.frames / FPS:.2f} s), as is typical of window seams or latent-code boundaries: "
        f"{peak}.",
        {
            "period_frames": period.frames,
            "part": period.part,
            "frame_in_period": period.frame_in_period,
            "peak_over_median": period.peak_over_median,
            "peak_over_minimum": period.peak_over_minimum,
            "p_value": period.p_value,
        },
        limit_ratio=period.peak_over_median,
        worst_frame=period.worst_frames[0],
        frame_ranges=tuple((frame, frame) for frame in period.worst_frames),
    )


SAME_RAD = 1e-5
MOST_LAG_FRAMES = 3 * FPS
MIN_LAG_FRAMES = 3
COPY_CORRELATION = 0.85
"""Correlation of upper body speeds at the best lag; a copy has 1."""
MIN_SPEECH_LAG_FRAMES = 4
"""Smallest lag that is reported (frames); clean: faces are within a frame of the sound."""
_MIN_FRAMES = 10 * FPS


def identical_to_reference(analysed: AnalysedMotion) -> Iterator[Finding]:
    if analysed.reference is None:
        return
    own, theirs = analysed.motion, analysed.reference.motion
    apart = np.abs(own.poses - theirs.poses).reshape(-1, 55, 3)[:, list(BODY)]
    if apart.max() > SAME_RAD or np.abs(own.trans - theirs.trans).max() > SAME_RAD:
        return
    yield Finding(
        "This motion is identical to the reference in every frame.",
        {"largest_difference_rad": float(apart.max())},
    )


def shifted_copy_of_reference(analysed: AnalysedMotion) -> Iterator[Finding]:
    """Detect the reference's movement, earlier or later."""
    if analysed.reference is None or analysed.num_frames < _MIN_FRAMES:
        return
    own, theirs = (
        each.angular_speed_deg_s[:, list(UPPER_BODY)].mean(axis=1)
        for each in (analysed, analysed.reference)
    )
    lags = range(-MOST_LAG_FRAMES, MOST_LAG_FRAMES + 1)
    best, lag = max((correlation(own, theirs, lag), lag) for lag in lags)
    if abs(lag) < MIN_LAG_FRAMES or best < COPY_CORRELATION:
        return
    yield Finding(
        f"This motion seems to be a copy of the reference, {abs(lag) / FPS:.2f} s "
        f"{'later' if lag > 0 else 'earlier'}: when shifted back by this time, its joint speeds "
        f"correlate with those of the reference at r = {best:.2f}.",
        {"against": "reference", "lag_frames": lag, "correlation": best},
        limit_ratio=abs(lag) / MIN_LAG_FRAMES,
    )


def speech_lag_or_drift(analysed: AnalysedMotion) -> Iterator[Finding]:
    """Detect motion that is late or early against the speech, constantly or increasingly."""
    lag = analysed.metrics.lag
    if lag is None or not lag.is_detected:
        return
    is_apart = min(abs(lag.lag_low_s), abs(lag.lag_high_s)) * FPS >= MIN_SPEECH_LAG_FRAMES - 0.5
    if not lag.lag_drift_s and not (is_apart and lag.lag_low_s * lag.lag_high_s > 0):
        return
    numbers = {"against": "speech", "lag_frames": round(lag.lag_s * FPS), **vars(lag)}
    if not lag.lag_drift_s:
        most_s = lag.lag_s
        sentence = (
            f"The {lag.lag_source} moves {_format_lag(lag.lag_s)} relative to the speech (95 % "
            f"confidence interval {lag.lag_low_s:.2f} to {lag.lag_high_s:.2f} s). Correct it with "
            f"the import setting lag={lag.lag_s:.2f} (on the command line: --assume)."
        )
    else:
        most_s = lag.lag_drift_s
        start, end = (lag.lag_s + sign * lag.lag_drift_s / 2 for sign in (-1, 1))
        sentence = (
            f"The {lag.lag_source} drifts relative to the speech, from {_format_lag(start)} at the "
            f"start to {_format_lag(end)} at the end, as if {lag.lag_corrected_fps:.4g} fps were "
            f"read as {FPS} fps. Correct it with the import setting "
            f"rate={lag.lag_corrected_fps:.4g} (on the command line: --assume)."
        )
    limit_ratio = abs(most_s) * FPS / MIN_SPEECH_LAG_FRAMES
    yield Finding(sentence, numbers, limit_ratio=limit_ratio)


def _format_lag(lag_s: float) -> str:
    return f"{abs(lag_s):.2f} s {'late' if lag_s > 0 else 'early'}"
