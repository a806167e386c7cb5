"""An example of what the diagnostics find: one motion, and copies of it with planted faults."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from app.config import EXAMPLES

if TYPE_CHECKING:
    from model.motion.motion import Motion

CLEAN = EXAMPLES / "procedural_speaker" / "a_procedural_speaker.npz"
NOISE_RAD = 0.012
SLIDE_M, SLIDE_S = 0.35, 2.5
"""How far feet slide to the side and back, and how long one way takes."""
JUMP_RAD, JUMP_EVERY = 0.06, 52
"""Of every joint, where windows of 60 frames join."""
CALMER = 0.9


def planted_files(folder: Path) -> tuple[list[str], str, str, str]:
    """The motions, which are made once, and their reference, speech and transcript as files."""
    from model.motion.motion import load_motion, save_motion

    folder.mkdir(parents=True, exist_ok=True)
    clean = load_motion(CLEAN)
    paths = []
    for name, plant in PLANTS.items():
        path = folder / f"{name}.npz"
        if not path.is_file():
            save_motion(plant(clean), path)
        paths.append(str(path))
    return paths, str(CLEAN), str(CLEAN.with_suffix(".wav")), str(CLEAN.with_suffix(".TextGrid"))


def _calmer_face(motion: Motion) -> Motion:
    """Else it would be found to be copied, which is not what is shown."""
    return replace(motion, expressions=(CALMER * motion.expressions).astype("float32"))


def _trembling(motion: Motion) -> Motion:
    return tremble(_calmer_face(motion))


def tremble(motion: Motion) -> Motion:
    """White noise on the rotations of the right arm, `NOISE_RAD` about each axis."""
    import numpy as np

    from model.motion.skeleton import JOINT_INDEX

    joints = motion.poses.reshape(len(motion.poses), -1, 3).copy()
    arm = [JOINT_INDEX[f"right_{name}"] for name in ("shoulder", "elbow", "wrist")]
    noise = np.random.default_rng(0).standard_normal((len(joints), len(arm), 3))
    joints[:, arm] += NOISE_RAD * noise
    return replace(motion, poses=joints.reshape(motion.poses.shape).astype(np.float32))


def _sliding(motion: Motion) -> Motion:
    import numpy as np

    from model.motion.timing import FPS

    trans = motion.trans.copy()
    way = np.arange(len(trans)) / FPS * np.pi / SLIDE_S
    trans[:, 0] += SLIDE_M * (1.0 - np.cos(way)) / 2.0
    return replace(_calmer_face(motion), trans=trans)


def _joined(motion: Motion) -> Motion:
    import numpy as np

    joints = motion.poses.reshape(len(motion.poses), -1, 3).copy()
    is_odd = np.arange(len(joints)) // JUMP_EVERY % 2
    joints[:, 1:, 0] += JUMP_RAD * is_odd[:, None]
    return replace(
        _calmer_face(motion), poses=joints.reshape(motion.poses.shape).astype(np.float32)
    )


PLANTS: dict[str, Callable[[Motion], Motion]] = {
    "trembling right arm": _trembling,
    "sliding feet": _sliding,
    "joins every 52 frames": _joined,
    "an untouched copy": lambda motion: motion,
}
"""What is planted, by the name of the file."""
