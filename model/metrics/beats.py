"""BeatAlign: agreement of motion beats with speech onsets, in both directions, with chance level.

Motion beats are local minima of a joint's speed (in a neighbourhood of 7 frames on either side)
above 0.3 of that joint's mean speed; onsets are detected by librosa at a hop of 512 samples.
EMAGE's direction scores the distance from each onset to the nearest motion beat, before or after
it (sigma 0.3 s; mean over onsets, then over the 13 upper-body joints; a joint without beats scores
0). AsynFusion's direction scores the distance from each motion beat to the nearest onset (here
sigma 0.1 s; the paper names none). Onsets in the first and last 2 s do not count. More beats, and
jitter makes beats, raise the first score: compare with the recorded motion and with chance, never
as "higher is better".

The choice of mean speeds changes every value. Papers on BEAT2 use those published by EMAGE
(`read_mean_speeds`); without them, the reference's or the motion's own are used.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.signal import argrelextrema

from conventions.joints import NUM_JOINTS, UPPER_BODY
from conventions.rates import FPS, SAMPLE_RATE
from model.speech.librosa_cache import load_librosa
from model.storage.npz import MotionError

ONSET_HOP = 512
"""Hop of the onset detection (samples); BeatAlign is defined with it."""
BEAT_JOINTS = list(UPPER_BODY)
MINIMUM_ORDER = 7
SPEED_THRESHOLD = 0.3
SIGMA_AUDIO_TO_MOTION_S = 0.3
SIGMA_MOTION_TO_AUDIO_S = 0.1
MARGIN_S = 2.0
CHANCE_SHIFTS = 20
MAX_SPEEDS_BYTES = 64 * 1024


def speech_onsets(waveform: Float[np.ndarray, " N"]) -> Float[np.ndarray, " onsets"]:
    """Return the times (s) of the onsets; none in silence."""
    return load_librosa().onset.onset_detect(
        y=waveform, sr=SAMPLE_RATE, hop_length=ONSET_HOP, units="time"
    )


def read_mean_speeds(path: Path) -> Float[np.ndarray, " 13"]:
    """Read mean speeds (m/s) of `BEAT_JOINTS` from EMAGE's ``mean_vel_smplxflame_30.npy``.

    The file is in BEAT2's folder ``weights`` and has one number for each of the 55 joints. Raises
    MotionError for any other file.
    """
    try:
        if path.stat().st_size > MAX_SPEEDS_BYTES:
            raise ValueError
        speeds = np.load(path, allow_pickle=False)
        if np.shape(speeds) not in ((NUM_JOINTS,), (NUM_JOINTS, 1), (1, NUM_JOINTS)):
            raise ValueError
        speeds = np.asarray(speeds, dtype=np.float64).reshape(NUM_JOINTS)[BEAT_JOINTS]
        if not (np.isfinite(speeds).all() and speeds.min() > 0.0):
            raise ValueError
    except (OSError, ValueError, EOFError, TypeError) as error:
        raise MotionError(
            f"{path.name} must contain {NUM_JOINTS} positive numbers, the mean speed of each "
            "joint. Use EMAGE's mean_vel_smplxflame_30.npy from the `weights` folder of BEAT2."
        ) from error
    return speeds


def joint_speeds(positions: Float[np.ndarray, "T J 3"]) -> Float[np.ndarray, "T J"]:
    """Compute speeds (m/s) by central differences, one-sided at the ends."""
    return np.linalg.norm(np.gradient(positions, axis=0), axis=-1) * FPS


def motion_beats(
    speeds: Float[np.ndarray, "T J"], mean_speed: Float[np.ndarray, " J"]
) -> list[Float[np.ndarray, " beats"]]:
    """Return times (s) of each joint's beats from its mean speed (m/s) over recorded motion."""
    beats = []
    for speed, mean in zip(speeds.T, mean_speed, strict=True):
        (minima,) = argrelextrema(speed, np.less, order=MINIMUM_ORDER)
        beats.append(minima[speed[minima] > SPEED_THRESHOLD * mean] / FPS)
    return beats


def _nearness(
    times: Float[np.ndarray, " n"], others: Float[np.ndarray, " m"], sigma_s: float
) -> float:
    """Return the mean Gaussian of each time's distance to the nearest other; 0 without any."""
    if not len(times) or not len(others):
        return 0.0
    distance = np.abs(times[:, None] - others).min(axis=1)
    return float(np.exp(-(distance**2) / (2 * sigma_s**2)).mean())


def beat_align_audio_to_motion(
    onsets: Float[np.ndarray, " n"], beats: Sequence[Float[np.ndarray, " _"]]
) -> float:
    """Compute BeatAlign in EMAGE's direction, onsets to motion beats (0 to 1)."""
    return float(np.mean([_nearness(onsets, joint, SIGMA_AUDIO_TO_MOTION_S) for joint in beats]))


def beat_align_motion_to_audio(
    onsets: Float[np.ndarray, " n"], beats: Sequence[Float[np.ndarray, " _"]]
) -> float:
    """Compute BeatAlign in AsynFusion's direction, beats of all joints to onsets (0 to 1)."""
    return _nearness(np.concatenate(list(beats)), onsets, SIGMA_MOTION_TO_AUDIO_S)


def onsets_between_margins(
    onsets: Float[np.ndarray, " n"], duration_s: float
) -> Float[np.ndarray, " m"]:
    """Return the onsets that are further than `MARGIN_S` from both ends."""
    return onsets[(onsets >= MARGIN_S) & (onsets < duration_s - MARGIN_S)]


def upper_body_beats(
    positions: Float[np.ndarray, "T 55 3"], mean_speed: Float[np.ndarray, " 13"]
) -> list[Float[np.ndarray, " beats"]]:
    """Return beat times (s) of each of `BEAT_JOINTS` from pelvis-aligned positions (m)."""
    return motion_beats(joint_speeds(positions[:, BEAT_JOINTS]), mean_speed)


def score_and_shifted_scores(
    score: Callable[[Float[np.ndarray, " n"], Sequence[Float[np.ndarray, " _"]]], float],
    onsets: Float[np.ndarray, " n"],
    beats: Sequence[Float[np.ndarray, " _"]],
    duration_s: float,
) -> tuple[float, Float[np.ndarray, " shifts"]]:
    """Return the score of one direction, and the scores of the circularly shifted onsets."""
    inside = onsets_between_margins(onsets, duration_s)
    return score(inside, beats), np.array([score(s, beats) for s in _shifted(inside, duration_s)])


def beat_scores(
    positions: Float[np.ndarray, "T 55 3"],
    onsets: Float[np.ndarray, " n"],
    mean_speed: Float[np.ndarray, " 13"],
) -> dict[str, float]:
    """Compute the scores of both directions and their mean chance levels (`upper_body_beats`)."""
    beats, scores = upper_body_beats(positions, mean_speed), {}
    for score in (beat_align_audio_to_motion, beat_align_motion_to_audio):
        name = score.__name__
        scores[name], chance = score_and_shifted_scores(score, onsets, beats, len(positions) / FPS)
        scores[f"{name}_chance"] = float(chance.mean())
    return scores


def _shifted(onsets: Float[np.ndarray, " n"], duration_s: float) -> list[Float[np.ndarray, " n"]]:
    """Return circular shifts: they keep the speech's rhythm, not its relation to the motion."""
    length = max(duration_s - 2 * MARGIN_S, 1.0)
    shifts = np.linspace(0, length, CHANCE_SHIFTS + 2)[1:-1]
    return [MARGIN_S + (onsets - MARGIN_S + shift) % length for shift in shifts]
