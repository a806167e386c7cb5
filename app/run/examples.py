"""Example data made without a network: a motion with tremor, and two minutes of planted faults."""

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
"""Motion of 14 s."""
TWO_MINUTES = EXAMPLES / "two_minutes" / "two_minutes.npz"
FAULTY = "system with injected faults"
NOISE_RAD = 0.012
SLIDE_M, SLIDE_S = 0.35, 2.5
"""Distance (m) by which feet slide to the side and back, and duration (s) of one way."""
JUMP_RAD, JUMP_EVERY = 0.06, 52
"""Jump of every joint (rad), and the frames between jumps, as at seams of 60-frame windows."""
FLOAT_M, FLOAT_RISE_S = 0.08, 0.5
CALMER = 0.9


RECORDED = "recorded"


def write_faulty_example(folder: Path) -> list[str]:
    """Write the faulty motion once; return paths of it, its reference, speech and transcript."""
    from model.motion.motion import load_motion, save_motion

    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{FAULTY}.npz"
    if not path.is_file():
        save_motion(inject_faults(load_motion(TWO_MINUTES)), path)
        shutil.copyfile(TWO_MINUTES, folder / f"{RECORDED}.npz")
    speech, transcript = (TWO_MINUTES.with_suffix(ending) for ending in (".ogg", ".TextGrid"))
    return [str(each) for each in (path, folder / f"{RECORDED}.npz", speech, transcript)]


def inject_faults(motion: Motion) -> Motion:
    """Apply all of `INJECTED_FAULTS` to a motion, and reduce its expression by `CALMER`.

    An unchanged face would be reported as a copy of the reference.
    """
    faulty = replace(motion, expressions=(CALMER * motion.expressions).astype("float32"))
    for fault in INJECTED_FAULTS:
        span = slice(round(fault.start_s * FPS), round(fault.end_s * FPS))
        part = fault.apply(faulty.part(span))
        poses, trans = faulty.poses.copy(), faulty.trans.copy()
        poses[span], trans[span] = part.poses, part.trans
        faulty = replace(faulty, poses=poses, trans=trans)
    return faulty


def add_tremble(motion: Motion) -> Motion:
    """Add white noise to the rotations of the right arm, with `NOISE_RAD` about each axis."""
    joints = motion.poses.reshape(len(motion.poses), -1, 3).copy()
    arm = [JOINT_INDEX[f"right_{name}"] for name in ("shoulder", "elbow", "wrist")]
    noise = np.random.default_rng(0).standard_normal((len(joints), len(arm), 3))
    joints[:, arm] += NOISE_RAD * noise
    return replace(motion, poses=joints.reshape(motion.poses.shape).astype(np.float32))


def add_foot_sliding(motion: Motion) -> Motion:
    """Slide the body, with its standing feet, to the side and back."""
    trans = motion.trans.copy()
    way = np.arange(len(trans)) / FPS * np.pi / SLIDE_S
    trans[:, 0] += SLIDE_M * (1.0 - np.cos(way)) / 2.0
    return replace(motion, trans=trans)


def add_window_seams(motion: Motion) -> Motion:
    """Make all joints jump there and back at the seams of simulated windows."""
    joints = motion.poses.reshape(len(motion.poses), -1, 3).copy()
    is_odd = np.arange(len(joints)) // JUMP_EVERY % 2
    joints[:, 1:, 0] += JUMP_RAD * is_odd[:, None]
    return replace(motion, poses=joints.reshape(motion.poses.shape).astype(np.float32))


def freeze_motion(motion: Motion) -> Motion:
    """Hold the first pose."""
    poses, trans = motion.poses.copy(), motion.trans.copy()
    poses[:], trans[:] = poses[0], trans[0]
    return replace(motion, poses=poses, trans=trans)


def lift_body(motion: Motion) -> Motion:
    """Lift the body off the floor by `FLOAT_M`, and lower it again."""
    trans = motion.trans.copy()
    since = np.arange(len(trans)) / FPS
    rise = np.minimum(np.minimum(since, since[::-1]) / FLOAT_RISE_S, 1.0)
    trans[:, 1] += FLOAT_M * rise**2 * (3.0 - 2.0 * rise)
    return replace(motion, trans=trans)


@dataclass(frozen=True)
class InjectedFault:
    """Fault and the time span (s) in which it is planted."""

    name: str
    apply: Callable[[Motion], Motion]
    start_s: float
    end_s: float


INJECTED_FAULTS = (
    InjectedFault("sliding feet", add_foot_sliding, 4, 114),
    InjectedFault("trembling right arm", add_tremble, 20, 100),
    InjectedFault("window seams every 52 frames", add_window_seams, 50, 86),
    InjectedFault("nothing moves", freeze_motion, 90.25, 92.75),
    InjectedFault("floating", lift_body, 100, 108),
)
"""Planted faults; those that are detected by the mean or median of all frames last longer."""


FIRST_LOOK = EXAMPLES / "first_look"
"""Run folder of the motion that a fresh page shows, made with the bundled weights by `python -m
tests.app.run.made_first_look`."""
FIRST_MOTION = FIRST_LOOK / "viewer" / "A.npz"
FIRST_LOOK_METADATA = "first_look.json"
"""File in `FIRST_LOOK`: the source of the motion."""
