"""The open body's other builds, for a browser that has the first as a GLB.

Little-endian 16-bit integers; for each build of `BUILDS` after the first: offsets of all vertices
at rest to the first build, in steps of ``STEP_M``, then their unit normals, in steps of 1 / 32767.
All builds share skeleton, topology, weights and face, so nothing else differs.
"""

from __future__ import annotations

import numpy as np

from conventions.views import BUILDS
from renderer.body.body_file import OPEN_BODY_PATH, read_body_file
from renderer.body.normals import VertexNormals

STEP_M = 4e-6
"""Offsets of up to 13 cm fit; a build's are below 5."""
_MOST = 32_767


def builds_bytes() -> bytes:
    """All of it; 180 kB a build."""
    first = read_body_file(OPEN_BODY_PATH)
    normals_of = VertexNormals(first.faces, len(first.template))
    parts = []
    for build in BUILDS[1:]:
        template = read_body_file(OPEN_BODY_PATH, build).template
        parts.append(_whole((template - first.template) / STEP_M))
        parts.append(_whole(normals_of(template) * _MOST))
    return b"".join(parts)


def _whole(steps: np.ndarray) -> bytes:
    rounded = np.rint(steps)
    if np.abs(rounded).max() > _MOST:
        raise ValueError(f"An offset of {np.abs(rounded).max() * STEP_M:.2f} m is out of range.")
    return rounded.astype("<i2").tobytes()
