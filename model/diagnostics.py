"""Where the jitter sits: the numbers of ``diagnostics.json`` for a set of motions.

The keys are a public format, documented in ``docs/formats.md``. Jitter is always measured raw and
once more behind one and the same filter, the official GlobalDiff inference's (Savitzky-Golay,
7 frames, order 2), here applied to the stitched sequence.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64
from scipy.signal import savgol_filter

from model import smoothness
from model.kinematics import fingertip_positions, joint_positions_from_local
from model.motion import Motion
from model.rotations import (
    axis_angle_from_matrix,
    matrix_from_axis_angle,
    matrix_from_rot6d,
    rot6d_from_matrix,
)
from model.skeleton import (
    FINGERTIP_NAMES,
    JOINT_DEPTH,
    JOINT_INDEX,
    JOINT_NAMES,
    NUM_JOINTS,
    RestSkeleton,
)
from model.timing import FPS

SAVGOL_FRAMES = 7
SAVGOL_ORDER = 2
HIGH_FREQUENCY_HZ = 5.0
WINDOW_ADVANCE = 52
"""Frames from one generated window to the next: 60 less the 8 they share."""
WINDOW_OVERLAP = 8
TIP = "right_middle"
"""The fingertip of the paper's Figure 6."""

_CHUNK_FRAMES = 512
_FEET = [JOINT_INDEX["left_foot"], JOINT_INDEX["right_foot"]]

Measures = dict[str, Any]
TipTrack = Callable[[Motion], Float[np.ndarray, "T 3"]]


@dataclass(frozen=True, eq=False)
class Tracks:
    """Positions over time in metres, in the world."""

    joints: Float64[np.ndarray, "T 55 3"]
    fingertips: Float64[np.ndarray, "T 10 3"]
    """In the order of `FINGERTIP_NAMES`."""


def track_points(motion: Motion, skeleton: RestSkeleton) -> Tracks:
    """Joints and rigid fingertips of every frame, in double precision."""
    joints, tips = [], []
    for start in range(0, motion.num_frames, _CHUNK_FRAMES):
        frames = slice(start, start + _CHUNK_FRAMES)
        poses = torch.tensor(motion.poses[frames], dtype=torch.float64)
        transl = torch.tensor(motion.trans[frames], dtype=torch.float64)
        local_rot = matrix_from_axis_angle(poses.unflatten(-1, (NUM_JOINTS, 3)))
        global_rot, positions = joint_positions_from_local(local_rot, skeleton, transl)
        joints.append(positions.numpy())
        tips.append(fingertip_positions(global_rot, positions, skeleton).numpy())
    return Tracks(joints=np.concatenate(joints), fingertips=np.concatenate(tips))


def smooth_motion(motion: Motion) -> Motion:
    """The motion behind the Savitzky-Golay filter of the official inference (7 frames, order 2).

    It filters the row-6D form of each local rotation (then restores a rotation), the translation
    and the expressions, over the whole sequence. Under 5 frames it changes nothing; under 7 it uses
    5.
    """
    window = min(SAVGOL_FRAMES, motion.num_frames - 1 + motion.num_frames % 2)
    if window <= SAVGOL_ORDER + 1:
        return motion
    poses = np.empty_like(motion.poses)
    for joint in range(NUM_JOINTS):  # one at a time: memory stays small for long clips
        columns = slice(3 * joint, 3 * joint + 3)
        axis_angle = torch.tensor(motion.poses[:, columns], dtype=torch.float64)
        rot6d = rot6d_from_matrix(matrix_from_axis_angle(axis_angle)).numpy()
        smooth = torch.from_numpy(savgol_filter(rot6d, window, SAVGOL_ORDER, axis=0))
        poses[:, columns] = axis_angle_from_matrix(matrix_from_rot6d(smooth)).numpy()

    def filtered(values: Float32[np.ndarray, "T C"]) -> Float32[np.ndarray, "T C"]:
        smooth = savgol_filter(values.astype(np.float64), window, SAVGOL_ORDER, axis=0)
        return np.asarray(smooth, dtype=np.float32)

    return replace(
        motion,
        poses=poses,
        trans=filtered(motion.trans),
        expressions=filtered(motion.expressions),
    )


def measures(
    motion: Motion,
    skeleton: RestSkeleton,
    tip: str = TIP,
    window_advance: int = WINDOW_ADVANCE,
    window_overlap: int = WINDOW_OVERLAP,
    tip_track: TipTrack | None = None,
) -> Measures:
    """The numbers of one motion as it is; None where the clip is too short to have one.

    Args:
        tip: one of `FINGERTIP_NAMES`.
        window_advance: frames from one generated window to the next, for the seams.
        window_overlap: frames that two windows share.
        tip_track: gives the tip's positions in metres, for example of a body's tip vertex, in
            place of the rigid fingertip.
    """
    tracks = track_points(motion, skeleton)
    if tip_track is None:
        tip_positions = tracks.fingertips[:, FINGERTIP_NAMES.index(tip)]
    else:
        tip_positions = np.asarray(tip_track(motion), dtype=np.float64)
    joint_jerk = smoothness.mean_over_time(smoothness.derivative_magnitudes(tracks.joints, 3))

    def tip_mean(order: int) -> float:
        values = smoothness.derivative_magnitudes(tip_positions, order)
        return float(smoothness.mean_over_time(values))

    tip_speeds = smoothness.derivative_magnitudes(tracks.fingertips, 1)
    numbers: Measures = {
        "tip_jerk_m_s3": tip_mean(3),
        "tip_acceleration_m_s2": tip_mean(2),
        "tip_path_m_s": tip_mean(1),
        "tip_velocity_power_above_5hz": smoothness.velocity_power_above(
            tip_positions, HIGH_FREQUENCY_HZ
        ),
        "fingertips_path_m_s": smoothness.mean_over_time(tip_speeds).tolist(),
        "seam_jerk_ratio": smoothness.seam_jerk_ratio(
            tracks.joints, window_advance, window_overlap
        ),
        "jerk_by_window_phase_m_s3": smoothness.jerk_by_window_phase(
            tracks.joints, window_advance
        ).tolist(),
        "foot_slide_m_s": smoothness.foot_slide(tracks.joints[:, _FEET]),
        "joint_jerk_m_s3": joint_jerk.tolist(),
        "jerk_by_depth_m_s3": _mean_by_depth(joint_jerk),
    }
    return {name: _without_nan(value) for name, value in numbers.items()}


def diagnose(
    motions: Mapping[str, Motion],
    skeleton: RestSkeleton,
    reference: Motion | None = None,
    window_advance: int = WINDOW_ADVANCE,
    window_overlap: int = WINDOW_OVERLAP,
    tip: str = TIP,
    tip_track: TipTrack | None = None,
    tip_source: str = "rigid",
) -> dict[str, Any]:
    """The content of ``diagnostics.json``: each motion and the reference, raw and filtered.

    With a reference everything is measured over the same frames: all are cut to the shortest, and
    ``notes`` says so. Without one each motion is measured whole.

    Args:
        motions: by the name that the file shall give them.
        tip_source: what ``tip_track`` follows, such as 'vertex 7794'.

    Raises:
        ValueError: if ``tip`` is no fingertip.
    """
    if tip not in FINGERTIP_NAMES:
        raise ValueError(f"{tip} is no fingertip; choose one of {', '.join(FINGERTIP_NAMES)}.")
    motions, reference, notes = _cut_alike(motions, reference)

    def both(motion: Motion) -> dict[str, Measures]:
        def of(version: Motion) -> Measures:
            return measures(version, skeleton, tip, window_advance, window_overlap, tip_track)

        return {"raw": of(motion), "savgol": of(smooth_motion(motion))}

    return {
        "fps": FPS,
        "tip": tip,
        "tip_source": tip_source,
        "window_advance_frames": window_advance,
        "window_overlap_frames": window_overlap,
        "joint_names": list(JOINT_NAMES),
        "fingertip_names": list(FINGERTIP_NAMES),
        "num_frames": {name: motion.num_frames for name, motion in motions.items()},
        "notes": notes,
        "reference": None if reference is None else both(reference),
        "systems": {name: both(motion) for name, motion in motions.items()},
    }


def _cut_alike(
    motions: Mapping[str, Motion], reference: Motion | None
) -> tuple[dict[str, Motion], Motion | None, list[str]]:
    if reference is None or not motions:
        return dict(motions), reference, []
    named = {**motions, "The reference": reference}
    shortest = min(motion.num_frames for motion in named.values())
    notes = [
        f"{name} has {motion.num_frames} frames; the first {shortest} were measured, as many as "
        "the shortest motion has."
        for name, motion in named.items()
        if motion.num_frames > shortest
    ]
    return (
        {name: first_frames(motion, shortest) for name, motion in motions.items()},
        first_frames(reference, shortest),
        notes,
    )


def first_frames(motion: Motion, num_frames: int) -> Motion:
    """The start of a motion."""
    return replace(
        motion,
        poses=motion.poses[:num_frames],
        trans=motion.trans[:num_frames],
        expressions=motion.expressions[:num_frames],
    )


def _mean_by_depth(joint_values: Float64[np.ndarray, " 55"]) -> list[float]:
    """Entry d is the mean over the joints that are d bones away from the pelvis."""
    depth = np.array(JOINT_DEPTH)
    return [float(joint_values[depth == d].mean()) for d in range(max(JOINT_DEPTH) + 1)]


def _without_nan(value: float | list[float]) -> float | list[float | None] | None:
    """JSON knows no NaN: null says that there is no such number."""
    if isinstance(value, list):
        return [number if math.isfinite(number) else None for number in value]
    return value if math.isfinite(value) else None
