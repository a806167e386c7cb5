"""One frame of a body as a mesh that every 3D program reads: OBJ, or PLY with colours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from renderer.body.body import Body, BodyMotion
from renderer.files.written import written_whole
from renderer.scene.stage import frames_of


def write_still(body: Body, motion: BodyMotion, frame: int, out: Path) -> None:
    """Write the posed body; metres, y up. The ending of ``out`` says which format.

    Raises:
        OSError: if ``out`` cannot be written; nothing half-written stays behind.
    """
    (vertices,) = np.concatenate(list(body.vertices(frames_of(motion, [frame]))))
    colors = None if body.vertex_colors is None else np.sqrt(body.vertex_colors)  # linear, shown
    mesh = trimesh.Trimesh(vertices, body.faces, vertex_colors=colors, process=False)
    with written_whole(out) as file:
        mesh.export(file, file_type=out.suffix.lower()[1:])
