"""One door for all files: by its ending each has its reader, and a body that lies is turned
upright."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_INDEX
from model.formats.numbers import ReadMotion, ReadOptions
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion
from model.motion.tracks import track_points
from model.storage.npz import MotionError

ALONG = 0.9
"""Cosine between the mean spine and the axis that is taken as up. A body that lies, on its back or
its side, is turned too; the note says what was done."""
_TURNS = {"z": (2, 1.0, "x", -90.0), "minus y": (1, -1.0, "x", 180.0)}
"""Axis, its sign, and the turn that makes it y."""


def turned_upright(read: ReadMotion, name: str) -> ReadMotion:
    """The motion with y up, and a note where that took a turn."""
    spine = _mean_spine(read.motion)
    for up, (axis, sign, about, degrees) in _TURNS.items():
        if sign * spine[axis] > ALONG:
            turn = Rotation.from_euler(about, degrees, degrees=True)
            note = (
                f"{name} stands along {up}; it was turned by {abs(degrees):.0f}° about {about}, so"
                " that y is up."
            )
            return ReadMotion(_turned(read.motion, turn), (*read.notes, note))
    return read


def _mean_spine(motion: Motion) -> np.ndarray:
    """Mean direction from the pelvis to the neck, of at most 100 frames."""
    some = motion.part(np.arange(0, motion.num_frames, max(1, motion.num_frames // 100)))
    joints = track_points(some, open_body_skeleton()).joints
    spine = (joints[:, JOINT_INDEX["neck"]] - joints[:, JOINT_INDEX["pelvis"]]).mean(axis=0)
    return spine / max(float(np.linalg.norm(spine)), 1e-9)


def _turned(motion: Motion, turn: Rotation) -> Motion:
    """The pelvis, which stands at ``trans`` plus its place in the rest pose, is turned too."""
    poses = motion.poses.reshape(len(motion.poses), -1, 3).copy()
    poses[:, 0] = (turn * Rotation.from_rotvec(poses[:, 0])).as_rotvec()
    rest = open_body_skeleton().rest_joints[0].double().numpy()
    trans = turn.apply(motion.trans + rest) - rest
    return replace(motion, poses=poses.reshape(len(poses), -1), trans=trans.astype(np.float32))


ENDINGS = (".npz", ".npy", ".bvh")
PICKLES = (".pkl", ".pickle", ".pt", ".pth", ".p", ".joblib")
CONVERT = (
    "python -c \"import pickle,numpy,sys; d=pickle.load(open(sys.argv[1],'rb'));"
    " numpy.savez('motion.npz',**{k:numpy.asarray(v) for k,v in d.items()})\" FILE"
)
"""Run by whoever trusts the file: loading a pickle runs what it says."""


def read_any_motion(path: str | Path, options: ReadOptions | None = None) -> ReadMotion:
    """Read a motion file, and say what was changed.

    Taken are npz files as BEAT2, AMASS and many models write them, ``.npy`` arrays and BVH; see
    ``docs/formats.md``. A body whose up is z is turned.

    Raises:
        MotionError: for all else; one sentence that names the file.
    """
    from model.formats.bvh_reader import read_bvh
    from model.formats.numpy_reader import read_npy, read_npz

    path, options = Path(path), options or ReadOptions()
    ending = path.suffix.lower()
    if ending in PICKLES:
        raise MotionError(
            f"{path.name} is a pickle, which can run programs when it is read, and is never loaded."
            f" If you trust it, convert it yourself: {CONVERT}"
        )
    readers = {".npy": read_npy, ".bvh": read_bvh}
    read = readers.get(ending, read_npz)(path, options)
    return turned_upright(read, path.name)
