"""Growth of local rotation errors along the kinematic chain, without any trained network.

Each rotation R of the chain is replaced by ``R' = R exp([n]x)`` with ``n ~ N(0, sigma^2 I)``, drawn
for every joint and frame; [n]x is the cross-product matrix of n. The same n are applied once to the
local and once to the global rotations of a motion, and the root mean square displacement of the
points along the chain is measured (GlobalDiff, section 1 and Figure 6, claims its growth of trained
networks). To first order, n displaces a point at lever arm r by ``n x r``, whose mean square is ``2
sigma^2 |r|^2``. For a point at p, with the joints j before it at p_j and their bones b_j (from j to
the next point of the chain),

* noise on local rotations turns all that follows a joint: ``sigma sqrt(2 sum_j |p - p_j|^2)``;
* noise on global rotations turns only the joint's bone: ``sigma sqrt(2 sum_j |b_j|^2)``.

In return, local angles recovered from noisy global rotations have the noise of two joints, sqrt(2)
times that of one. That both formats have equal noise is an assumption: the errors of a trained
network have to be measured.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float64
from torch import Tensor

from conventions.joints import FINGERTIP_NAMES, JOINT_NAMES
from conventions.rates import FPS
from model.metrics.smoothness import derivative_magnitudes, mean_over_time
from model.motion.kinematics import (
    RestSkeleton,
    fingertip_positions,
    global_from_local,
    joint_positions_from_global,
    local_from_global,
)
from model.motion.motion import Motion
from model.motion.rotations import geodesic_angle, matrix_from_axis_angle
from model.motion.tracks import POINT_NAMES, kinematic_chain, point_label

NOISE_RAD = 0.02
"""Standard deviation of the noise about each axis (rad); about 1.1 degrees."""
DRAWS = 4
MAX_FRAMES = 60 * FPS
"""Longest part of a clip that is used (frames); the first minute is enough."""


@dataclass(frozen=True, eq=False)
class ErrorGrowth:
    """Root mean square displacement of points (m) under rotation noise, over frames and draws."""

    point_names: tuple[str, ...]
    """Names of the chain's points, from the joint after the pelvis to the tracked point."""
    local_rms_m: Float64[np.ndarray, " points"]
    """Displacement (m) with noise on the local rotations."""
    global_rms_m: Float64[np.ndarray, " points"]
    predicted_local_rms_m: Float64[np.ndarray, " points"]
    """`local_rms_m` predicted in closed form, with the lever arms of the clip's poses (m)."""
    predicted_global_rms_m: Float64[np.ndarray, " points"]
    jerk_m_s3: dict[str, float]
    """Mean jerk (m/s³) of the tracked point: ``clean``, with ``local`` and ``global`` noise."""
    local_angle_global_to_local_ratio: float
    """Error of local angles from noisy global rotations over noisy local ones; sqrt(2) expected."""

    @property
    def local_to_global_ratio(self) -> float:
        """Displacement of the tracked point with local noise over that with global noise."""
        return float(self.local_rms_m[-1] / self.global_rms_m[-1])

    @property
    def predicted_local_to_global_ratio(self) -> float:
        return float(self.predicted_local_rms_m[-1] / self.predicted_global_rms_m[-1])


def measure_error_growth(
    motion: Motion, skeleton: RestSkeleton, point: str, noise_rad: float = NOISE_RAD, seed: int = 0
) -> ErrorGrowth:
    """Measure on one motion how noise on local and on global rotations spreads along a chain.

    Each component of the random turns has deviation ``noise_rad``. Raises ValueError if no rotation
    moves the point: the pelvis is only ever translated.
    """
    chain = kinematic_chain(point)
    if not chain:
        raise ValueError(
            "Joint rotations do not move the pelvis; track another joint, such as a wrist."
        )
    skeleton = RestSkeleton(skeleton.rest_joints.double(), skeleton.tip_offsets.double())
    joints = list(chain)
    R_parent_joint = motion.local_rotations()[:MAX_FRAMES].double()
    R_world_joint = global_from_local(R_parent_joint)
    clean = _points(R_world_joint, point, skeleton)
    generator = torch.Generator().manual_seed(seed)
    moved_local, moved_global, recovered, jerks = [], [], [], []
    for _ in range(DRAWS):
        turn = torch.zeros(R_parent_joint.shape[:-1], dtype=torch.float64)
        turn[:, joints] = (
            noise_rad * torch.randn((len(turn), len(chain), 3), generator=generator).double()
        )
        noise = matrix_from_axis_angle(turn)
        noisy_global = R_world_joint @ noise
        by_form = [
            _points(rotations, point, skeleton)
            for rotations in (global_from_local(R_parent_joint @ noise), noisy_global)
        ]
        for moved, points in zip((moved_local, moved_global), by_form, strict=True):
            moved.append((points - clean).square().sum(-1).mean(0))
        jerks.append([_mean_jerk(points[:, -1]) for points in by_form])
        back = geodesic_angle(local_from_global(noisy_global), R_parent_joint)[:, joints[1:]]
        recovered.append(back.square().mean() / turn[:, joints[1:]].square().sum(-1).mean())
    jerk_local, jerk_global = np.mean(jerks, axis=0)
    predicted_local, predicted_global = _predicted(clean, noise_rad)
    return ErrorGrowth(
        point_names=(*(JOINT_NAMES[joint] for joint in chain[1:]), point),
        local_rms_m=torch.stack(moved_local).mean(0).sqrt().numpy(),
        global_rms_m=torch.stack(moved_global).mean(0).sqrt().numpy(),
        predicted_local_rms_m=predicted_local.numpy(),
        predicted_global_rms_m=predicted_global.numpy(),
        jerk_m_s3={
            "clean": _mean_jerk(clean[:, -1]),
            "local": float(jerk_local),
            "global": float(jerk_global),
        },
        local_angle_global_to_local_ratio=float(torch.stack(recovered).mean().sqrt()),
    )


def error_growth_summary(growth: ErrorGrowth, noise_rad: float) -> str:
    """Format the result of the experiment as sentences."""
    local, world = (100 * float(s[-1]) for s in (growth.local_rms_m, growth.global_rms_m))
    return (
        f"Noise of {noise_rad:g} rad on every joint moves the "
        f"{point_label(growth.point_names[-1])} by {local:.1f} cm if added to local rotations "
        f"and by {world:.1f} cm if added to global rotations. With local noise it moves "
        f"{growth.local_to_global_ratio:.1f} times as far as with global noise (predicted from "
        "lever arms:"
        f" {growth.predicted_local_to_global_ratio:.1f} times)."
    )


def _points(
    R_world_joint: Float[Tensor, "T 55 3 3"], point: str, skeleton: RestSkeleton
) -> Float[Tensor, "T chain 3"]:
    """Compute root-relative positions of the chain's joints and, last, of the tracked point."""
    joints = joint_positions_from_global(R_world_joint, skeleton)
    points = torch.cat([fingertip_positions(R_world_joint, joints, skeleton), joints], dim=1)
    way = [len(FINGERTIP_NAMES) + joint for joint in kinematic_chain(point)[1:]]
    return points[:, [*way, POINT_NAMES.index(point)]] - joints[:, :1]


def _predicted(
    points: Float[Tensor, "T chain 3"], noise_rad: float
) -> tuple[Float[Tensor, " chain"], Float[Tensor, " chain"]]:
    """Compute the closed-form displacement (m) of every point for local and for global noise."""
    joints = torch.cat([torch.zeros_like(points[:, :1]), points[:, :-1]], dim=1)
    squared_lever = (points[:, :, None] - joints[:, None]).square().sum(-1).mean(0)
    local = squared_lever.tril().sum(-1)  # a joint moves what comes after it only
    world = squared_lever.diagonal().cumsum(0)
    return noise_rad * (2 * local).sqrt(), noise_rad * (2 * world).sqrt()


def _mean_jerk(positions: Float[Tensor, "T 3"]) -> float:
    return float(mean_over_time(derivative_magnitudes(positions.numpy(), 3)))
