"""By how many degrees two motions differ, for each part of the body."""

import re

from conventions.joints import JOINT_NAMES
from model.motion.motion import Motion, first_frames
from model.motion.rotations import geodesic_angle

_FINGERS = "(thumb|index|middle|ring|pinky)"
PARTS = {
    "right arm": r"right_(collar|shoulder|elbow|wrist)",
    "right hand": f"right_{_FINGERS}",
    "left arm": r"left_(collar|shoulder|elbow|wrist)",
    "left hand": f"left_{_FINGERS}",
    "trunk": r"(pelvis|spine)",
    "head": r"(neck|head)",
    "legs": r".*_(hip|knee|ankle|foot)",
}
"""What belongs to a part, by the beginning of its joints' names; all others are of the face."""


def degrees_by_part(first: Motion, second: Motion) -> dict[str, float]:
    """Mean angle between the rotations of two motions to the parent joint, in degrees.

    Over all joints of a part and all frames that both have; the part that differs most comes first.
    """
    shortest = min(first.num_frames, second.num_frames)
    a, b = (first_frames(motion, shortest).local_rotations() for motion in (first, second))
    angles = geodesic_angle(a.double(), b.double()).rad2deg().mean(0)
    found = {
        part: float(
            angles[[i for i, name in enumerate(JOINT_NAMES) if re.match(begin, name)]].mean()
        )
        for part, begin in PARTS.items()
    }
    return dict(sorted(found.items(), key=lambda item: -item[1]))
