"""One pose as OBJ and PLY, read back line by line."""

import numpy as np

from renderer.body.body import load_body
from renderer.files.still import write_still
from tests.renderer.body.test_body import random_motion


def test_obj_and_ply_hold_the_posed_body(tmp_path):
    body, motion = load_body(), random_motion(3)
    posed = np.concatenate(list(body.vertices(motion)))[2]
    write_still(body, motion, 2, tmp_path / "pose.obj")
    lines = [line.split() for line in (tmp_path / "pose.obj").read_text().splitlines()]
    vertices = np.array([line[1:4] for line in lines if line[:1] == ["v"]], float)
    faces = [[corner.split("/")[0] for corner in line[1:]] for line in lines if line[:1] == ["f"]]
    np.testing.assert_allclose(vertices, posed, atol=1e-6)
    np.testing.assert_array_equal(np.array(faces, int) - 1, body.faces)
    write_still(body, motion, 2, tmp_path / "pose.ply")
    head, _, data = (tmp_path / "pose.ply").read_bytes().partition(b"end_header\n")
    assert f"element vertex {body.num_vertices}\n".encode() in head
    assert b"format binary_little_endian" in head
    kinds = [("at", "<f4", 3), ("rgba", "u1", 4)]
    read = np.frombuffer(data, np.dtype(kinds), body.num_vertices)
    np.testing.assert_allclose(read["at"], posed, atol=1e-6)
    shown = 255 * np.sqrt(body.vertex_colors)
    np.testing.assert_allclose(read["rgba"][:, :3], shown, atol=1)
