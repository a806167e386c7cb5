"""The 55 joints of SMPL-X as the renderer needs them: names and parents, in file order.

``renderer`` and ``model`` do not import each other, so the table exists on both sides; a test
holds them equal.
"""

from __future__ import annotations

_BODY = (
    ("pelvis", -1),
    ("left_hip", 0),
    ("right_hip", 0),
    ("spine1", 0),
    ("left_knee", 1),
    ("right_knee", 2),
    ("spine2", 3),
    ("left_ankle", 4),
    ("right_ankle", 5),
    ("spine3", 6),
    ("left_foot", 7),
    ("right_foot", 8),
    ("neck", 9),
    ("left_collar", 9),
    ("right_collar", 9),
    ("head", 12),
    ("left_shoulder", 13),
    ("right_shoulder", 14),
    ("left_elbow", 16),
    ("right_elbow", 17),
    ("left_wrist", 18),
    ("right_wrist", 19),
    ("jaw", 15),
    ("left_eye", 15),
    ("right_eye", 15),
)
FINGERS = ("index", "middle", "pinky", "ring", "thumb")


def _with_hands() -> tuple[tuple[str, int], ...]:
    joints = list(_BODY)
    for side, wrist in (("left", 20), ("right", 21)):
        for finger in FINGERS:
            parent = wrist
            for knuckle in (1, 2, 3):
                joints.append((f"{side}_{finger}{knuckle}", parent))
                parent = len(joints) - 1
    return tuple(joints)


JOINT_NAMES: tuple[str, ...] = tuple(name for name, _ in _with_hands())
PARENTS: tuple[int, ...] = tuple(parent for _, parent in _with_hands())
NUM_JOINTS = len(JOINT_NAMES)
JOINT_INDEX: dict[str, int] = {name: i for i, name in enumerate(JOINT_NAMES)}

# Vertices that the SMPL-X format fixes by number and every body file keeps.
TIP_VERTICES: dict[str, int] = {
    "left_thumb": 5361,
    "left_index": 4933,
    "left_middle": 5058,
    "left_ring": 5169,
    "left_pinky": 5286,
    "right_thumb": 8079,
    "right_index": 7669,
    "right_middle": 7794,
    "right_ring": 7905,
    "right_pinky": 8022,
}
