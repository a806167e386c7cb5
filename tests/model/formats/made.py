"""A person's motion, and files of it in drawn conventions; what is right of a reading of them."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from conventions.joints import HANDS, JOINT_INDEX, JOINT_NAMES, NUM_JOINTS, PARENTS
from model.formats.convention_detection import MEAN_HANDS_SUBSTITUTE
from model.formats.read import read_any_motion
from model.formats.reading import ImportedMotion, ImportOverrides
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion
from model.motion.tracks import track_points
from model.storage.npz import MotionError

REST = open_body_skeleton().rest_joints.double().numpy()
FROM_Y = {
    "y": Rotation.identity(),
    "-y": Rotation.from_euler("x", 180, degrees=True),
    "z": Rotation.from_euler("x", 90, degrees=True),
    "-z": Rotation.from_euler("x", -90, degrees=True),
    "x": Rotation.from_euler("z", -90, degrees=True),
    "-x": Rotation.from_euler("z", 90, degrees=True),
}
"""What takes a body with y up to one that stands along another axis."""
FROM_Z = {"z": 0, "x": 90, "-z": 180, "-x": -90}
SCALES = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
_HANGING = {
    "left_shoulder": (0.0, -0.2, -0.9), "right_shoulder": (0.0, 0.2, 0.9),
    "left_elbow": (0.1, -0.9, 0.1), "right_elbow": (0.1, 0.9, -0.1),
    "left_knee": (0.1, 0.0, 0.0), "right_knee": (0.1, 0.0, 0.0),
}  # fmt: skip
BODY_JOINTS = list(range(22))


@dataclass(frozen=True)
class Person:
    """A motion as a smooth function of time."""

    seed: int

    def motion(self, frames: int, fps: float = 30.0) -> Motion:
        """Arms hang and gesture, a body sways above feet that stand, fingers are relaxed."""
        rng = np.random.default_rng(self.seed)
        time_s = np.arange(frames)[:, None, None] / fps

        def waves(joints: int, radians: float) -> np.ndarray:
            hz = rng.uniform(0.1, 0.8, (1, joints, 3))
            phase = rng.uniform(0, 2 * np.pi, (1, joints, 3))
            return radians * np.sin(2 * np.pi * hz * time_s + phase)

        poses = waves(NUM_JOINTS, 0.06)
        for name, turn in _HANGING.items():
            poses[:, JOINT_INDEX[name]] += turn
        arms = [JOINT_INDEX[f"{side}_{at}"] for side in ("left", "right") for at in ("elbow",)]
        poses[:, arms] += waves(len(arms), 0.3)
        poses[:, list(HANDS)] += MEAN_HANDS_SUBSTITUTE
        poses[:, 0] += (0.0, rng.uniform(-0.4, 0.4), 0.0)
        trans = np.array([0.0, rng.uniform(1.1, 1.3), 0.0]) + waves(1, 0.03)[:, 0]
        faces = np.zeros((frames, 100))
        faces[:, :50] = waves(17, 0.5).reshape(frames, -1)[:, :50]
        return Motion(
            poses.reshape(frames, -1).astype(np.float32),
            trans.astype(np.float32),
            faces.astype(np.float32),
            "flame100",
            np.zeros(300, np.float32),
        )


def joints_of(motion: Motion) -> np.ndarray:
    """(T, 55, 3), metres."""
    return track_points(motion, open_body_skeleton()).joints


def turned(motion: Motion, turn: Rotation) -> tuple[np.ndarray, np.ndarray]:
    """Poses (T, 55, 3) and translation of the body turned about the world's origin."""
    poses = motion.poses.reshape(-1, NUM_JOINTS, 3).astype(np.float64)
    poses[:, 0] = (turn * Rotation.from_rotvec(poses[:, 0])).as_rotvec()
    return poses, turn.apply(motion.trans + REST[0]) - REST[0]


def in_form(poses: np.ndarray, form: str) -> np.ndarray:
    """(T, J, numbers) of axis-angle (T, J, 3)."""
    turns = Rotation.from_rotvec(poses.reshape(-1, 3))
    matrices = turns.as_matrix().reshape(*poses.shape[:2], 3, 3)
    columns = np.swapaxes(matrices, -1, -2)[..., :2, :]
    flat = {
        "axis-angle": lambda: poses,
        "6d": lambda: matrices[..., :2, :],
        "6d-columns": lambda: columns,
        "6d-interleaved": lambda: np.swapaxes(columns, -1, -2),
        "quaternion-xyzw": turns.as_quat,
        "quaternion-wxyz": lambda: np.roll(turns.as_quat(), 1, axis=-1),
        "matrix": lambda: matrices,
    }
    return np.asarray(flat[form]()).reshape(*poses.shape[:2], -1)


@dataclass(frozen=True)
class Drawn:
    """One file, and of what motion it is."""

    path: Path
    truth: Motion
    """At 30 frames a second."""
    said: dict[str, str]
    """The conventions."""
    joints: list[int]
    """Those that the file has."""
    tolerance_m: float = 1e-3

    def outcome(self, told: ImportOverrides | None = None) -> tuple[str, ImportedMotion | None]:
        """``right``, ``unsure`` or ``silent`` (wrong, and told as unsure or not), ``refused``."""
        try:
            reading = read_any_motion(self.path, told)
        except MotionError:
            return "refused", None
        if self.apart_m(reading.motion) < self.tolerance_m:
            return "right", reading
        is_told = any(each.confidence == "unsure" for each in reading.assumptions)
        return "unsure" if is_told else "silent", reading

    def apart_m(self, motion: Motion) -> float:
        """The largest distance of a joint, seen from the pelvis, and of the pelvis's way."""
        found, wanted = joints_of(motion), joints_of(self.truth)
        if abs(len(found) - len(wanted)) > 2:
            return float("inf")
        frames = min(len(found), len(wanted))
        found, wanted = found[:frames], wanted[:frames]
        poses = found[:, self.joints] - found[:, :1] - wanted[:, self.joints] + wanted[:, :1]
        if self.said.get("trans") == "none":
            return float(np.linalg.norm(poses, axis=-1).max())
        ways = [each[:, 0] - each[0, 0] for each in (found, wanted)]
        way = np.linalg.norm(ways[0] - ways[1], axis=-1).max()
        return float(max(np.linalg.norm(poses, axis=-1).max(), way))


def drawn(seed: int, folder: Path) -> Drawn:
    """A file in a convention of its own."""
    rng = np.random.default_rng(seed)
    kinds: list[Callable[[int, np.random.Generator, Path], Drawn]] = [_npz, _npz, _npy, _bvh]
    return kinds[seed % 4](seed, rng, folder)


def _pick(rng: np.random.Generator, *values: str) -> str:
    return str(rng.choice(np.array(values)))


def _person(
    seed: int, rng: np.random.Generator, rate: float, up: str, facing: str
) -> tuple[Motion, np.ndarray, np.ndarray, np.ndarray]:
    """The truth; poses, translation and face as the file has them."""
    person, seconds = Person(seed), float(rng.uniform(2.0, 4.0))
    truth = person.motion(int(seconds * 30), 30.0)
    filed = person.motion(int(seconds * rate), rate)
    turn = FROM_Y[up] * Rotation.from_euler("y", FROM_Z[facing], degrees=True)
    poses, trans = turned(filed, turn)
    return truth, poses, trans, filed.expressions


def _npz(seed: int, rng: np.random.Generator, folder: Path) -> Drawn:
    rate = _pick(rng, "30", "30", "25", "60", "120")
    up, facing = _pick(rng, *FROM_Y), _pick(rng, "z", "z", *FROM_Z)
    units = _pick(rng, *SCALES)
    form = _pick(rng, "axis-angle", "axis-angle", "6d", "6d-columns", "6d-interleaved",
                 "quaternion-wxyz", "quaternion-xyzw", "matrix")  # fmt: skip
    layout = _pick(rng, "poses", "poses", "joints", "parts", "batch", "other key")
    count = int(_pick(rng, "55", "55", "52", "24", "22", "53"))
    prefix = _pick(rng, "", "", "smplx:", "clip7/", "pred_")
    hands = _pick(rng, "flat", "mean") if layout == "parts" else "flat"
    truth, poses, trans, faces = _person(seed, rng, float(rate), up, facing)
    trans = (trans * SCALES[units]).astype(np.float32)
    if hands == "mean":
        poses[:, list(HANDS)] -= MEAN_HANDS_SUBSTITUTE
    sets = {55: list(range(55)), 52: [*BODY_JOINTS, *HANDS], 53: [*BODY_JOINTS, 22, *HANDS]}
    joints = sets.get(count, BODY_JOINTS)
    rows = in_form(poses[:, joints], form)
    if count == 24:
        rest = in_form(np.zeros((len(poses), 2, 3)), form)
        rows = np.concatenate([rows, rest], axis=1)
    rows = rows.astype(np.float32)
    flat = rows.reshape(len(rows), -1)
    arrays: dict[str, np.ndarray] = {"trans": trans, "mocap_frame_rate": np.array(float(rate))}
    match layout:
        case "joints":
            arrays["poses"] = rows
        case "batch":
            arrays |= {"poses": flat[None], "trans": trans[None]}
        case "other key":
            arrays["fullpose"] = flat
            arrays["transl"] = arrays.pop("trans")
        case "parts":
            joints = sets[55]
            parts = {"global_orient": [0], "body_pose": BODY_JOINTS[1:], "jaw_pose": [22],
                     "leye_pose": [23], "reye_pose": [24], "left_hand_pose": list(HANDS[:15]),
                     "right_hand_pose": list(HANDS[15:])}  # fmt: skip
            arrays |= {
                key: in_form(poses[:, of], form).astype(np.float32) for key, of in parts.items()
            }
        case _:
            arrays["poses"] = flat
    if rng.random() < 0.5:
        arrays["expressions"] = faces
    if rng.random() < 0.5:
        arrays["betas"] = np.zeros((1, int(_pick(rng, "10", "16", "300"))))
    if rng.random() < 0.3:
        arrays["gender"] = np.array(None, dtype=object)
    path = folder / f"{seed}.npz"
    np.savez(path, **{prefix + key: array for key, array in arrays.items()})
    said = {"up": up, "facing": facing, "units": units, "rotations": form, "rate": rate,
            "layout": layout, "joints": str(count), "hands": hands, "prefix": prefix}  # fmt: skip
    seen = joints if count not in (24, 22) or layout == "parts" else BODY_JOINTS
    return Drawn(path, truth, said, seen, 1e-3 if rate == "30" else 4e-3)


def _npy(seed: int, rng: np.random.Generator, folder: Path) -> Drawn:
    layout = _pick(rng, "talkshow", "motionx", "268", "rows", "joints")
    up, facing = _pick(rng, *FROM_Y), _pick(rng, "z", "z", *FROM_Z)
    form = "axis-angle"
    hands = _pick(rng, "flat", "mean") if layout in ("talkshow", "motionx") else "flat"
    truth, poses, trans, faces = _person(seed, rng, 30.0, up, facing)
    if hands == "mean":
        poses[:, list(HANDS)] -= MEAN_HANDS_SUBSTITUTE
    flat = poses.reshape(len(poses), -1)
    said = {"up": up, "facing": facing, "layout": layout, "hands": hands}
    match layout:
        case "talkshow":
            columns = [flat[:, 66:69], flat[:, 69:75], flat[:, :66], flat[:, 75:], faces]
            said["trans"] = "none"
        case "motionx":
            columns = [flat[:, :66], flat[:, 75:], flat[:, 66:69], faces[:, :50], 0 * faces, trans,
                       np.zeros((len(flat), 10))]  # fmt: skip
        case "268":
            columns = [flat, trans, faces]
        case _:
            form = _pick(rng, "axis-angle", "6d", "6d-columns", "quaternion-wxyz",
                         "quaternion-xyzw", "matrix")  # fmt: skip
            rows = in_form(poses, form)
            columns = [rows.reshape(len(rows), -1)]
            said |= {"trans": "none", "rotations": form}
    array = np.concatenate(columns, axis=1).astype(np.float32)
    if layout == "joints":
        array = array.reshape(len(array), NUM_JOINTS, -1)
    path = folder / f"{seed}.npy"
    np.save(path, array)
    return Drawn(path, truth, said, list(range(NUM_JOINTS)))


def _suffixed(name: str) -> str:
    side, _, part = name.partition("_")
    if side not in ("left", "right"):
        return name
    part = f"{part[:-1]}_0{part[-1]}" if part[-1].isdigit() else part
    return f"{part}_{side[0]}"


_NAMES: dict[str, Callable[[str], str]] = {
    "ours": str,
    "mixamo": lambda name: f"mixamorig:{_MIXAMO.get(name, name)}",
    "underscore": lambda name: f"mixamorig_{_MIXAMO.get(name, name)}",
    "unreal": _suffixed,
    "short": lambda name: name.replace("left_", "L_").replace("right_", "R_"),
    "spaces": lambda name: name.replace("_", " ").title(),
}
_MIXAMO = {
    "pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2", "neck": "Neck",
    "head": "Head",
    **{
        f"{side.lower()}_{ours}": f"{side}{theirs}"
        for side in ("Left", "Right")
        for ours, theirs in {
            "collar": "Shoulder", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand",
            "hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "foot": "ToeBase",
        }.items()
    },
    **{
        f"{side.lower()}_{finger.lower()}{i}": f"{side}Hand{finger}{i}"
        for side in ("Left", "Right")
        for finger in ("Index", "Middle", "Pinky", "Ring", "Thumb")
        for i in (1, 2, 3)
    },
}  # fmt: skip


def _bvh(seed: int, rng: np.random.Generator, folder: Path) -> Drawn:
    """Our skeleton under other names and axes, with or without fingers, resting in T or A."""
    up, facing = _pick(rng, *FROM_Y), _pick(rng, *FROM_Z)
    units, names = _pick(rng, *SCALES), _pick(rng, *_NAMES)
    rate = _pick(rng, "30", "60", "120")
    has_fingers, has_root = bool(rng.random() < 0.5), bool(rng.random() < 0.3)
    arms_deg = float(rng.choice(np.array([0.0, 35.0])))
    order = _pick(rng, "ZXY", "XYZ", "ZYX")
    person, seconds = Person(seed), float(rng.uniform(2.0, 3.0))
    truth = person.motion(int(seconds * 30), 30.0)
    filed = person.motion(int(seconds * float(rate)), float(rate))
    joints = [*BODY_JOINTS, *(HANDS if has_fingers else ())]
    text = bvh_text(
        filed,
        joints,
        FROM_Y[up] * Rotation.from_euler("y", FROM_Z[facing], degrees=True),
        SCALES[units],
        [_NAMES[names](JOINT_NAMES[joint]) for joint in joints],
        arms_deg,
        order,
        has_root,
        float(rate),
    )
    path = folder / f"{seed}.bvh"
    path.write_text(text)
    said = {"up": up, "facing": facing, "units": units, "names": names, "rate": rate,
            "fingers": str(has_fingers), "root": str(has_root), "arms": str(arms_deg),
            "order": order}  # fmt: skip
    return Drawn(path, truth, said, joints, 2e-3)


def bvh_text(
    motion: Motion,
    joints: list[int],
    turn: Rotation,
    scale: float,
    names: list[str],
    arms_deg: float = 0.0,
    order: str = "ZXY",
    has_root: bool = False,
    fps: float = 30.0,
    is_along_x: bool = False,
    has_places: bool = False,
) -> str:
    """A skeleton of ours in other axes, resting with its arms so far below ours, or with all bones
    along x; every joint may tell its place beside its parent."""
    world = [Rotation.identity()] * NUM_JOINTS
    for joint in range(NUM_JOINTS):
        local = Rotation.from_rotvec(motion.poses.reshape(-1, NUM_JOINTS, 3)[:, joint])
        world[joint] = local if joint == 0 else world[PARENTS[joint]] * local
    lowered = [Rotation.identity()] * NUM_JOINTS  # of each joint's bones at rest
    for joint in range(1, NUM_JOINTS):
        lowered[joint] = lowered[PARENTS[joint]]
        for side, sign in (("left", -1.0), ("right", 1.0)):
            if JOINT_NAMES[joint] == f"{side}_shoulder":
                lowered[joint] = Rotation.from_euler("z", sign * arms_deg, degrees=True)
        bones = [REST[each] - REST[joint] for each in joints if PARENTS[each] == joint]
        if is_along_x and bones:
            lowered[joint] = Rotation.align_vectors([[1.0, 0.0, 0.0]], bones[-1:])[0]
    filed = [turn * world[j] * lowered[j].inv() * turn.inv() for j in range(NUM_JOINTS)]
    lines, rows = ["HIERARCHY"], []
    pelvis = turn.apply(motion.trans + REST[0]) * scale
    if has_root:
        lines += ["ROOT Reference", "{", "OFFSET 0 0 0",
                  "CHANNELS 3 Xposition Yposition Zposition"]  # fmt: skip
        rows.append(pelvis)

    def add(joint: int) -> None:
        parent = PARENTS[joint]
        bone = np.zeros(3) if joint == 0 else lowered[parent].apply(REST[joint] - REST[parent])
        bone = turn.apply(bone) * scale
        offset = " ".join(f"{value:.6f}" for value in bone)
        is_top = joint == 0 and not has_root
        is_told = is_top or has_places
        places = "Xposition Yposition Zposition " if is_told else ""
        turns = " ".join(f"{axis}rotation" for axis in order)
        kind = "ROOT" if is_top else "JOINT"
        lines.extend(
            [f"{kind} {names[joints.index(joint)]}", "{", f"OFFSET {offset}",
             f"CHANNELS {6 if is_told else 3} {places}{turns}"]
        )  # fmt: skip
        if is_told:
            rows.append(pelvis if is_top else np.tile(bone, (motion.num_frames, 1)))
        local = filed[joint] if joint == 0 else filed[parent].inv() * filed[joint]
        rows.append(local.as_euler(order, degrees=True))
        below = [each for each in joints if PARENTS[each] == joint]
        for each in below:
            add(each)
        if not below:
            lines.extend(["End Site", "{", "OFFSET 0 0 0", "}"])
        lines.append("}")

    add(0)
    lines += ["}"] if has_root else []
    table = np.concatenate(rows, axis=1)
    lines += ["MOTION", f"Frames: {len(table)}", f"Frame Time: {1 / fps:.8f}"]
    lines += [" ".join(f"{value:.6f}" for value in row) for row in table]
    return "\n".join(lines) + "\n"
