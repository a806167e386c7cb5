"""Every gesture of the library, on the open body."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image

from conventions.joints import NUM_JOINTS
from renderer.body.body import BodyMotion, load_body
from renderer.video.compose import label_band
from renderer.video.render import RenderSettings, draw_frames
from tools.corpus.body.arms import follow_plan, move_arms
from tools.corpus.body.contact import hips_of
from tools.corpus.body.trunk import PELVIS_TILT_DEG, SPINE
from tools.corpus.gesture.gestures import GESTURES, REST, HandPose
from tools.corpus.gesture.plan import HandKey, HandPlan
from tools.corpus.people.rig import Rig, axis_angles, euler_matrices
from tools.corpus.people.speaker import SPEAKERS

COLUMNS, SIZE_PX = 8, 144
VIEW = "three_quarter"


def draw_gestures(rig: Rig, path: Path) -> None:
    """One picture a gesture at the end of its stroke, and one a rest pose.

    Raises:
        GLError: if nothing draws here.
    """
    poses = {name: (gesture.stroke, gesture.hands) for name, gesture in GESTURES.items()}
    poses |= {f"rest: {name}": (pose, "two") for name, pose in REST.items()}
    held = [_held(rig, pose, both=hands in ("two", "free")) for pose, hands in poses.values()]
    motion = replace(BodyMotion.resting(len(held)), poses=np.stack(held))
    settings = RenderSettings(SIZE_PX, SIZE_PX, VIEW, framing="knees")
    pictures = [picture.copy() for picture in draw_frames(load_body(), motion, settings)]
    names = [name.replace("_", " ") for name in poses]
    missing = -len(pictures) % COLUMNS
    pictures += [np.full_like(pictures[0], 255)] * missing
    names += [""] * missing
    rows = []
    for start in range(0, len(pictures), COLUMNS):
        row = slice(start, start + COLUMNS)
        rows += [label_band(names[row], SIZE_PX, 2 * SIZE_PX), np.hstack(pictures[row])]
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.vstack(rows)).quantize(256).save(path, optimize=True)


def _held(rig: Rig, pose: HandPose, both: bool) -> Float[np.ndarray, " 165"]:
    """A standing body with one or both hands held in a pose, radians."""
    other = pose if both else REST["hang"]
    keys = {
        "right": [HandKey(-1.0, 0.5, pose, "stroke", "")],
        "left": [HandKey(-1.0, 0.5, other, "stroke", "")],
    }
    rng, num_frames = np.random.default_rng(0), 31
    speaking = np.zeros(num_frames)
    posture = ((0, PELVIS_TILT_DEG), *((joint, bend) for joint, _, bend in SPINE))
    trunk = {
        joint: euler_matrices("X", np.full((num_frames, 1), pitch)) for joint, pitch in posture
    }
    curves = follow_plan(rig, HandPlan(keys), speaking, SPEAKERS[0], rng)
    arms = move_arms(rig, HandPlan(keys), curves, hips_of(rig, trunk), speaking, SPEAKERS[0], rng)
    vectors = np.zeros((NUM_JOINTS, 3))
    for joint, rotmat in (trunk | arms).items():
        vectors[joint] = axis_angles(rotmat[num_frames // 2])
    return vectors.ravel()
