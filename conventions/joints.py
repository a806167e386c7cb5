"""Names, parents, groups and mirror pairs of the 55 SMPL-X joints, and the vertices of fingertips.

Every index in the project is computed from a joint *name* here.
"""

from typing import Literal

BodyPart = Literal["", "feet", "hands", "face"]
"""Part of a body; empty for the whole body."""
FINGERS = ("index", "middle", "pinky", "ring", "thumb")

JOINT_NAMES: tuple[str, ...] = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2",
    "left_ankle", "right_ankle", "spine3", "left_foot", "right_foot", "neck", "left_collar",
    "right_collar", "head", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow",
    "left_wrist", "right_wrist", "jaw", "left_eye", "right_eye",
    *(
        f"{side}_{finger}{segment}"
        for side in ("left", "right")
        for finger in FINGERS
        for segment in (1, 2, 3)
    ),
)  # fmt: skip
"""Joint names in SMPL-X order."""

NUM_JOINTS = len(JOINT_NAMES)
JOINT_INDEX: dict[str, int] = {name: index for index, name in enumerate(JOINT_NAMES)}

_PARENT_NAME: dict[str, str] = {
    "left_hip": "pelvis", "right_hip": "pelvis", "spine1": "pelvis",
    "left_knee": "left_hip", "right_knee": "right_hip", "spine2": "spine1",
    "left_ankle": "left_knee", "right_ankle": "right_knee", "spine3": "spine2",
    "left_foot": "left_ankle", "right_foot": "right_ankle",
    "neck": "spine3", "left_collar": "spine3", "right_collar": "spine3", "head": "neck",
    "left_shoulder": "left_collar", "right_shoulder": "right_collar",
    "left_elbow": "left_shoulder", "right_elbow": "right_shoulder",
    "left_wrist": "left_elbow", "right_wrist": "right_elbow",
    "jaw": "head", "left_eye": "head", "right_eye": "head",
}  # fmt: skip


def _parent_name(name: str) -> str:
    if name in _PARENT_NAME:
        return _PARENT_NAME[name]
    segment = int(name[-1])  # a finger joint such as left_index2
    return f"{name[:-1]}{segment - 1}" if segment > 1 else f"{name.split('_')[0]}_wrist"


PARENTS: tuple[int, ...] = (-1, *(JOINT_INDEX[_parent_name(name)] for name in JOINT_NAMES[1:]))
"""Parent index of each joint, -1 for the pelvis. A parent precedes its children."""


def chain_to_root(joint: int) -> tuple[int, ...]:
    """Return the joint, its parent, and so on up to the pelvis."""
    chain = [joint]
    while PARENTS[chain[-1]] >= 0:
        chain.append(PARENTS[chain[-1]])
    return tuple(chain)


JOINT_DEPTH: tuple[int, ...] = tuple(len(chain_to_root(joint)) - 1 for joint in range(NUM_JOINTS))
"""Number of bones between each joint and the pelvis (0 to 10)."""


def _indices(*names: str) -> tuple[int, ...]:
    return tuple(JOINT_INDEX[name] for name in names)


def _hand(side: str) -> tuple[int, ...]:
    return tuple(
        index
        for name, index in JOINT_INDEX.items()
        if name.startswith(f"{side}_") and name[-1].isdigit()
    )


LEFT_HAND = _hand("left")
RIGHT_HAND = _hand("right")
HANDS = LEFT_HAND + RIGHT_HAND
UPPER_BODY = _indices(
    "spine1", "spine2", "spine3", "neck", "left_collar", "right_collar", "head", "left_shoulder",
    "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
)  # fmt: skip
LOWER_BODY = _indices(
    "pelvis", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
    "left_foot", "right_foot",
)  # fmt: skip
FACE = _indices("jaw", "left_eye", "right_eye")


def _mirrored_name(name: str) -> str:
    side, _, rest = name.partition("_")
    return {"left": f"right_{rest}", "right": f"left_{rest}"}.get(side, name)


MIRROR_PERMUTATION: tuple[int, ...] = tuple(
    JOINT_INDEX[_mirrored_name(name)] for name in JOINT_NAMES
)
"""Index of each joint's left-right counterpart; a central joint is its own."""

FINGERTIP_NAMES: tuple[str, ...] = tuple(
    f"{side}_{finger}" for side in ("left", "right") for finger in FINGERS
)
FINGERTIP_JOINTS: tuple[int, ...] = tuple(JOINT_INDEX[f"{name}3"] for name in FINGERTIP_NAMES)
"""Last finger joint before each fingertip, in the order of `FINGERTIP_NAMES`."""


FINGERTIP_VERTICES: dict[str, int] = {
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
