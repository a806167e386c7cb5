"""Joints where no person's are: fingers bent backwards, hands inside the body, sides swapped."""

from itertools import pairwise

import numpy as np

from conventions.joints import JOINT_INDEX
from model.faults.evidence import Evidence
from model.faults.finding import Finding, clock, listed, stretches_of
from model.measures.joint_range import FINGER_JOINT_NAMES
from model.measures.posture import WRISTS
from model.motion.tracks import point_words

FINGERS_OUTSIDE = 0.02
"""Of all frames and finger joints; clean: at most 0.005, and 0.001 over a whole clip."""
JOINT_OUTSIDE = 0.2
"""Of the frames of one finger joint; clean: at most 0.01 over a whole clip."""
NAMED = 3
ELBOWS_BACKWARDS = 0.5
"""Of all frames, on both sides; clean: 0."""
SWAPPED_ERROR_RATIO = 0.6
"""Error with the sides changed over the error as it is. Motions of the same speech that have
nothing to do with each other give about 1, a swapped copy 0."""
INSIDE_M = 0.06
"""Of a wrist, knuckle or fingertip from the line through pelvis, spine and neck, which is 10 cm
and more under the skin in front; clean: at least 0.099."""
INSIDE_FRAMES = 3
_SPINE = ("pelvis", "spine1", "spine2", "spine3", "neck")
_KNUCKLES = ("left_middle1", "right_middle1")


def finger_range(evidence: Evidence) -> list[Finding]:
    share = evidence.raw.ranges.finger_angle_outside_share
    by_joint = evidence.raw.ranges.finger_angle_outside_by_joint
    worst = sorted(by_joint, key=lambda name: -by_joint[name])[:NAMED]
    if share <= FINGERS_OUTSIDE and by_joint[worst[0]] <= JOINT_OUTSIDE:
        return []
    assert set(by_joint) == set(FINGER_JOINT_NAMES)
    named = listed(
        [f"{point_words(name)} ({by_joint[name]:.0%})" for name in worst if by_joint[name]]
    )
    return [
        Finding(
            "finger_range",
            f"Fingers bend as no human hand can in {share:.1%} of frames and joints;"
            f" most often the {named}.",
            {
                "outside_share": share,
                "joints": {name: by_joint[name] for name in worst if by_joint[name]},
            },
            excess=max(share / FINGERS_OUTSIDE, by_joint[worst[0]] / JOINT_OUTSIDE),
        )
    ]


def hand_in_body(evidence: Evidence) -> list[Finding]:
    joints = evidence.tracks.joints
    knuckles = [*WRISTS, *(JOINT_INDEX[name] for name in _KNUCKLES)]
    hands = np.concatenate([joints[:, knuckles], evidence.tracks.fingertips], axis=1)
    nearest = np.full(hands.shape[:2], np.inf)
    for lower, upper in pairwise(_SPINE):
        start = joints[:, None, JOINT_INDEX[lower]]
        bone = joints[:, None, JOINT_INDEX[upper]] - start
        along = ((hands - start) * bone).sum(-1) / np.maximum((bone**2).sum(-1), 1e-12)
        off = hands - start - np.clip(along, 0.0, 1.0)[..., None] * bone
        nearest = np.minimum(nearest, np.linalg.norm(off, axis=-1))
    distance = nearest.min(axis=1)
    is_inside = distance < INSIDE_M
    if is_inside.sum() < INSIDE_FRAMES:
        return []
    worst = int(distance.argmin())
    place = int(nearest[worst].argmin())
    is_left = place % 2 == 0 if place < len(knuckles) else place - len(knuckles) < 5
    side = "left" if is_left else "right"
    return [
        Finding(
            "hand_in_body",
            f"The {side} hand goes into the body at {clock(worst)}: it is"
            f" {100 * distance[worst]:.0f} cm from the spine's line, in {is_inside.sum()} frames.",
            {"side": side, "distance_m": float(distance[worst]), "frames": int(is_inside.sum())},
            excess=INSIDE_M / max(float(distance[worst]), 0.005),
            worst_frame=worst,
            stretches=stretches_of(is_inside),
        )
    ]


def swapped_sides(evidence: Evidence) -> list[Finding]:
    """Beside a reference of the same speech. Without one only a swap of the joints' names shows,
    because then both elbows bend backwards; a whole mirror image is as good a motion as any."""
    if evidence.raw.errors is not None:
        errors = evidence.raw.errors.rotation_error_by_sides_deg
        is_mirrored = errors.mirrored <= errors.swapped
        error = errors.mirrored if is_mirrored else errors.swapped
        if error >= SWAPPED_ERROR_RATIO * errors.as_is:
            return []
        how = "as a mirror image" if is_mirrored else "joint by joint"
        return [
            Finding(
                "swapped_sides",
                f"Left and right seem swapped {how}: upper body and hands are"
                f" {errors.as_is:.0f}° from the reference, and {error:.0f}° once swapped"
                " back.",
                {
                    "way": "mirrored" if is_mirrored else "swapped",
                    "error_deg": errors.as_is,
                    "error_swapped_deg": error,
                },
                excess=SWAPPED_ERROR_RATIO * errors.as_is / max(error, 0.1),
            )
        ]
    backwards = evidence.raw.ranges.elbow_backwards_share
    share = min(backwards.left, backwards.right)
    if share <= ELBOWS_BACKWARDS:
        return []
    return [
        Finding(
            "swapped_sides",
            "Left and right joints seem swapped: both elbows bend backwards in at"
            f" least {share:.0%} of the frames.",
            {"way": "swapped", "elbow_backwards_share": backwards},
            excess=share / ELBOWS_BACKWARDS,
        )
    ]
