"""Levels of detail: a body as meshes from fine to coarse, selected by its size in the picture.

Every mesh has only the vertices of its faces, so that nothing else is posed. Those of the open body
are baked; those of a licensed body are made once and cached in the user's cache folder.
"""

from __future__ import annotations

import functools
import os
import zipfile
from pathlib import Path

import numpy as np
from filelock import FileLock
from jaxtyping import Int64, Integer, UInt16, UInt32

from conventions.joints import JOINT_NAMES, NUM_JOINTS
from renderer.body.body import Body
from renderer.body.body_file import OPEN_BODY_PATH
from renderer.body.decimation import body_surface, decimate

LOD_PATH = OPEN_BODY_PATH.with_name("coarser.npz")
"""Path of the coarser meshes of the open body, made by `tools.bake`."""
NUM_COARSER = 3
"""Number of coarser meshes that are used; the others would be visible in any picture."""
FACES_PER_SQUARED_HEIGHT_PX = 0.06
"""Faces needed per squared pixel of the body's height: with fewer the outline looks angular."""
CLUSTERED_FACES = (12_000, 6_000, 4_500, 1_200)
"""Most faces of each coarser mesh of a character; with fewer, faces lose their features."""
_CACHE_FORMAT = 2


@functools.cache
def open_body_lod_faces() -> tuple[UInt16[np.ndarray, "_ 3"], ...]:
    """Return the faces of each coarser mesh of the open body, from fine to coarse."""
    with np.load(LOD_PATH, allow_pickle=False) as archive:
        return tuple(archive[f"faces_{k}"] for k in range(len(archive.files)))


def select_lod(body: Body, height_px: float) -> Body:
    """Return the coarsest mesh that looks like the whole body at a height in pixels."""
    needed = FACES_PER_SQUARED_HEIGHT_PX * height_px**2
    if needed > len(body.faces) or body.texture is not None:  # textures have seams
        return body
    fine_enough = [mesh for mesh in _coarser_faces(body) if needed <= len(mesh) < len(body.faces)]
    if not fine_enough:
        return body
    vertices, corners = np.unique(fine_enough[-1], return_inverse=True)
    return body.submesh(vertices, corners.reshape(-1, 3))


def character_lod_faces(body: Body) -> list[UInt32[np.ndarray, "_ 3"]]:
    """Return the faces of coarser meshes of a character, within a second.

    Vertices of one joint that are near in space, colour and texture become one of them: rougher
    than `decimate`, for browsers that draw slowly. Hands and head have smaller cells.
    """
    size = np.ones(NUM_JOINTS)
    size[[j for j, name in enumerate(JOINT_NAMES) if "head" in name or "eye" in name]] = 0.3
    size[[j for j, name in enumerate(JOINT_NAMES) if name[-1] in "123" or "wrist" in name]] = 0.4
    assert body.texture is not None
    joints = body.dominant_joints[body.texture.welds]  # the same on both sides of a seam
    places = (body.template - body.template.min(axis=0)) / size[joints, None]
    looks = np.c_[16 * body.texture.uv, 5 * np.sqrt(body.texture.colors)].astype(np.int64)

    def clustered(cell_m: float) -> np.ndarray:
        cells = np.c_[joints, places / cell_m].astype(np.int64)
        cell = _numbered(cells)
        count = np.bincount(cell)[:, None]
        middle = np.stack([np.bincount(cell, axis) for axis in body.template.T], axis=1) / count
        away = np.linalg.norm(body.template - middle[cell], axis=1)
        group = _numbered(np.c_[cell, looks])
        # The nearest to the middle of the cell: at a seam, that is one place on both sides.
        nearest = np.lexsort((away, group))
        chosen = nearest[np.searchsorted(group[nearest], np.arange(group.max() + 1))]
        faces = chosen[group][body.faces]
        faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
        _, different = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
        return faces[np.sort(different)]

    meshes, fine_m = [], 0.004
    for count in CLUSTERED_FACES:
        coarse_m, faces = 1.0, body.faces
        for _ in range(6 if len(faces) > count else 0):
            middle_m = (fine_m * coarse_m) ** 0.5
            clusters = clustered(middle_m)
            if len(clusters) > count:
                fine_m = middle_m
            else:
                coarse_m, faces = middle_m, clusters
        meshes.append(faces.astype(np.uint32))
    return meshes


def _numbered(rows: Int64[np.ndarray, "N D"]) -> Int64[np.ndarray, " N"]:
    """Return the same number, from 0, for equal rows of numbers of at least 0."""
    key = np.ravel_multi_index(tuple(rows.T), tuple(rows.max(axis=0) + 1))
    return np.unique(key, return_inverse=True)[1]


def _coarser_faces(body: Body) -> list[Integer[np.ndarray, "_ 3"]]:
    """Return the faces of the coarser meshes that are used, from fine to coarse."""
    if body.regions is not None:
        return list(open_body_lod_faces()[:NUM_COARSER])
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
    path = folder / "co-speech-motion" / "meshes" / f"{body.sha256}-{_CACHE_FORMAT}.npz"
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with FileLock(f"{path}.lock"):
            if not path.exists():
                numbered = {f"faces_{k}": each for k, each in enumerate(_decimated(body))}
                part = path.with_suffix(".part.npz")
                np.savez_compressed(part, **numbered)  # type: ignore[arg-type]
                part.replace(path)
            with np.load(path, allow_pickle=False) as archive:
                meshes = [archive[name] for name in archive.files]
    except (OSError, ValueError, zipfile.BadZipFile):
        return []  # no cache: the whole body is drawn, which takes longer
    return [each for each in meshes if each.max(initial=0) < body.num_vertices]


def _decimated(body: Body) -> list[Integer[np.ndarray, "_ 3"]]:
    """Make the coarser meshes, which takes some ten seconds."""
    counts = [
        len(faces) for faces in open_body_lod_faces()[:NUM_COARSER] if len(faces) < len(body.faces)
    ]
    return decimate(body_surface(body), counts)
