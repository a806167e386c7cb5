"""BVH files, read back by a small parser that shares no code with the writer; OBJ and PLY."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from conventions.joints import FINGERTIP_VERTICES, JOINT_NAMES
from renderer.body.body import Body, BodyMotion, load_body
from renderer.files.exports import write_bvh, write_posed_mesh
from tests.renderer.body.test_body import random_motion


@pytest.fixture(scope="module")
def body() -> Body:
    return load_body()


def turn(axis: str, degrees: float) -> np.ndarray:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return {
        "X": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "Y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "Z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


def read_bvh(path: Path) -> tuple[float, dict[str, np.ndarray]]:
    """Frame time, and the world positions (T, 3) of each joint and of ``<joint> end``."""
    words = iter(path.read_text().split())
    assert next(words) == "HIERARCHY"
    joints: list[tuple[str, int, np.ndarray, list[str]]] = []
    stack: list[int] = []
    for word in words:
        if word in ("ROOT", "JOINT", "End"):
            label = next(words)
            name = f"{joints[stack[-1]][0]} end" if word == "End" else label
            joints.append((name, stack[-1] if stack else -1, np.zeros(3), []))
            assert next(words) == "{"
            stack.append(len(joints) - 1)
        elif word == "OFFSET":
            joints[stack[-1]][2][:] = [float(next(words)) for _ in range(3)]
        elif word == "CHANNELS":
            joints[stack[-1]][3].extend(next(words) for _ in range(int(next(words))))
        elif word == "}":
            stack.pop()
        elif word == "MOTION":
            break
    assert next(words) == "Frames:"
    num_frames = int(next(words))
    assert (next(words), next(words)) == ("Frame", "Time:")
    frame_time = float(next(words))
    values = np.array([float(word) for word in words]).reshape(num_frames, -1)
    positions = {name: np.zeros((num_frames, 3)) for name, *_ in joints}
    for frame, row in enumerate(values):
        numbers = iter(row)
        placed: list[tuple[np.ndarray, np.ndarray]] = []
        for name, parent, offset, channels in joints:
            rotation, origin = placed[parent] if parent >= 0 else (np.eye(3), np.zeros(3))
            origin = origin + rotation @ offset
            for channel in channels:
                if channel.endswith("position"):
                    origin = origin + next(numbers) * np.eye(3)["XYZ".index(channel[0])]
                else:
                    rotation = rotation @ turn(channel[0], next(numbers))
            placed.append((rotation, origin))
            positions[name][frame] = origin
        assert next(numbers, None) is None, "values are left over"
    return frame_time, positions


def test_positions_read_back_are_those_of_the_motion(body, tmp_path):
    motion = random_motion(num_frames=9)
    write_bvh(body, motion, tmp_path / "motion.bvh")
    frame_time, positions = read_bvh(tmp_path / "motion.bvh")
    assert frame_time == pytest.approx(1 / 30, abs=1e-8)
    wanted = body.joint_positions(motion)
    assert wanted.shape[0] == 9
    for joint, name in enumerate(JOINT_NAMES):
        np.testing.assert_allclose(positions[name], wanted[:, joint], atol=1e-4, err_msg=name)
    write_bvh(body, BodyMotion.zero_pose(2), tmp_path / "rest.bvh")
    _, positions = read_bvh(tmp_path / "rest.bvh")
    for finger, vertex in FINGERTIP_VERTICES.items():
        end = positions[f"{finger}3 end"][1]
        np.testing.assert_allclose(end, body.template[vertex], atol=1e-5)
    no_tips = {"template": body.template[:99], "shape_dirs": body.shape_dirs[:99]}
    small = replace(body, **no_tips, regions=None)
    write_bvh(small, BodyMotion.zero_pose(1), tmp_path / "small.bvh")
    for places in (positions, read_bvh(tmp_path / "small.bvh")[1]):
        ends = [name for name in places if name.endswith(" end")]
        lengths = [np.linalg.norm(places[it][0] - places[it[:-4]][0]) for it in ends]
        assert 0.01 < min(lengths) < max(lengths) < 0.1


@pytest.mark.parametrize("degrees", [90.0, -90.0, 180.0])
def test_right_angles_lose_nothing(body, tmp_path, degrees):
    """At 90 degrees about X two Euler angles fall together; the rotation must survive."""
    poses = BodyMotion.zero_pose(1).poses.copy()
    poses[:, 48] = np.radians(degrees)  # left shoulder about X
    poses[:, 54] = 0.7  # left elbow
    motion = replace(BodyMotion.zero_pose(1), poses=poses)
    write_bvh(body, motion, tmp_path / "angle.bvh")
    _, positions = read_bvh(tmp_path / "angle.bvh")
    wanted = body.joint_positions(motion)[:, JOINT_NAMES.index("left_middle3")]
    np.testing.assert_allclose(positions["left_middle3"], wanted, atol=1e-4)


def test_obj_and_ply_hold_the_posed_body(body, tmp_path):
    motion = random_motion(3)
    posed = np.concatenate(list(body.posed_vertices(motion)))[2]
    write_posed_mesh(body, motion, 2, tmp_path / "pose.obj")
    lines = [line.split() for line in (tmp_path / "pose.obj").read_text().splitlines()]
    vertices = np.array([line[1:4] for line in lines if line[:1] == ["v"]], float)
    faces = [[corner.split("/")[0] for corner in line[1:]] for line in lines if line[:1] == ["f"]]
    np.testing.assert_allclose(vertices, posed, atol=1e-6)
    np.testing.assert_array_equal(np.array(faces, int) - 1, body.faces)
    write_posed_mesh(body, motion, 2, tmp_path / "pose.ply")
    head, _, data = (tmp_path / "pose.ply").read_bytes().partition(b"end_header\n")
    assert f"element vertex {body.num_vertices}\n".encode() in head
    assert b"format binary_little_endian" in head
    kinds = [("at", "<f4", 3), ("rgba", "u1", 4)]
    read = np.frombuffer(data, np.dtype(kinds), body.num_vertices)
    np.testing.assert_allclose(read["at"], posed, atol=1e-6)
    shown = 255 * np.sqrt(body.vertex_colors)
    np.testing.assert_allclose(read["rgba"][:, :3], shown, atol=1)
