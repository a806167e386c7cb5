"""One arm in the chest's frame: from a wrist position to collar, upper arm and forearm."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_INDEX
from model.motion.limb import about_axis, hinge_frame, unit
from tools.corpus.body.signals import DEVIATION, PRONATION, WRIST_FLEX, low_pass, minimum_jerk
from tools.corpus.people.rig import SIDE_SIGN, Rig, euler_matrices, transposed


def two_bone_ik(
    root: Float[np.ndarray, "T 3"],
    target: Float[np.ndarray, "T 3"],
    upper: Float[np.ndarray, " 3"],
    lower: Float[np.ndarray, " 3"],
    hinge: Float[np.ndarray, " 3"],
    pole: Float[np.ndarray, "T 3"],
) -> tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3"]]:
    """Rotations of both bones that bring the lower bone's end to the target.

    A target near or past full stretch is approached softly, so that the middle joint never snaps.

    Args:
        root: where the upper bone begins.
        target: where the lower bone shall end.
        upper: the upper bone at rest.
        lower: the lower bone at rest.
        hinge: the middle joint's axis at rest.
        pole: the direction in which the middle joint lies off the line from root to target.

    Returns:
        The upper bone's rotation, the lower bone's rotation, the lower bone's unit direction.
    """
    a, b = np.linalg.norm(upper), np.linalg.norm(lower)
    reach = target - root
    distance = np.linalg.norm(reach, axis=-1, keepdims=True)
    limit = 0.985 * (a + b)
    soft = limit - 0.06 * (a + b)
    bent = soft + (limit - soft) * (1 - np.exp(-(distance - soft) / (limit - soft)))
    distance = np.maximum(np.where(distance > soft, bent, distance), abs(a - b) + 0.05)
    towards = unit(reach)
    along = (a * a - b * b + distance**2) / (2 * distance)
    height = np.sqrt(np.maximum(a * a - along**2, 1e-8))
    aside = unit(pole - (pole * towards).sum(-1, keepdims=True) * towards)
    middle = towards * along + aside * height
    upper_direction = unit(middle)
    lower_direction = unit(towards * distance - middle)
    upper_rot, lower_rot = bone_rotations(upper_direction, lower_direction, upper, lower, hinge)
    return upper_rot, lower_rot, lower_direction


def bone_rotations(
    upper_direction: Float[np.ndarray, "T 3"],
    lower_direction: Float[np.ndarray, "T 3"],
    upper: Float[np.ndarray, " 3"],
    lower: Float[np.ndarray, " 3"],
    hinge: Float[np.ndarray, " 3"],
) -> tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3 3"]]:
    """Rotations that turn two bones there and the hinge between them across both."""
    axis = unit(np.cross(upper_direction, lower_direction))
    upper_rest = hinge_frame(upper[None], hinge[None])[0]
    lower_rest = hinge_frame(lower[None], hinge[None])[0]
    upper_rot = hinge_frame(upper_direction, axis) @ upper_rest.T
    return upper_rot, hinge_frame(lower_direction, axis) @ lower_rest.T


UPPER_ARM_LAG_S = 0.08


@dataclass(frozen=True)
class Arm:
    """One arm's bones in the chest's frame at rest."""

    side: str
    collar: Float[np.ndarray, " 3"]
    shoulder: Float[np.ndarray, " 3"]
    upper: Float[np.ndarray, " 3"]
    fore: Float[np.ndarray, " 3"]

    @property
    def sign(self) -> float:
        return SIDE_SIGN[self.side]

    @property
    def hinge(self) -> Float[np.ndarray, " 3"]:
        return np.array([0.0, -self.sign, 0.0])


def arm_of(rig: Rig, side: str) -> Arm:
    """The arm's bones; the collar's root is measured from the chest joint."""
    return Arm(
        side,
        rig.rest_joints[JOINT_INDEX[f"{side}_collar"]] - rig.rest_joints[JOINT_INDEX["spine3"]],
        rig.offsets[JOINT_INDEX[f"{side}_shoulder"]],
        rig.offsets[JOINT_INDEX[f"{side}_elbow"]],
        rig.offsets[JOINT_INDEX[f"{side}_wrist"]],
    )


def solve_arm(
    arm: Arm,
    position: Float[np.ndarray, "T 3"],
    elbow_out: Float[np.ndarray, " T"],
    shrug: Float[np.ndarray, " T"] | float = 0.0,
    shake_deg: Float[np.ndarray, "T 3"] | float = 0.0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Collar, upper arm and forearm rotations in the chest's frame, and the forearm's direction.

    The upper arm is slower than the wrist asks for: strokes are led by the forearm, which points
    at the wrist's position from wherever the elbow has got to.
    """
    sign = arm.sign
    height, ahead = position[:, 1], position[:, 2]
    out = sign * position[:, 0]
    raised = np.clip((height + 0.36) / 0.36, 0, 2.2)
    lift = -19 + 11 * raised + 4 * np.maximum(raised - 1, 0) ** 1.3 + 12 * shrug
    protract = 9 + 14 * np.clip((ahead - 0.22) / 0.2, -1, 1)
    protract -= 4 * np.clip((out - 0.2) / 0.2, 0, 1.5)
    roll = 2 + 9 * np.clip(height + 0.15, -0.2, 0.3) / 0.3
    angles = np.stack([protract, lift, roll], axis=1) + shake_deg
    collar = euler_matrices("YZX", angles * [-sign, sign, 1.0])
    root = arm.collar + collar @ arm.shoulder
    high = np.clip(height + 0.05, 0, 0.4) / 0.3
    crossing = 0.3 * np.clip((0.10 - out) / 0.1, 0, 1)
    aside = sign * (0.22 + elbow_out + 0.05 * high + crossing)
    pole = np.stack([aside, -np.ones(len(position)), -0.42 + 0.25 * high], axis=1)
    upper, _, _ = two_bone_ik(root, position, arm.upper, arm.fore, arm.hinge, pole)
    towards_elbow = unit(low_pass(upper @ unit(arm.upper), UPPER_ARM_LAG_S))
    elbow = root + np.linalg.norm(arm.upper) * towards_elbow
    direction = unit(position - elbow)
    upper, fore = bone_rotations(towards_elbow, direction, arm.upper, arm.fore, arm.hinge)
    return collar, upper, fore, direction


def pronation_for(
    arm: Arm,
    fore: Float[np.ndarray, "T 3 3"],
    direction: Float[np.ndarray, "T 3"],
    palm: Float[np.ndarray, "T 3"],
) -> Float[np.ndarray, " T"]:
    """Degrees about the forearm that turn the palm there; the longer way round is never taken."""
    start = fore @ np.array([0.0, -1.0, 0.0])
    start = unit(start - (start * direction).sum(-1, keepdims=True) * direction)
    goal = unit(palm - (palm * direction).sum(-1, keepdims=True) * direction)
    sine = (np.cross(start, goal) * direction).sum(-1)
    angle = np.degrees(np.arctan2(sine, (start * goal).sum(-1))) * arm.sign
    return np.clip(np.where(angle > 150, angle - 360, angle), -95, 85)


def forearm_and_wrist(
    arm: Arm, hand: Float[np.ndarray, "T C"], fore: Float[np.ndarray, "T 3 3"]
) -> tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3 3"]]:
    """The forearm turned by its share of the pronation, and the wrist's rotation against it."""
    along = unit(arm.fore)
    pronation = np.radians(hand[:, PRONATION]) * arm.sign
    flex = np.radians(np.clip(hand[:, WRIST_FLEX], -60, 55))
    deviation = np.radians(np.clip(hand[:, DEVIATION], -20, 22))
    wrist = about_axis(along, 0.52 * pronation)
    wrist = wrist @ about_axis(np.array([0.0, 0.0, -arm.sign]), flex)
    wrist = wrist @ about_axis(np.array([0.0, -arm.sign, 0.0]), deviation)
    return fore @ about_axis(along, 0.48 * pronation), wrist


def with_less_twist(
    arm: Arm, upper: Float[np.ndarray, "T 3 3"], share: float
) -> Float[np.ndarray, "T 3 3"]:
    """Keep ``share`` of the upper arm's twist against the hanging arm, as in fitted SMPL-X data."""
    direction = upper @ unit(arm.upper)
    hanging = hinge_frame(np.array([[0.15 * arm.sign, -1.0, -0.05]]), np.array([[-1.0, 0.0, 0.0]]))
    at_rest = hinge_frame(arm.upper[None], arm.hinge[None])
    reference = hanging[0] @ at_rest[0].T
    from_direction = reference @ unit(arm.upper)
    axis = np.cross(from_direction, direction)
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.arctan2(sine, (direction @ from_direction)[:, None])
    swing = Rotation.from_rotvec(axis / np.maximum(sine, 1e-9) * angle).as_matrix() @ reference
    twist = Rotation.from_matrix(upper @ transposed(swing)).as_rotvec()
    along = (twist * direction).sum(axis=1, keepdims=True)
    return Rotation.from_rotvec(direction * along * share).as_matrix() @ swing


def within_reach(arm: Arm, hand: Float[np.ndarray, "T C"]) -> Float[np.ndarray, "T C"]:
    """Not too far to the side, not too high, not too near to the shoulder."""
    hand = hand.copy()
    out = _soft_ceiling(hand[:, 0] * arm.sign, 0.33, 0.07)
    hand[:, 0] = arm.sign * np.maximum(out, -0.05)
    hand[:, 1] = _soft_ceiling(hand[:, 1], 0.20, 0.07)
    # A raised hand keeps off the shoulder: the elbow would fold up and the arm spin.
    raised = minimum_jerk((hand[:, 1] + 0.05) / 0.15)
    nearest = 0.19 * raised - 1.0 * (1 - raised)
    hand[:, 2] = -_soft_ceiling(-hand[:, 2], -nearest - 0.04, 0.04)
    return hand


def _soft_ceiling(value: np.ndarray, limit: np.ndarray | float, margin: float) -> np.ndarray:
    """The value, bent over smoothly above ``limit`` and never past ``limit + margin``."""
    over = np.maximum(value - limit, 0.0)
    return np.where(value > limit, limit + margin * np.tanh(over / margin), value)
