"""BVH: our own files (`renderer.files.bvh`), and skeletons with the usual names of animation.

Only skeletons whose rest pose is about a T-pose with axes of the world fit, which is checked by the
arms. What is left, a shoulder or thumb that rests at another angle, is made up for: the bones of
limbs and fingers point in the world as the file's do.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_INDEX, JOINT_NAMES, NUM_JOINTS, PARENTS
from model.formats.numbers import ReadMotion, ReadOptions, at_30_fps, check_fps, plain_motion
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import check_length
from model.motion.tracks import point_words
from model.storage.npz import MAX_FILE_BYTES, MotionError

MAX_JOINTS = 400
_FINGERS = ("Index", "Middle", "Pinky", "Ring", "Thumb")
_LIMBS = {
    "collar": "Shoulder", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand",
    "hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "foot": "ToeBase",
}  # fmt: skip
_BEAT_LIMBS = _LIMBS | {"elbow": "Arm1", "foot": "FootF"}
USUAL_NAMES: dict[str, tuple[str, ...]] = {
    "pelvis": ("Hips",),
    "spine1": ("Spine",),
    "spine2": ("Spine1",),
    "spine3": ("Spine2", "Spine3"),
    "neck": ("Neck", "Neck1"),
    "head": ("Head",),
    **{
        f"{side.lower()}_{own}": (f"{side}{theirs}", f"{side[0]}{_BEAT_LIMBS[own]}")
        for side in ("Left", "Right")
        for own, theirs in _LIMBS.items()
    },
    **{
        f"{side.lower()}_{finger.lower()}{segment}": (
            f"{side}Hand{finger}{segment}",
            f"{side[0]}Hand{finger[0]}{segment}",
        )
        for side in ("Left", "Right")
        for finger in _FINGERS
        for segment in (1, 2, 3)
    },
}
"""Of Mixamo, MotionBuilder and ZeroEGGS, then of BEAT and DiffSHEG (``LArm1``, ``LHandM1``): the
joints whose rotations together are one of ours."""
BONES: dict[str, str] = {
    f"{side}_{start}": f"{side}_{end}"
    for side in ("left", "right")
    for start, end in [
        *(("collar", "shoulder"), ("shoulder", "elbow"), ("elbow", "wrist"), ("wrist", "middle1")),
        *(("hip", "knee"), ("knee", "ankle"), ("ankle", "foot")),
        *(
            (f"{finger.lower()}{i}", f"{finger.lower()}{i + 1}")
            for finger in _FINGERS
            for i in (1, 2)
        ),
    ]
}
"""Bones of limbs and fingers, from their joint to the next."""
_NEEDED = ("pelvis", "spine1", "left_shoulder", "right_shoulder", "left_hip", "right_hip")
_CHANNELS = {f"{axis}{kind}" for axis in "XYZ" for kind in ("position", "rotation")}
_ALONG = 0.8


@dataclass
class _Joint:
    name: str
    parent: int
    offset: tuple[float, ...] = (0.0, 0.0, 0.0)
    channels: list[str] = field(default_factory=list)


def read_bvh(path: Path, options: ReadOptions) -> ReadMotion:
    """A motion of the joints that it names; the face stays at rest.

    Raises:
        MotionError: for damaged files, unknown skeletons, and rest poses that are no T-pose.
    """
    name, notes = path.name, []
    joints, frame_s, rows, stated = _parsed(path)
    if stated > len(rows):
        notes.append(f"{name} says that it has {stated} frames and holds {len(rows)}.")
    own = {joint.name: index for index, joint in enumerate(joints)}
    is_ours = all(each in own for each in JOINT_NAMES)
    names = {each: (each,) for each in JOINT_NAMES} if is_ours else USUAL_NAMES
    found = {
        ours: [own[theirs] for theirs in group if theirs in own] for ours, group in names.items()
    }
    lacking = [ours for ours in _NEEDED if not found.get(ours)]
    if lacking:
        raise MotionError(
            f"{name} names no joint for {', '.join(lacking)}; known are our own names, those of"
            " Mixamo (Hips, Spine, LeftArm …) and of BEAT (LArm …)."
        )
    _check_rest_pose(joints, found, name)
    turns = {} if is_ours else _rest_turns(joints, found)
    poses = _poses(_global_rotations(joints, rows), found, turns)
    trans, scale = _translation(joints, found, rows)
    if not is_ours:
        without = sum(not theirs for ours, theirs in found.items())
        unused = len(joints) - sum(len(theirs) for theirs in found.values())
        notes.append(
            f"{name} has {len(joints)} joints; those with the usual names were laid onto ours"
            f" ({unused} have no place, {without} of ours stay at rest), and lengths multiplied by"
            f" {scale:.3g}, so that the legs are as long."
        )
        if turns:
            degrees = {ours: float(np.degrees(turn.magnitude())) for ours, turn in turns.items()}
            most = max(degrees, key=lambda ours: degrees[ours])
            notes.append(
                f"{name} rests at other angles than our body, by up to {degrees[most]:.0f}°"
                f" ({point_words(most)}); limbs and fingers were turned to point as they do there."
            )
        notes.append(f"{name} has no face; it stays at rest.")
    fps = round(1 / frame_s, 3) if options.fps is None else options.fps
    motion = plain_motion(poses.reshape(len(poses), -1).astype(np.float32), trans)
    motion = at_30_fps(motion, check_fps(fps, name), name, notes)
    return ReadMotion(motion, tuple(notes))


def _parsed(path: Path) -> tuple[list[_Joint], float, Float[np.ndarray, "T channels"], int]:
    """Joints, seconds a frame, rows, and how many rows the file says that it has: DiffSHEG leaves
    out the first one."""
    name = path.name
    if not path.is_file():
        raise MotionError(f"{name} does not exist; give a motion file.")
    if path.stat().st_size > MAX_FILE_BYTES:
        raise MotionError(f"{name} is over {MAX_FILE_BYTES // 2**20} MiB. Cut it first.")
    try:
        head, _, body = path.read_text("ascii", errors="strict").partition("MOTION")
        joints = _hierarchy(head.split())
        lines = body.strip().splitlines()
        frames = int(lines[0].split(":")[1])
        frame_s = float(lines[1].split(":")[1])
        check_length(frames, name)
        values = np.array(" ".join(lines[2:]).split(), dtype=np.float64)
        channels = sum(len(joint.channels) for joint in joints)
        is_one_short = frames > 1 and len(values) == (frames - 1) * channels
        rows = values.reshape(frames - is_one_short, channels)
    except MotionError:
        raise
    except (ValueError, IndexError, UnicodeDecodeError, OSError) as error:
        raise MotionError(f"{name} is no readable BVH file.") from error
    if not frames or not frame_s > 0 or not np.isfinite(rows).all():
        raise MotionError(f"{name} has no frames, or values that are not finite.")
    return joints, frame_s, rows, frames


def _hierarchy(words: list[str]) -> list[_Joint]:
    """Joints in the order of the file, which is that of the channels."""
    joints: list[_Joint] = []
    open_blocks: list[int] = []
    at = 1
    current = -1
    while at < len(words):
        word = words[at]
        if word in ("ROOT", "JOINT"):
            parent = open_blocks[-1] if open_blocks else -1
            joints.append(_Joint(words[at + 1].split(":")[-1], parent))
            current = len(joints) - 1
            at += 2
        elif word == "End":
            current = -1
            at += 2
        elif word == "{":
            open_blocks.append(current)
            at += 1
        elif word == "}":
            open_blocks.pop()
            at += 1
        elif word == "OFFSET":
            if current >= 0:
                joints[current].offset = tuple(float(each) for each in words[at + 1 : at + 4])
            at += 4
        elif word == "CHANNELS":
            count = int(words[at + 1])
            joints[current].channels = _channels(words[at + 2 : at + 2 + count])
            at += 2 + count
        else:
            raise ValueError(word)
        if len(joints) > MAX_JOINTS:
            raise ValueError("too many joints")
    return joints


def _channels(names: list[str]) -> list[str]:
    """
    Raises:
        ValueError: for unknown names, or one that comes twice.
    """
    if not set(names) <= _CHANNELS or len(set(names)) < len(names):
        raise ValueError(names)
    return names


def _first_channel(joints: list[_Joint], index: int) -> int:
    return sum(len(joint.channels) for joint in joints[:index])


def _rotations(joints: list[_Joint], index: int, rows: Float[np.ndarray, "T C"]) -> Rotation:
    channels = joints[index].channels
    first = _first_channel(joints, index)
    turns = [i for i, each in enumerate(channels) if each.endswith("rotation")]
    if len(turns) != 3:
        return Rotation.identity(len(rows))
    order = "".join(channels[i][0] for i in turns)
    return Rotation.from_euler(order.upper(), rows[:, [first + i for i in turns]], degrees=True)


def _global_rotations(joints: list[_Joint], rows: Float[np.ndarray, "T C"]) -> list[Rotation]:
    """Of every joint of the file, in the world."""
    world: list[Rotation] = []
    for index, joint in enumerate(joints):
        local = _rotations(joints, index, rows)
        world.append(local if joint.parent < 0 else world[joint.parent] * local)
    return world


def _poses(
    world: list[Rotation], found: dict[str, list[int]], turns: dict[str, Rotation]
) -> Float[np.ndarray, "T 55 3"]:
    """Our joints' rotations against their parents; one that the file lacks goes with its parent."""
    ours: list[Rotation] = []
    poses = np.zeros((len(world[0]), NUM_JOINTS, 3))
    for joint, parent in enumerate(PARENTS):
        name = JOINT_NAMES[joint]
        theirs = found.get(name)
        if not theirs:
            ours.append(ours[parent])
            continue
        turned = world[theirs[-1]] * turns[name] if name in turns else world[theirs[-1]]
        ours.append(turned)
        local = turned if parent < 0 else ours[parent].inv() * turned
        poses[:, joint] = local.as_rotvec()
    return poses


def _rest_turns(joints: list[_Joint], found: dict[str, list[int]]) -> dict[str, Rotation]:
    """What takes each limb's bone from where it rests with us to where it rests in the file."""
    rest = open_body_skeleton().rest_joints.double().numpy()
    turns: dict[str, Rotation] = {}
    for start, end in BONES.items():
        first, last = found.get(start), found.get(end)
        if not first or not last:
            continue
        theirs = _rest_place(joints, last[0]) - _rest_place(joints, first[-1])
        ours = rest[JOINT_INDEX[end]] - rest[JOINT_INDEX[start]]
        if np.linalg.norm(theirs) < 1e-6:
            continue
        turns[start] = _shortest_turn(ours, theirs)
        if start.endswith("2"):  # the last bone of a finger has no joint at its end
            turns[f"{start[:-1]}3"] = turns[start]
    return turns


def _shortest_turn(start: np.ndarray, end: np.ndarray) -> Rotation:
    start, end = start / np.linalg.norm(start), end / np.linalg.norm(end)
    axis = np.cross(start, end)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        return Rotation.identity()
    return Rotation.from_rotvec(np.arctan2(sine, float(start @ end)) * axis / sine)


def _rest_place(joints: list[_Joint], index: int) -> np.ndarray:
    place = np.zeros(3)
    while index >= 0:
        place += joints[index].offset
        index = joints[index].parent
    return place


def _check_rest_pose(joints: list[_Joint], found: dict[str, list[int]], name: str) -> None:
    for side, sign in (("left", 1.0), ("right", -1.0)):
        shoulder, elbow = (found.get(f"{side}_{part}") for part in ("shoulder", "elbow"))
        if not shoulder or not elbow:
            continue
        arm = _rest_place(joints, elbow[0]) - _rest_place(joints, shoulder[0])
        if sign * arm[0] < _ALONG * float(np.linalg.norm(arm)):
            raise MotionError(
                f"{name}: the {side} arm of its rest pose does not point along x; only T-poses that"
                " face z can be read. Retarget it first."
            )


def _translation(
    joints: list[_Joint], found: dict[str, list[int]], rows: Float[np.ndarray, "T C"]
) -> tuple[np.ndarray, float]:
    """`trans` in metres, and by what lengths were multiplied."""
    root = found["pelvis"][0]
    first = _first_channel(joints, root)
    at = {each[0]: first + i for i, each in enumerate(joints[root].channels) if "position" in each}
    if set(at) != set("XYZ"):
        return np.zeros((len(rows), 3), np.float32), 1.0
    rest = open_body_skeleton().rest_joints.double().numpy()
    hip, ankle = (found.get(f"left_{part}") for part in ("hip", "ankle"))
    scale = 1.0
    if hip and ankle:
        theirs = np.linalg.norm(_rest_place(joints, ankle[0]) - _rest_place(joints, hip[0]))
        ours = np.linalg.norm(rest[JOINT_INDEX["left_ankle"]] - rest[JOINT_INDEX["left_hip"]])
        scale = float(ours / max(float(theirs), 1e-9))
    if abs(scale - 1.0) < 0.005:
        scale = 1.0
    pelvis = scale * rows[:, [at[axis] for axis in "XYZ"]]
    return (pelvis - rest[0]).astype(np.float32), scale
