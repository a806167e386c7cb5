"""Collision avoidance of the hands with the trunk and each other.

A hand is a set of spheres along its bones. The trunk is two columns of superelliptic slices
measured on the open body, one fixed to the chest and one to the pelvis.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from conventions.joints import JOINT_INDEX, PARENTS
from conventions.rates import FPS
from tools.corpus.body.signals import low_pass, minimum_jerk
from tools.corpus.people.rig import SIDE_SIGN, Rig

_MARGIN_M = 0.006
_CONTACT_M = 0.004  # palms that touch press into each other a little
_NEAR_M = 0.14  # resting hands that are so near touch
# height, half width, depth of the middle, half depth; metres in the frame of the joint
_CHEST = np.array(
    [
        [-0.30, 0.165, 0.120, 0.150],
        [-0.24, 0.170, 0.120, 0.140],
        [-0.16, 0.158, 0.110, 0.120],
        [-0.08, 0.153, 0.080, 0.122],
        [0.00, 0.156, 0.070, 0.120],
        [0.08, 0.156, 0.050, 0.112],
        [0.16, 0.125, 0.020, 0.090],
    ]
)
_PELVIS = np.array(
    [
        [-0.40, 0.255, 0.005, 0.142],
        [-0.30, 0.252, 0.005, 0.145],
        [-0.22, 0.236, 0.018, 0.134],
        [-0.14, 0.211, 0.028, 0.118],
        [-0.06, 0.180, 0.042, 0.112],
        [0.02, 0.166, 0.046, 0.112],
        [0.12, 0.150, 0.050, 0.108],
    ]
)
_EXPONENT = 3.0
_RADIUS_M = {"wrist": 0.026, "palm": 0.017, "1": 0.014, "2": 0.011, "3": 0.009, "tip": 0.008}


@dataclass(frozen=True)
class Hips:
    """Pelvis in the frame of the chest."""

    rotmat: Float[np.ndarray, "T 3 3"]
    position: Float[np.ndarray, "T 3"]


def hips_in_chest(rig: Rig, rotations: dict[int, Float[np.ndarray, "T 3 3"]]) -> Hips:
    """Return the pelvis in the chest's frame, from the spine's local rotations."""
    lowest, middle, chest = (JOINT_INDEX[f"spine{k}"] for k in (1, 2, 3))
    two = rotations[lowest] @ rotations[middle]
    position = rig.offsets[lowest] + rotations[lowest] @ rig.offsets[middle]
    position = position + two @ rig.offsets[chest]
    rotmat = (two @ rotations[chest]).mT
    return Hips(rotmat, -np.einsum("tij,tj->ti", rotmat, position))


def hand_balls(
    rig: Rig,
    side: str,
    R_parent_joint: dict[int, Float[np.ndarray, "T 3 3"]],
    wrist_rot: Float[np.ndarray, "T 3 3"],
    wrist: Float[np.ndarray, "T 3"],
) -> tuple[Float[np.ndarray, "T P 3"], Float[np.ndarray, " P"]]:
    """Return centres of a hand's spheres in the frame of the wrist's transform, and their radii."""
    centres, radii = [wrist], [_RADIUS_M["wrist"]]
    rotmat, place = {JOINT_INDEX[f"{side}_wrist"]: wrist_rot}, {JOINT_INDEX[f"{side}_wrist"]: wrist}
    for name, joint in JOINT_INDEX.items():
        parent = PARENTS[joint]
        if parent not in rotmat:
            continue
        place[joint] = place[parent] + rotmat[parent] @ rig.offsets[joint]
        rotmat[joint] = rotmat[parent] @ R_parent_joint[joint]
        centres.append(place[joint])
        radii.append(_RADIUS_M[name[-1]])
        if name.endswith("1"):
            centres.append(0.5 * (place[parent] + place[joint]))
            radii.append(_RADIUS_M["palm"])
    for offset, joint in zip(rig.tip_offsets, rig.tip_joints, strict=True):
        if joint in rotmat:
            centres.append(place[joint] + rotmat[joint] @ offset)
            radii.append(_RADIUS_M["tip"])
    return np.stack(centres, axis=1), np.array(radii)


def push_off_trunk(
    centres: Float[np.ndarray, "T P 3"], radii: Float[np.ndarray, " P"], side: str, hips: Hips
) -> Float[np.ndarray, "T 3"]:
    """Return the offset, smooth in time, that moves a hand out of the trunk (chest's frame)."""
    sign = SIDE_SIGN[side]
    push = _off_column(centres, radii, sign, _CHEST)
    from_hips = (centres + push[:, None] - hips.position[:, None]) @ hips.rotmat
    off_hips = _off_column(from_hips, radii, sign, _PELVIS)
    return push + np.einsum("tij,tj->ti", hips.rotmat, off_hips)


def separate_hands(
    left: Float[np.ndarray, "T P 3"],
    right: Float[np.ndarray, "T P 3"],
    radii: Float[np.ndarray, " P"],
) -> Float[np.ndarray, " T"]:
    """Compute each hand's sideways shift (m) that separates the hands, or joins resting ones."""
    gap = left[:, :, None] - right[:, None]
    reach = radii[:, None] + radii - _CONTACT_M
    across = gap[..., 1] ** 2 + gap[..., 2] ** 2
    needed = np.sqrt(np.maximum(reach**2 - across, 0.0)) - gap[..., 0]
    overlap = np.where(across < reach**2, needed, -1.0).max(axis=(1, 2))
    apart = _ahead_of(np.maximum(overlap, 0.0))
    still = np.minimum(*(_stillness(centres.mean(axis=1)) for centres in (left, right)))
    near = minimum_jerk((_NEAR_M + overlap) / (0.5 * _NEAR_M))
    together = low_pass(still * near * np.minimum(overlap, 0.0), 0.12)
    return 0.5 * (apart + together)


def _stillness(place: Float[np.ndarray, "T 3"]) -> Float[np.ndarray, " T"]:
    """Return 1 while a hand rests, 0 while it gestures."""
    speed = np.linalg.norm(np.gradient(place, axis=0), axis=1) * FPS
    return 1.0 - minimum_jerk((low_pass(speed, 0.2) - 0.08) / 0.12)


def _off_column(
    centres: Float[np.ndarray, "T P 3"],
    radii: Float[np.ndarray, " P"],
    sign: float,
    slices: Float[np.ndarray, "S 4"],
) -> Float[np.ndarray, "T 3"]:
    height = centres[..., 1]
    width, middle, depth = (np.interp(height, slices[:, 0], column) for column in slices[:, 1:].T)
    grown = radii + _MARGIN_M
    out, ahead = sign * centres[..., 0], centres[..., 2] - middle
    share = (np.abs(out / (width + grown)) ** _EXPONENT) + (
        np.abs(ahead / (depth + grown)) ** _EXPONENT
    )
    inside = share ** (1 / _EXPONENT)
    beside = (height > slices[0, 0]) & (height < slices[-1, 0]) & (inside < 1)
    scale = np.where(beside, 1 / np.maximum(inside, 0.35) - 1, 0.0)
    outwards = sign * _ahead_of((np.maximum(out, 0.0) * scale).max(axis=1))
    forwards = _ahead_of((np.maximum(ahead, 0.03) * scale).max(axis=1))
    return np.stack([outwards, np.zeros_like(outwards), forwards], axis=1)


def _ahead_of(push: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
    """Return a smooth upper envelope of a push that starts and ends abruptly."""
    return gaussian_filter1d(maximum_filter1d(push, 9), 2.0)
