"""Command ``python -m tools.bake.gesture_pictures OUT.json``: stick figures of the gesture palette.

Each kind is made once by `workbench/planned` in silence, as the editor adds it, and stored as few
points over time, seen from the front.
"""

import base64
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from conventions.rates import FPS, SAMPLE_RATE
from model.generation.base import Sampling, System
from model.generation.windows import GenerateOptions, generate_motion
from model.motion.kinematics import open_body_skeleton
from model.motion.tracks import track_points
from model.plan.editing import add_gesture
from model.plan.kinds import USUAL_STROKE_GOALS
from model.plan.plan import GesturePlan
from model.speech.audio import Speech
from model.storage.files import write_atomically
from model.systems.registry import default_planning_system, load_system

DURATION_S, LANDS_S = 3.0, 1.3
STEP, WARM_UP_DELAY_S, NUM_FRAMES = 4, 0.4, 14
"""Frames between two stored ones, start, and number of stored ones."""
CHAINS = (
    ("head", "neck", "pelvis"),
    *(
        chain
        for side in ("left", "right")
        for chain in (
            ("neck", f"{side}_shoulder", f"{side}_elbow", f"{side}_wrist"),
            *(
                (f"{side}_wrist", f"{side}_{finger}1", f"{side}_{finger}2", f"{side}_{finger}")
                for finger in ("index", "middle", "pinky", "thumb")
            ),
        )
    ),
)
"""Polylines of the figure, by names of joints and fingertips."""
POINTS = tuple(dict.fromkeys(name for chain in CHAINS for name in chain))
LEFT_M, TOP_M, SIZE_M = -0.55, 1.72, 1.1
"""Left and upper edge of the picture and its size, in world metres."""


def picture(system: System, kind: str) -> UInt8[np.ndarray, "F P 2"]:
    """Return the points of one kind over time as shares of the picture, 0 to 255."""
    plan = add_gesture(GesturePlan(DURATION_S), kind, LANDS_S).plan
    silence = Speech(np.zeros(round(DURATION_S * SAMPLE_RATE), np.float32), "")
    options = GenerateOptions(
        speaker=next(iter(system.speakers)),
        conditions=(plan,),
        **vars(system.resolve_sampling(Sampling())),
    )
    (motion,) = generate_motion(system, silence, options)
    motion = replace(motion, trans=motion.trans - motion.trans[:1] * [1.0, 0.0, 1.0])
    tracks = track_points(motion, open_body_skeleton())
    first = round(WARM_UP_DELAY_S * FPS)
    frames = slice(first, first + STEP * NUM_FRAMES, STEP)
    places = np.stack([tracks.point(name)[frames, :2] for name in POINTS], axis=1)
    shares = (places - [LEFT_M, TOP_M]) * [1.0, -1.0] / SIZE_M
    return np.clip(np.rint(255.0 * shares), 0, 255).astype(np.uint8)


def main(out: Path) -> None:
    """Write the pictures of all kinds."""
    system = load_system(default_planning_system())
    content = {
        "frames": NUM_FRAMES,
        "fps": FPS / STEP,
        "still": round((LANDS_S - WARM_UP_DELAY_S) * FPS / STEP),
        "chains": [[POINTS.index(name) for name in chain] for chain in CHAINS],
        "points": {
            kind: base64.b64encode(picture(system, kind).tobytes()).decode()
            for kind in sorted(USUAL_STROKE_GOALS)
        },
    }
    write_atomically(out, json.dumps(content, separators=(",", ":")) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
