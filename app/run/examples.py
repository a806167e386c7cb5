"""What is made without a network: a motion with a tremble, two minutes with planted faults."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.config import EXAMPLES
from conventions.joints import JOINT_INDEX
from conventions.rates import FPS

if TYPE_CHECKING:
    from model.motion.motion import Motion


CLEAN = EXAMPLES / "procedural_speaker" / "a_procedural_speaker.npz"
"""14 s of motion."""
TWO_MINUTES = EXAMPLES / "two_minutes" / "two_minutes.npz"
FAULTY = "a system with faults"
NOISE_RAD = 0.012
SLIDE_M, SLIDE_S = 0.35, 2.5
"""How far feet slide to the side and back, and how long one way takes."""
JUMP_RAD, JUMP_EVERY = 0.06, 52
"""Of every joint, where windows of 60 frames join."""
FLOAT_M, FLOAT_RISE_S = 0.08, 0.5
CALMER = 0.9


RECORDED = "recorded"


def planted_files(folder: Path) -> list[str]:
    """The motion with faults, which is made once, and its reference, speech and transcript."""
    from model.motion.motion import load_motion, save_motion

    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{FAULTY}.npz"
    if not path.is_file():
        save_motion(with_faults(load_motion(TWO_MINUTES)), path)
        shutil.copyfile(TWO_MINUTES, folder / f"{RECORDED}.npz")
    speech, transcript = (TWO_MINUTES.with_suffix(ending) for ending in (".ogg", ".TextGrid"))
    return [str(each) for each in (path, folder / f"{RECORDED}.npz", speech, transcript)]


def with_faults(motion: Motion) -> Motion:
    """All of `PLANTS`, each in its seconds; the face is a calmer one all the while, or it would be
    found to be copied, which is not what is shown."""
    faulty = replace(motion, expressions=(CALMER * motion.expressions).astype("float32"))
    for plant in PLANTS:
        span = slice(round(plant.from_s * FPS), round(plant.to_s * FPS))
        part = plant.change(faulty.part(span))
        poses, trans = faulty.poses.copy(), faulty.trans.copy()
        poses[span], trans[span] = part.poses, part.trans
        faulty = replace(faulty, poses=poses, trans=trans)
    return faulty


def tremble(motion: Motion) -> Motion:
    """White noise on the rotations of the right arm, `NOISE_RAD` about each axis."""
    joints = motion.poses.reshape(len(motion.poses), -1, 3).copy()
    arm = [JOINT_INDEX[f"right_{name}"] for name in ("shoulder", "elbow", "wrist")]
    noise = np.random.default_rng(0).standard_normal((len(joints), len(arm), 3))
    joints[:, arm] += NOISE_RAD * noise
    return replace(motion, poses=joints.reshape(motion.poses.shape).astype(np.float32))


def slide(motion: Motion) -> Motion:
    """Feet that stand glide to the side and back."""
    trans = motion.trans.copy()
    way = np.arange(len(trans)) / FPS * np.pi / SLIDE_S
    trans[:, 0] += SLIDE_M * (1.0 - np.cos(way)) / 2.0
    return replace(motion, trans=trans)


def join(motion: Motion) -> Motion:
    """All joints jump, and back, where windows would meet."""
    joints = motion.poses.reshape(len(motion.poses), -1, 3).copy()
    is_odd = np.arange(len(joints)) // JUMP_EVERY % 2
    joints[:, 1:, 0] += JUMP_RAD * is_odd[:, None]
    return replace(motion, poses=joints.reshape(motion.poses.shape).astype(np.float32))


def freeze(motion: Motion) -> Motion:
    """Nothing moves."""
    poses, trans = motion.poses.copy(), motion.trans.copy()
    poses[:], trans[:] = poses[0], trans[0]
    return replace(motion, poses=poses, trans=trans)


def lift(motion: Motion) -> Motion:
    """The body leaves the floor by `FLOAT_M`, and comes back to it."""
    trans = motion.trans.copy()
    since = np.arange(len(trans)) / FPS
    rise = np.minimum(np.minimum(since, since[::-1]) / FLOAT_RISE_S, 1.0)
    trans[:, 1] += FLOAT_M * rise**2 * (3.0 - 2.0 * rise)
    return replace(motion, trans=trans)


@dataclass(frozen=True)
class Plant:
    """A fault, and the seconds that it is planted in."""

    name: str
    change: Callable[[Motion], Motion]
    from_s: float
    to_s: float


PLANTS = (
    Plant("sliding feet", slide, 4, 114),
    Plant("trembling right arm", tremble, 20, 100),
    Plant("joins every 52 frames", join, 50, 86),
    Plant("nothing moves", freeze, 90.25, 92.75),
    Plant("floating", lift, 100, 108),
)
"""Longer where a fault counts by the mean or the median of all frames."""


STEADY, TREMBLING = "A", "B"
FIRST_LOOK = EXAMPLES / "first_look"
"""What a fresh page shows first: a run's folder that `python -m tests.app.run.made_first_look` has
made with the bundled weights."""
FACTS = "first_look.json"
"""In it: jerk of both fingertips in m/s^3 by row, the noise, and where the motion comes from."""
