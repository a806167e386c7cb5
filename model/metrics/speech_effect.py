"""Effect of speech and of noise on a motion, and movement in silence.

Two motions of one system that share the speech but not the noise are similar because of the speech;
two that share the noise but not the speech, because of the noise; two that share neither show the
similarity of any two motions. Similarity is the correlation over time of a track: angular speed of
the arms and the head, raise of the brows, opening of the jaw. The effect of the speech is the first
less the third, that of the noise the second less the third.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy import stats
from scipy.ndimage import gaussian_filter1d

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.metrics.face import blendshape_columns, correlation, head_chest_angular_speed_rad_s
from model.motion.motion import Motion
from model.motion.rotations import axis_angle_from_matrix, matrix_from_axis_angle

SMOOTH_FRAMES = 4.0
"""Deviation of the Gaussian that smooths speeds (frames); shorter than a stroke."""
LEAST_FRAMES = 3 * FPS
"""Shortest motions that are compared (frames)."""
ARMS = [JOINT_INDEX[f"{side}_{j}"] for side in ("left", "right") for j in ("shoulder", "elbow")]

Grid = Mapping[tuple[str, int], Motion]
"""Motions of one system by speech, or in `model.evaluation.classifiers` speaker, and noise seed."""


@dataclass(frozen=True)
class SharedInputCorrelations:
    """Mean correlations of one track over pairs of motions."""

    same_speech: float
    """Mean correlation of motions with the same speech and other noise."""
    same_noise: float
    """Mean correlation of motions with the same noise and other speech."""
    neither: float
    lead_low: float
    """95 % confidence interval of `lead`: Welch's interval over the pairs."""
    lead_high: float

    @property
    def lead(self) -> float:
        """Effect of the speech minus the effect of the noise."""
        return self.same_speech - self.same_noise

    @property
    def by_speech(self) -> float:
        """Increase of the correlation if two motions share the speech."""
        return self.same_speech - self.neither

    @property
    def by_noise(self) -> float:
        """Increase of the correlation if two motions share the noise."""
        return self.same_noise - self.neither


def smoothed_arm_speed_sum_deg_s(motion: Motion) -> Float[np.ndarray, " T1"]:
    """Compute the smoothed sum of the angular speeds of both shoulders and elbows (degrees/s)."""
    return _smooth(angular_speed_sum(motion, ARMS))


def angular_speed_sum(motion: Motion, joints: Sequence[int]) -> Float[np.ndarray, " T1"]:
    """Compute the sum of the angular speeds of joints against their parents (degrees/s)."""
    poses = torch.from_numpy(motion.poses).unflatten(-1, (-1, 3))[:, list(joints)]
    turned = matrix_from_axis_angle(poses)
    steps = axis_angle_from_matrix(turned[:-1].mT @ turned[1:]).norm(dim=-1)
    return np.rad2deg(steps.sum(-1).numpy()) * FPS


def _brows(motion: Motion) -> Float[np.ndarray, " T"] | None:
    if motion.expression_basis != "arkit52":
        return None
    return motion.expressions[:, blendshape_columns("browInnerUp")].mean(1)


def _jaw(motion: Motion) -> Float[np.ndarray, " T"]:
    jaw = 3 * JOINT_INDEX["jaw"]
    return np.linalg.norm(motion.poses[:, jaw : jaw + 3], axis=-1)


TRACK_FUNCTIONS: Mapping[str, Callable[[Motion], np.ndarray | None]] = {
    "arms": smoothed_arm_speed_sum_deg_s,
    "head": lambda motion: _smooth(head_chest_angular_speed_rad_s(motion)),
    "brows": _brows,
    "jaw": _jaw,
}
"""Functions that compute the track of a body part; None if a motion has no such part."""


def track_correlation(one: Float[np.ndarray, " n"], other: Float[np.ndarray, " m"]) -> float:
    """Compute the correlation over the frames that both tracks have; 0 if one is constant."""
    frames = min(len(one), len(other))
    return correlation(one[:frames], other[:frames])


def arm_axis_angle_correlation(one: Motion, other: Motion) -> float:
    """Compute the mean correlation of the 12 axis-angle components of shoulders and elbows."""
    columns = [3 * joint + k for joint in ARMS for k in range(3)]
    pairs = zip(one.poses[:, columns].T, other.poses[:, columns].T, strict=True)
    return float(np.mean([track_correlation(*pair) for pair in pairs]))


def arm_rotation_correlation_same_noise(motions: Grid) -> float:
    """Average `arm_axis_angle_correlation` over all pairs with the same noise and other speech."""
    alike = [
        arm_axis_angle_correlation(one, other)
        for ((speech, seed), one), ((speech_, seed_), other) in combinations(motions.items(), 2)
        if seed == seed_ and speech != speech_
    ]
    return float(np.mean(alike))


def speech_and_noise_shares(motions: Grid) -> dict[str, SharedInputCorrelations]:
    """Compute for each body part how far speech and noise determine the motion.

    Raises ValueError unless there are two or more speeches, each with the same two or more seeds,
    and each motion lasts `LEAST_FRAMES` or longer.
    """
    speeches, seeds = (sorted({key[k] for key in motions}) for k in (0, 1))
    if len(speeches) < 2 or len(seeds) < 2 or len(motions) != len(speeches) * len(seeds):
        raise ValueError(
            "At least two speech recordings and two noise seeds are needed, with one motion for "
            f"each combination; there are {len(motions)} motions, {len(speeches)} recordings and "
            f"{len(seeds)} seeds."
        )
    shortest = min(motion.num_frames for motion in motions.values())
    if shortest < LEAST_FRAMES:
        raise ValueError(
            f"Each motion must last at least {LEAST_FRAMES / FPS:g} s; the shortest lasts "
            f"{shortest / FPS:.1f} s."
        )
    shares = {}
    for part, track_of in TRACK_FUNCTIONS.items():
        tracks = [(key, track_of(motion)) for key, motion in motions.items()]
        available = [(key, track) for key, track in tracks if track is not None]
        if len(available) == len(tracks):
            shares[part] = _decided(available)
    return shares


def _decided(
    tracks: Sequence[tuple[tuple[str, int], Float[np.ndarray, " _"]]],
) -> SharedInputCorrelations:
    by_sharing: dict[tuple[bool, bool], list[float]] = {}
    for ((speech, seed), one), ((speech_, seed_), other) in combinations(tracks, 2):
        by_sharing.setdefault((speech == speech_, seed == seed_), []).append(
            track_correlation(one, other)
        )
    same_speech, same_noise = by_sharing[True, False], by_sharing[False, True]
    low, high = _difference_limits(same_speech, same_noise)
    neither = float(np.mean(by_sharing[False, False]))
    return SharedInputCorrelations(
        float(np.mean(same_speech)), float(np.mean(same_noise)), neither, low, high
    )


def _difference_limits(ones: Sequence[float], others: Sequence[float]) -> tuple[float, float]:
    """Compute Welch's 95 % limits of a difference of means; the difference if neither varies."""
    difference = float(np.mean(ones) - np.mean(others))
    errors = [float(np.var(each, ddof=1) / len(each)) for each in (ones, others)]
    if sum(errors) < 1e-12:
        return difference, difference
    freedom = sum(errors) ** 2 / sum(
        error**2 / (len(each) - 1) for error, each in zip(errors, (ones, others), strict=True)
    )
    reach = float(stats.t.ppf(0.975, freedom)) * sum(errors) ** 0.5
    return difference - reach, difference + reach


def _smooth(speed: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    return gaussian_filter1d(np.asarray(speed, np.float64), SMOOTH_FRAMES)


MEASURED_SILENCE_S = 5.0
"""Part of a silence that is measured (s); a shorter pause counts as speech."""
PARTS = {"arms": ARMS, "jaw": [JOINT_INDEX["jaw"]]}


def speech_and_silence_start_masks(
    voiced: Bool[np.ndarray, " T"],
) -> tuple[Bool[np.ndarray, " T"], Bool[np.ndarray, " T"]]:
    """Return the frames of speech, and the first `MEASURED_SILENCE_S` of each silence after it.

    Neither are frames before the first voice, the rest of a silence, and too short an end.
    """
    spoken, silent = np.zeros(len(voiced), bool), np.zeros(len(voiced), bool)
    wanted = round(MEASURED_SILENCE_S * FPS)
    voiced_frames_index = np.flatnonzero(voiced)
    spoken[voiced_frames_index] = True
    for this, following in pairwise([*voiced_frames_index, len(voiced)]):
        if following - this > wanted:
            silent[this + 1 : this + 1 + wanted] = True
        elif following < len(voiced):
            spoken[this:following] = True
    return spoken, silent


def silence_speed_ratio(motion: Motion, voiced: Bool[np.ndarray, " T"]) -> dict[str, float]:
    """Compute ``arms_in_silence`` and ``jaw_in_silence``, ratios of mean angular speeds.

    A ratio is the speed in the silences after speech over that during speech; 0 if all rests.
    ``voiced`` says from the motion's first frame on whether there is a voice. Empty if there is no
    such silence; without a part that does not even move during speech.
    """
    frames = min(motion.num_frames, len(voiced))
    spoken, silent = speech_and_silence_start_masks(voiced[:frames])
    if not silent.any():
        return {}
    ratios = {}
    for part, joints in PARTS.items():
        speed = angular_speed_sum(motion, joints)[: frames - 1]
        speaking = speed[spoken[1:]].mean()
        if speaking > 0:
            ratios[f"{part}_in_silence"] = float(speed[silent[1:]].mean() / speaking)
    return ratios
