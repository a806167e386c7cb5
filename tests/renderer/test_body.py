"""The body: zero pose, agreement with ``smplx``, made SMPL-X files, and bad input."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from model import skeleton
from renderer.body import Body, BodyMotion, load_body
from renderer.smplx_joints import JOINT_NAMES, NUM_JOINTS, PARENTS

NUM_FRAMES = 7
MADE_VERTICES = 10


@pytest.fixture(scope="module")
def body() -> Body:
    return load_body()


def random_motion(
    seed: int = 0, num_frames: int = NUM_FRAMES, basis: str = "arkit52", num_expressions: int = 52
) -> BodyMotion:
    rng = np.random.default_rng(seed)
    expressions = np.zeros((num_frames, 100))
    expressions[:, :num_expressions] = rng.uniform(0, 0.5, (num_frames, num_expressions))
    return BodyMotion(
        poses=rng.normal(size=(num_frames, 165)) * 0.3,
        trans=rng.normal(size=(num_frames, 3)),
        expressions=expressions,
        expression_basis=basis,
        betas=np.zeros(300),
    )


def all_vertices(body: Body, motion: BodyMotion, chunk: int = 64) -> np.ndarray:
    return np.concatenate(list(body.vertices(motion, chunk)))


def max_distance_mm(a: np.ndarray, b: np.ndarray) -> float:
    return 1e3 * float(np.linalg.norm(np.asarray(a) - np.asarray(b), axis=-1).max())


def smplx_file(path: Path, **changes: object) -> Path:
    """A random body in the licensed file format, ten vertices; ``None`` removes a key."""
    rng = np.random.default_rng(3)
    weights = rng.random((MADE_VERTICES, NUM_JOINTS)) ** 8
    regressor = rng.random((NUM_JOINTS, MADE_VERTICES))
    kintree = np.stack([np.array(PARENTS), np.arange(NUM_JOINTS)])
    arrays: dict[str, object] = {
        "v_template": rng.normal(size=(MADE_VERTICES, 3)),
        "f": rng.integers(0, MADE_VERTICES, (12, 3)).astype(np.uint32),
        "weights": weights / weights.sum(1, keepdims=True),
        "J_regressor": regressor / regressor.sum(1, keepdims=True),
        "kintree_table": kintree.astype(np.uint32),
        "shapedirs": rng.normal(size=(MADE_VERTICES, 3, 20)) * 0.01,
        "posedirs": rng.normal(size=(MADE_VERTICES, 3, 486)) * 0.01,
        "part2num": np.array({"head": 1}, dtype=object),
    }
    arrays.update(changes)
    np.savez(path, **{key: array for key, array in arrays.items() if array is not None})
    return path


def test_joint_table_is_that_of_the_model() -> None:
    assert skeleton.JOINT_NAMES == JOINT_NAMES
    assert tuple(skeleton.PARENTS) == PARENTS


def test_zero_pose_is_the_template(body: Body) -> None:
    (posed,) = body.vertices(BodyMotion.resting())
    np.testing.assert_allclose(posed[0], body.template, atol=1e-6)


def test_translation_moves_every_vertex(body: Body) -> None:
    motion = random_motion()
    still = BodyMotion(
        motion.poses, np.zeros_like(motion.trans), motion.expressions, "arkit52", motion.betas
    )
    moved = all_vertices(body, motion) - motion.trans[:, None]
    assert max_distance_mm(moved, all_vertices(body, still)) < 1e-3


@pytest.mark.parametrize("chunk", [1, 3, 7, 64])
def test_chunk_size_does_not_change_the_result(body: Body, chunk: int) -> None:
    motion = random_motion(num_frames=13)
    chunks = list(body.vertices(motion, chunk))
    assert [len(part) for part in chunks[:-1]] == [chunk] * (len(chunks) - 1)
    assert max_distance_mm(np.concatenate(chunks), all_vertices(body, motion, 13)) < 1e-3
