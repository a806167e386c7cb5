"""The vertices that SMPL-X files fix by number, and an order of vertices that keeps them.

Code that reads SMPL-X bodies takes fingertips, nose, eyes, ears and feet from these numbers.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from conventions.joints import FINGERS, JOINT_INDEX, TIP_VERTICES
from renderer.body.look import REGION_INDEX
from tools.bake.geometry import Mesh

NOSE_VERTEX = 9120
SIDE_VERTICES = {
    "left": {"eye": 9448, "ear": 6, "big_toe": 5770, "small_toe": 5780, "heel": 8846},
    "right": {"eye": 9929, "ear": 616, "big_toe": 8463, "small_toe": 8474, "heel": 8635},
}


def format_vertices(mesh: Mesh, joints: Float[np.ndarray, "J 3"]) -> dict[int, int]:
    """For each number that the format fixes: the vertex of ``mesh`` that belongs there."""
    positions = mesh.positions
    strongest = mesh.weights.argmax(1)
    skin = mesh.regions == REGION_INDEX["skin"]
    shoe = np.isin(mesh.regions, [REGION_INDEX["shoes"], REGION_INDEX["soles"]])

    def follows(joint: str) -> Bool[np.ndarray, " V"]:
        return strongest == JOINT_INDEX[joint]

    def farthest(among: Bool[np.ndarray, " V"], direction: Float[np.ndarray, " 3"]) -> int:
        index = np.flatnonzero(among)
        return int(index[np.argmax(positions[index] @ direction)])

    wanted: dict[int, int] = {}
    eye_height = joints[JOINT_INDEX["left_eye"], 1]
    near_eyes = skin & follows("head") & (np.abs(positions[:, 1] - eye_height) < 0.06)
    nose = near_eyes & (np.abs(positions[:, 0]) < 0.01)
    wanted[NOSE_VERTEX] = farthest(nose, np.array([0.0, 0.0, 1.0]))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        outward = np.array([sign, 0.0, 0.0])
        for finger in FINGERS:
            last = f"{side}_{finger}3"
            on_finger = skin & follows(last)
            # The vertex farthest along the line from the last joint to the outermost vertex.
            along = positions[farthest(on_finger, outward)] - joints[JOINT_INDEX[last]]
            wanted[TIP_VERTICES[f"{side}_{finger}"]] = farthest(on_finger, along)
        numbers = SIDE_VERTICES[side]
        foot = joints[JOINT_INDEX[f"{side}_foot"]]
        toes = shoe & follows(f"{side}_foot")
        inner = positions[:, 0] * sign < foot[0] * sign
        wanted[numbers["big_toe"]] = farthest(toes & inner, np.array([0.0, 0.0, 1.0]))
        wanted[numbers["small_toe"]] = farthest(toes & ~inner, np.array([sign, 0.0, 0.6]))
        heel = shoe & follows(f"{side}_ankle")
        wanted[numbers["heel"]] = farthest(heel, np.array([0.0, -0.3, -1.0]))
        wanted[numbers["ear"]] = farthest(near_eyes, outward)
        eye = follows(f"{side}_eye") & ~skin
        wanted[numbers["eye"]] = farthest(eye, np.array([0.0, 0.0, 1.0]))
    return wanted


def with_fixed_vertices(mesh: Mesh, wanted: dict[int, int]) -> Mesh:
    """The mesh in an order of vertices that puts ``wanted[number]`` at each ``number``."""
    order: Int[np.ndarray, " V"] = np.arange(mesh.num_vertices)
    place = np.arange(mesh.num_vertices)
    for number, vertex in wanted.items():
        swapped, old_place = order[number], place[vertex]
        order[number], order[old_place] = vertex, swapped
        place[vertex], place[swapped] = number, old_place
    return Mesh(place[mesh.faces], mesh.carried[order], mesh.regions[order])
