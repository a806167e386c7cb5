"""MotionDraft of a motion, conversion of rotations and joint sets to axis-angle, and resampling."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, Num, Shaped
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from conventions.joints import HANDS, JOINT_INDEX, NUM_JOINTS, PARENTS
from conventions.rates import FPS
from model.formats.reading import COMMON_FRAME_RATES, Assumption, Confidence, Kind, Part, Rotations
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import NUM_BETAS, NUM_EXPRESSIONS, ExpressionBasis, Motion
from model.motion.rotations import axis_angle_from_matrix, matrix_from_rot6d
from model.motion.transforms import change_motion_speed
from model.storage.npz import MotionError

ROTATION_FORMATS: dict[int, tuple[Rotations, ...]] = {
    3: ("axis-angle",),
    6: ("6d", "6d-columns", "6d-interleaved"),
    4: ("quaternion-wxyz", "quaternion-xyzw"),
    9: ("matrix",),
}
"""Rotation formats by the number of values per joint."""
BODY = tuple(range(22))
JOINTS_BY_COUNT: dict[int, tuple[int, ...]] = {
    55: tuple(range(55)),
    52: (*BODY, *HANDS),
    53: (*BODY, JOINT_INDEX["jaw"], *HANDS),
    24: BODY,
    22: BODY,
}
"""Our joints by the number in a file; SMPL's last two of 24, hands without fingers, are ignored."""
SET_NAMES = {55: "SMPL-X", 52: "SMPL-H", 53: "SMPL-H and the jaw", 24: "SMPL", 22: "SMPL's body"}
MAX_RADIANS = 4 * np.pi
"""Largest plausible angle, two full turns; above it, angles are in degrees."""
_INTERLEAVED_6D = [0, 2, 4, 1, 3, 5]
"""Column order that separates two interleaved axes."""


HandReferencePrior = Literal["usually mean", "unknown", "flat"]
"""Hands of a layout before their motion is looked at: usually offsets from the mean hand pose,
unknown, or known to be relative to the flat hand."""


@dataclass
class MotionDraft:
    """A motion that is being read: the file's content, and the assumptions so far."""

    name: str
    overrides: dict[str, str]
    """Properties of the file that the user states, by kind."""
    poses: Float[np.ndarray, "T 55 3"]
    fps: float = float(FPS)
    trans: Float[np.ndarray, "T 3"] | None = None
    expressions: np.ndarray | None = None
    expression_basis: ExpressionBasis = "flame100"
    betas: np.ndarray = field(default_factory=lambda: np.zeros(NUM_BETAS, np.float32))
    assumptions: list[Assumption] = field(default_factory=list)
    missing_parts: set[Part] = field(default_factory=set)
    hand_reference_prior: HandReferencePrior = "flat"
    motion_number: int = 1
    """Number of the motion in a batch, from 1."""
    applied_override_kinds: set[Kind] = field(default_factory=set)
    """Properties that the reader has set as the user states, not to be applied again."""
    is_metric_y_up: bool = False
    """True if `trans` is in metres and y is up, unless the motion indicates otherwise."""

    def assume(
        self,
        kind: Kind,
        value: str,
        reason: str,
        confidence: Confidence = "sure",
        alternatives: tuple[str, ...] = (),
        is_own_convention: bool = False,
    ) -> None:
        """Record an assumption."""
        self.assumptions.append(
            Assumption(kind, value, reason, confidence, alternatives, is_own_convention)
        )

    def set_frame_rate(
        self,
        fps: float,
        reason: str,
        confidence: Confidence,
        alternatives: tuple[str, ...] = COMMON_FRAME_RATES,
    ) -> None:
        """Set the frame rate, unless the user states another."""
        is_ours = confidence == "stated" and abs(fps - FPS) < 0.01
        resolved = self.resolve("rate", f"{fps:g}", reason, confidence, alternatives, is_ours)
        self.fps = float(resolved) if "rate" in self.overrides else fps

    def to_axis_angle(
        self, rows: Float[np.ndarray, "T J width"], joints: tuple[int, ...]
    ) -> Float[np.ndarray, "T J 3"]:
        """Convert rotations to axis-angle, and record the format assumed."""
        form = _rotation_format(rows, joints, self.name, self.overrides.get("rotations"))
        if form not in self.assumptions:
            self.assumptions.append(form)
        return _decoded(rows, form.value, self.name)

    def resolve(
        self,
        kind: Kind,
        detected: str,
        reason: str,
        confidence: Confidence,
        alternatives: tuple[str, ...],
        is_own_convention: bool = False,
    ) -> str:
        """Return the user's value of a property, or else the one detected, and record it."""
        override = self.overrides.get(kind)
        if override is None:
            self.assume(kind, detected, reason, confidence, alternatives, is_own_convention)
            return detected
        self.assume(kind, override, "set by you", "user", alternatives)
        return override

    def select_frames(self, frames: slice) -> None:
        """Keep only a range of frames."""
        self.poses = self.poses[frames]
        self.trans = None if self.trans is None else self.trans[frames]
        self.expressions = None if self.expressions is None else self.expressions[frames]

    def motion(self) -> Motion:
        """Make the motion, with zeros for missing parts."""
        frames = len(self.poses)
        trans = np.zeros((frames, 3)) if self.trans is None else self.trans
        if self.expressions is None:
            faces = np.zeros((frames, NUM_EXPRESSIONS), np.float32)
        else:
            faces = self.expressions.astype(np.float32)
        poses = self.poses.reshape(frames, -1).astype(np.float32)
        return Motion(poses, trans.astype(np.float32), faces, self.expression_basis, self.betas)


@dataclass(frozen=True)
class RotationLayout:
    """Layout of rotations in an array."""

    batch: int
    frames: int
    joints: int
    values_per_joint: int
    is_transposed: bool = False

    def reshape(self, array: Shaped[np.ndarray, " ..."]) -> Float[np.ndarray, "B T J width"]:
        """Reshape an array to this layout."""
        array = array.T if self.is_transposed else array
        return array.reshape(self.batch, self.frames, self.joints, self.values_per_joint)


def rotation_layout(shape: tuple[int, ...]) -> RotationLayout | None:
    """Return the layout of rotations in an array by its shape; None if it fits none."""
    pairs = {(joints, width) for joints in JOINTS_BY_COUNT for width in ROTATION_FORMATS}
    flat = {joints * width: (joints, width) for joints, width in pairs}
    match shape:
        case (frames, columns) if columns in flat:
            return RotationLayout(1, frames, *flat[columns])
        case (joints, width) if (joints, width) in pairs:
            return RotationLayout(1, 1, joints, width)
        case (columns, frames) if columns in flat and frames > 1:
            return RotationLayout(1, frames, *flat[columns], is_transposed=True)
        case (frames, joints, width) if (joints, width) in pairs:
            return RotationLayout(1, frames, joints, width)
        case (batch, frames, columns) if columns in flat:
            batch, frames = (1, batch) if frames == 1 else (batch, frames)
            return RotationLayout(batch, frames, *flat[columns])
        case (frames, joints, 3, 3) if joints in JOINTS_BY_COUNT:
            return RotationLayout(1, frames, joints, 9)
        case (batch, frames, joints, width) if (joints, width) in pairs:
            return RotationLayout(batch, frames, joints, width)
        case (batch, frames, joints, 3, 3) if joints in JOINTS_BY_COUNT:
            return RotationLayout(batch, frames, joints, 9)
    return None


def scatter_joints(poses: Float[np.ndarray, "T J 3"], joints: tuple[int, ...]) -> np.ndarray:
    """Return poses of 55 joints with these ones; the others stay at rest."""
    whole = np.zeros((len(poses), NUM_JOINTS, 3))
    whole[:, list(joints)] = poses[:, : len(joints)]
    return whole


def are_positions(rows: Float[np.ndarray, "T J 3"], joints: tuple[int, ...]) -> bool:
    """Check whether rows are positions, by constant bones in the proportions of a body."""
    places = scatter_joints(rows[:: max(1, len(rows) // 100)], joints)
    bones = [joint for joint in joints[1:] if PARENTS[joint] in joints]
    lengths = np.linalg.norm(places[:, bones] - places[:, [PARENTS[j] for j in bones]], axis=-1)
    mean = lengths.mean(axis=0)
    if not mean.std() > 1e-3:
        return False
    rest = open_body_skeleton().rest_joints.double().numpy()
    ours = np.linalg.norm(rest[bones] - rest[[PARENTS[joint] for joint in bones]], axis=-1)
    varies = np.median(lengths.std(axis=0) / np.maximum(mean, 1e-9))
    return bool(np.corrcoef(mean, ours)[0, 1] > 0.85 and varies < 0.1)


def natural_bend_score(poses: Float[np.ndarray, "T J 3"], joints: tuple[int, ...]) -> float:
    """Score how joints bend: positive as people's arms, knees and fingers do, or negative."""
    curls = [f"{finger}{i}" for finger in ("index", "middle", "ring") for i in (1, 2, 3)]
    signs = {"left_knee": (0, 0.7), "right_knee": (0, 0.7)}
    for side, sign in (("left", -1.0), ("right", 1.0)):
        signs |= {f"{side}_elbow": (1, sign), f"{side}_shoulder": (2, sign)}
        signs |= {f"{side}_{curl}": (2, 0.3 * sign) for curl in curls}
    mean = poses.mean(axis=0)
    at = {joint: index for index, joint in enumerate(joints)}
    return sum(
        sign * float(np.clip(mean[at[JOINT_INDEX[name]], axis], -1, 1))
        for name, (axis, sign) in signs.items()
        if JOINT_INDEX[name] in at
    )


def _rotation_format(
    rows: Float[np.ndarray, "T J width"], joints: tuple[int, ...], name: str, override: str | None
) -> Assumption:
    """Decide the format of rotations; raises MotionError if ``override`` is impossible."""
    width = rows.shape[-1]
    forms = ROTATION_FORMATS[width]
    if override is not None:
        if override not in forms:
            raise MotionError(
                f"{name} has {width} numbers per joint, which cannot be {override} rotations; use "
                f"{' or '.join(forms)}."
            )
        return Assumption("rotations", override, "set by you", "user")
    if width == 6:
        return _rotation_format_6d(rows, joints, name)
    if width == 4:
        first, last = (float(np.abs(rows[..., at]).mean()) for at in (0, 3))
        confidence = "sure" if abs(first - last) > 0.1 else "unsure"
        reason = f"joints rotate least if w is the {'first' if first >= last else 'last'} number"
        return Assumption("rotations", forms[int(first < last)], reason, confidence, forms)
    reason = f"{width} numbers per joint"
    return Assumption("rotations", forms[0], reason, is_own_convention=forms[0] == "axis-angle")


def _rotation_format_6d(
    rows: Float[np.ndarray, "T J 6"], joints: tuple[int, ...], name: str
) -> Assumption:
    """Decide whether 6D rotations are sequential or interleaved, and rows or columns."""

    def orthonormality_error(six: Num[np.ndarray, "*batch 6"]) -> float:
        a, b = six[..., :3], six[..., 3:]
        unit = [np.abs(np.linalg.norm(each, axis=-1) - 1).mean() for each in (a, b)]
        return float(sum(unit) + np.abs((a * b).sum(axis=-1)).mean())

    forms = ROTATION_FORMATS[6]
    if orthonormality_error(rows[..., _INTERLEAVED_6D]) < 0.5 * orthonormality_error(rows):
        reason = "the numbers are orthonormal only as two interleaved columns"
        return Assumption("rotations", "6d-interleaved", reason, "sure", forms)
    natural = natural_bend_score(_decoded(rows, "6d", name), joints)
    form, reason = "6d", "if read as the first two matrix rows, joints bend as a person's do"
    if natural < -0.3:
        form, reason = "6d-columns", "if read as matrix rows, elbows and hands would bend backwards"
    confidence: Confidence = (
        "sure" if abs(natural) > 1.0 else "likely" if abs(natural) > 0.3 else "unsure"
    )
    return Assumption("rotations", form, reason, confidence, forms)


def _decoded(rows: Float[np.ndarray, "T J width"], form: str, name: str) -> np.ndarray:
    shape = (*rows.shape[:2], 3)
    if form == "axis-angle":
        largest = float(np.linalg.norm(rows, axis=-1).max(initial=0.0))
        if largest > MAX_RADIANS:
            raise MotionError(
                f"{name} rotates a joint by {largest:.0f}; rotations must be in radians, not"
                " degrees. Multiply them by pi/180."
            )
        return rows.astype(np.float64)
    if form.startswith("quaternion"):
        if np.abs(np.linalg.norm(rows, axis=-1) - 1).max() > 0.1:
            raise MotionError(
                f"{name} has 4 numbers per joint that are not unit quaternions; save joint "
                "rotations as unit quaternions."
            )
        xyzw = rows if form == "quaternion-xyzw" else np.roll(rows, -1, axis=-1)
        return Rotation.from_quat(xyzw.reshape(-1, 4)).as_rotvec().reshape(shape)
    if form.startswith("6d"):
        six = rows[..., _INTERLEAVED_6D] if form == "6d-interleaved" else rows
        rotmat = matrix_from_rot6d(torch.from_numpy(np.ascontiguousarray(six)).double())
        poses = axis_angle_from_matrix(rotmat).numpy()
        return poses if form == "6d" else -poses
    rotmat = torch.from_numpy(np.ascontiguousarray(rows)).double().unflatten(-1, (3, 3))
    apart = rotmat @ rotmat.mT - torch.eye(3, dtype=rotmat.dtype)
    if float(apart.abs().max()) > 0.05:
        raise MotionError(
            f"{name} has 9 numbers per joint that are not rotation matrices; save joint rotations "
            "as 3x3 matrices."
        )
    return axis_angle_from_matrix(rotmat).numpy()


def resample_to_30_fps(motion: Motion, fps: float) -> Motion:
    """Resample a motion to 30 frames per second.

    Higher rates are resampled by slerp; lower ones along a cubic spline, which adds neither kinks
    nor jitter that the file cannot have.
    """
    if abs(fps - FPS) < 0.01:
        return motion
    if fps > FPS - 1.0:
        return change_motion_speed(motion, fps / FPS)
    at = np.arange(int((motion.num_frames - 1) * FPS / fps + 1e-6) + 1) * fps / FPS
    frames = np.arange(motion.num_frames)
    rotmat = motion.local_rotations().double().numpy()[..., :2, :]
    rows = _resample(rotmat.reshape(len(frames), -1), frames, at)
    turned = matrix_from_rot6d(torch.from_numpy(rows).unflatten(-1, (NUM_JOINTS, 6)))
    return replace(
        motion,
        poses=axis_angle_from_matrix(turned).flatten(1).float().numpy(),
        trans=_resample(motion.trans, frames, at).astype(np.float32),
        expressions=_resample(motion.expressions, frames, at).astype(np.float32),
    )


def _resample(
    rows: Float[np.ndarray, "T C"],
    from_times: Num[np.ndarray, " T"],
    to_times: Num[np.ndarray, " S"],
) -> Float[np.ndarray, "S C"]:
    if len(from_times) < 2:
        return np.repeat(rows, len(to_times), axis=0).astype(np.float64)
    return CubicSpline(from_times, rows.astype(np.float64), axis=0)(to_times)
