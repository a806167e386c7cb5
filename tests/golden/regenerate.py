"""Golden pictures: what the renderer draws, kept to see when it changes.

``make golden`` re-makes them by what draws here; EGL by software and OSMesa draw
the same. Look at them before committing, and commit them alone.
"""

import argparse
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from PIL import Image

from conventions.joints import JOINT_INDEX
from conventions.views import BODY_LOOKS
from renderer.body.body import Body, BodyMotion, load_body
from renderer.draw.offscreen import BACKENDS, Backend
from renderer.draw.probe import choose_backend
from renderer.video.render import RenderSettings
from tests.renderer.drawn import render_stills

GOLDEN = Path(__file__).parent
ROOT = GOLDEN.parents[1]
SIZE = (480, 270)

# Rotations about x, y, z in degrees, of joints that do not rest.
REST: dict[str, tuple[float, float, float]] = {}
GESTURE = {
    "left_shoulder": (0.0, -20.0, -40.0),
    "right_shoulder": (0.0, 25.0, 62.0),
    "left_elbow": (0.0, -75.0, -10.0),
    "right_elbow": (-15.0, 70.0, 0.0),
    "right_wrist": (-30.0, 0.0, 0.0),
    "spine2": (6.0, 10.0, 0.0),
    "head": (0.0, 15.0, 5.0),
    "left_knee": (18.0, 0.0, 0.0),
    "left_hip": (-14.0, 0.0, 4.0),
    **{f"right_{finger}{k}": (0.0, 0.0, 38.0) for finger in ("ring", "pinky") for k in (1, 2)},
    **{f"left_{finger}1": (0.0, 0.0, -25.0) for finger in ("index", "middle")},
}
SPEAKING = {**GESTURE, "jaw": (5.0, 0.0, 0.0), "left_eye": (0.0, 12.0, 0.0)}
FACE = {"jawOpen": 0.3, "mouthSmileLeft": 0.7, "browInnerUp": 0.6, "eyeBlinkRight": 1.0}


@dataclass(frozen=True)
class Picture:
    rotations_deg: dict[str, tuple[float, float, float]]
    view: str
    look: str = BODY_LOOKS[0]
    expressions: dict[str, float] = field(default_factory=dict)


PICTURES = {
    "rest": Picture(REST, "front"),
    "gesture": Picture(GESTURE, "three_quarter"),
    "hand": Picture(GESTURE, "right_hand"),
    "face": Picture(SPEAKING, "face", expressions=FACE),
    "slender": Picture(GESTURE, "front", "slender-medium"),
    "broad": Picture(GESTURE, "side", "broad-dark"),
    "clay": Picture(SPEAKING, "face", "slender-clay", FACE),
}


def posed(picture: Picture, body: Body) -> BodyMotion:
    """One frame with the joints and the face of a picture."""
    poses, expressions = np.zeros((1, 55, 3)), np.zeros((1, 100))
    for name, degrees in picture.rotations_deg.items():
        poses[0, JOINT_INDEX[name]] = np.deg2rad(degrees)
    for name, amount in picture.expressions.items():
        expressions[0, body.expression_names.index(name)] = amount
    resting = BodyMotion.zero_pose(expression_basis=body.expression_basis)
    return replace(resting, poses=poses.reshape(1, 165), expressions=expressions)


def draw_all(backend: Backend, folder: Path) -> None:
    """Write every picture as ``folder/NAME.png``. One process draws through one backend only."""
    for name, picture in PICTURES.items():
        body = load_body(look=picture.look)
        settings = RenderSettings(*SIZE, view=picture.view, backend=backend)
        (drawn,) = render_stills(body, posed(picture, body), [0], settings)
        Image.fromarray(drawn).save(folder / f"{name}.png", optimize=True)


def main() -> int:
    parser = argparse.ArgumentParser(description="Draw the golden pictures.")
    parser.add_argument("--backend", choices=BACKENDS, help="by default what draws here")
    parser.add_argument("--out", type=Path, default=GOLDEN)
    arguments = parser.parse_args()
    draw_all(arguments.backend or choose_backend(), arguments.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
