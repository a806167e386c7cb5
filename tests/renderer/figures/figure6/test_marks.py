"""Marks on joints: where the joint is drawn, as strong as its value."""

import numpy as np
import pytest

from conventions.joints import JOINT_INDEX, JOINT_NAMES
from renderer.body.body import BodyMotion, load_body
from renderer.figures.figure6.snapshots import CORE_RGB, mark_joints
from renderer.scene.stage import set_stage
from renderer.video.render import projected_joints, render_stills
from renderer.video.settings import RenderSettings

LIMBS = [
    JOINT_INDEX[name]
    for name in JOINT_NAMES
    if name.endswith(("hip", "knee", "ankle", "neck", "head", "shoulder", "elbow", "wrist"))
]


@pytest.mark.parametrize("view", ["front", "side"])
def test_joints_lie_on_the_body_also_where_the_camera_follows(view: str) -> None:
    rng = np.random.default_rng(0)
    motion = BodyMotion.resting(61)
    motion.poses[:] = rng.normal(scale=0.15, size=(1, 165))
    motion.trans[:, 0] = np.linspace(0.0, 4.0, 61)
    body, frames = load_body(), (0, 30, 60)
    settings = RenderSettings(160, 160, view=view, backend="software", is_transparent=True)
    stage = set_stage(body, [motion], view)
    assert stage.is_following

    pictures = render_stills(body, motion, frames, settings, stage=stage)
    pixels = projected_joints(body, motion, frames, settings, stage)

    assert pixels.shape == (3, 55, 2)
    columns, rows = np.floor(pixels[:, LIMBS]).astype(int).T
    coverage = pictures[..., 3][np.arange(3), rows, columns]
    assert (coverage == 255).all()
    assert (pictures[..., 3] == 255).mean() < 0.25  # the body fills little of its picture


def test_a_mark_is_centred_on_its_joint_and_nothing_else_changes() -> None:
    pictures = np.full((1, 100, 100, 3), 150, np.uint8)
    marked = mark_joints(pictures, np.array([[[30.5, 60.5]]]), np.array([[1.0]]))[0]

    assert np.abs(marked[60, 30] - np.array(CORE_RGB)).max() < 30
    changed = np.argwhere((marked != 150).any(axis=-1))
    np.testing.assert_array_equal(changed.mean(axis=0), [60, 30])
    assert 3 <= np.ptp(changed[:, 0]) <= 8
    assert pictures.max() == 150  # the given pictures stay as they are


def test_marks_grow_and_darken_with_the_value() -> None:
    places = np.array([[[50.0, 50.0]]])

    def look(severity: float) -> tuple[int, int]:
        picture = np.full((1, 100, 100, 3), 150, np.uint8)
        marked = mark_joints(picture, places, np.array([[severity]]))[0]
        return int((marked != 150).any(axis=-1).sum()), int(marked.min())

    (area_low, dark_low), (area_high, dark_high) = look(0.3), look(0.9)
    assert area_high > area_low > 0
    assert dark_high < dark_low < 150
    assert look(0.05) == (0, 150)
    assert look(float("nan")) == (0, 150)
    assert look(7.0) == look(1.0)


@pytest.mark.parametrize("place", [(-50.0, 5.0), (1e6, 5.0), (np.nan, 5.0), (5.0, -1e5)])
def test_a_joint_outside_the_picture_marks_nothing(place: tuple[float, float]) -> None:
    pictures = np.full((1, 40, 60, 3), 150, np.uint8)
    marked = mark_joints(pictures, np.array([[place]]), np.ones((1, 1)))
    np.testing.assert_array_equal(marked, pictures)


def test_a_mark_at_the_edge_is_cut() -> None:
    pictures = np.full((1, 40, 60, 3), 150, np.uint8)
    marked = mark_joints(pictures, np.array([[[0.0, 39.5]]]), np.ones((1, 1)))[0]
    assert (marked[39, 0] != 150).all()
    assert (marked[:20] == 150).all()
