"""Snapshots are cut alike and keep what they show; marks stand where the joint is drawn."""

import numpy as np
import pytest

from conventions.joints import JOINT_INDEX, JOINT_NAMES
from renderer.body.body import BodyMotion, load_body
from renderer.figures.figure6.snapshots import CORE_RGB, crop_alike, mark_joints
from renderer.scene.stage import set_stage
from renderer.video.render import projected_joints, render_stills
from renderer.video.settings import RenderSettings

LIMBS = [
    JOINT_INDEX[name]
    for name in JOINT_NAMES
    if name.endswith(("hip", "knee", "ankle", "neck", "head", "shoulder", "elbow", "wrist"))
]


@pytest.mark.parametrize("view", ["front", "side"])
def test_joints_lie_on_the_body_also_where_the_camera_follows(view):
    rng = np.random.default_rng(0)
    motion = BodyMotion.resting(61)
    motion.poses[:] = rng.normal(scale=0.15, size=(1, 165))
    motion.trans[:, 0] = np.linspace(0.0, 4.0, 61)
    body, frames = load_body(), (0, 30, 60)
    settings = RenderSettings(160, 160, view=view, is_transparent=True)
    stage = set_stage(body, [motion], view)
    assert stage.is_following
    pictures = render_stills(body, motion, frames, settings, stage=stage)
    pixels = projected_joints(body, motion, frames, settings, stage)
    assert pixels.shape == (3, 55, 2)
    columns, rows = np.floor(pixels[:, LIMBS]).astype(int).T
    coverage = pictures[..., 3][np.arange(3), rows, columns]
    assert (coverage == 255).all()
    assert (pictures[..., 3] == 255).mean() < 0.25  # the body fills little of its picture


def test_a_mark_is_centred_on_its_joint_and_nothing_else_changes():
    pictures = np.full((1, 100, 100, 3), 150, np.uint8)
    marked = mark_joints(pictures, np.array([[[30.5, 60.5]]]), np.array([[1.0]]))[0]
    assert np.abs(marked[60, 30] - np.array(CORE_RGB)).max() < 30
    changed = np.argwhere((marked != 150).any(axis=-1))
    np.testing.assert_array_equal(changed.mean(axis=0), [60, 30])
    assert 3 <= np.ptp(changed[:, 0]) <= 8
    assert pictures.max() == 150  # the given pictures stay as they are


def test_marks_grow_and_darken_with_the_value():
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


def test_a_mark_at_the_edge_is_cut_and_one_outside_is_none():
    pictures = np.full((1, 40, 60, 3), 150, np.uint8)
    for place in ((-50.0, 5.0), (1e6, 5.0), (np.nan, 5.0), (5.0, -1e5)):
        marked = mark_joints(pictures, np.array([[place]]), np.ones((1, 1)))
        np.testing.assert_array_equal(marked, pictures)
    marked = mark_joints(pictures, np.array([[[0.0, 39.5]]]), np.ones((1, 1)))[0]
    assert (marked[39, 0] != 150).all()
    assert (marked[:20] == 150).all()


def test_crop_keeps_all_content_at_one_size():
    pictures = np.full((3, 60, 80, 3), 200, dtype=np.uint8)
    pictures += np.arange(60, dtype=np.uint8)[None, :, None, None] // 2  # a vertical gradient
    for i, picture in enumerate(pictures):
        picture[20:50, 10 + 20 * i : 18 + 20 * i] = 30  # walks to the right
    other = pictures.copy()
    other[1, 15:20, 34:36] = 60  # one row's raised hand
    cropped = crop_alike({"a": pictures, "b": other})
    shapes = {stack.shape for stack in cropped.values()}
    assert len(shapes) == 1
    _, height, width, _ = shapes.pop()
    assert 35 <= height <= 42 and 8 <= width <= 14
    for name, original in (("a", pictures), ("b", other)):
        for before, after in zip(original, cropped[name], strict=True):
            assert (after < 100).sum() == (before < 100).sum()
    background_a, background_b = (cropped[name][1] >= 100 for name in "ab")
    assert (background_a != background_b).any(-1).sum() == 10  # the same place in both rows


def test_crop_keeps_empty_and_full_pictures_and_an_arm_that_leaves_whole():
    empty = {"a": np.full((2, 30, 40, 3), 255, dtype=np.uint8)}
    np.testing.assert_array_equal(crop_alike(empty)["a"], empty["a"])
    rng = np.random.default_rng(0)
    full = {"a": rng.integers(0, 255, (2, 30, 40, 3), dtype=np.uint8)}
    np.testing.assert_array_equal(crop_alike(full)["a"], full["a"])
    pictures = np.full((5, 30, 40, 3), 255, dtype=np.uint8)
    pictures[:, 5:25, 18:22] = 50
    pictures[2, 10:12, :18] = 50
    assert (crop_alike({"a": pictures})["a"][2] == 50).sum() == (pictures[2] == 50).sum()
