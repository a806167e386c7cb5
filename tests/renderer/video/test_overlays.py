"""Trails, colours and notices in pictures."""

import numpy as np
import pytest

from conventions.joints import JOINT_INDEX, NUM_JOINTS
from renderer.body.body import BodyMotion, load_body
from renderer.scene.camera_setup import layout_panels
from renderer.video.overlays import HeatMap, OverlayPainter, Overlays, Trail, heat_colors
from renderer.video.render import RenderSettings, camera_setup_for
from tests.renderer.drawn import render_stills

pytestmark = pytest.mark.gl

SETTINGS = RenderSettings(160, 160, layout=layout_panels("front", 160, 160, ("hands",)))


def drawn(overlays: Overlays | None, num_frames: int = 40, frame: int = 39) -> np.ndarray:
    body, motion = load_body(), BodyMotion.zero_pose(num_frames)
    return render_stills(body, motion, [frame], SETTINGS, overlays=overlays)[0].astype(int)


def test_a_trail_is_where_the_point_was_within_the_last_second():
    body, motion = load_body(), BodyMotion.zero_pose(40)
    stage = camera_setup_for(body, [motion], SETTINGS)
    joints = body.joint_positions(motion)
    way = joints[:, JOINT_INDEX["head"]] + np.array([0.4, -1.2, 0.0])  # beside the legs
    way[:, 1] += np.linspace(0.0, 0.4, 40)
    is_spike = np.arange(40) == 25
    trail = Trail(way, np.linspace(0.0, 1.0, 40), is_spike, close_up_view="")
    with_trail, without = drawn(Overlays(trail=trail)), drawn(None)
    panel = SETTINGS.panels[0]
    changed = np.abs(with_trail - without).max(axis=2) > 40
    assert not changed[panel.height :].any(), "in the body's panel alone"
    places = stage.camera.project(way, panel.width, panel.height).round().astype(int)
    is_on = [changed[y - 1 : y + 2, x - 1 : x + 2].any() for x, y in places]
    assert all(is_on[12:]) and not any(is_on[:6]), "thirty frames back, no more"
    x, y = places[25]
    assert np.abs(with_trail[y, x] - (213, 94, 0)).max() < 40, "a dot where it jerks"
    x, y = places[32]
    assert np.abs(with_trail[y, x] - (213, 94, 0)).max() > 60


def test_a_trail_is_in_the_close_up_of_its_hand():
    body, motion = load_body(), BodyMotion.zero_pose(40)
    way = body.joint_positions(motion)[:, JOINT_INDEX["right_middle3"]].copy()
    way[:, 1] += np.linspace(-0.03, 0.03, 40)
    trail = Trail(way, np.ones(40), np.zeros(40, bool), close_up_view="right_hand")
    changed = np.abs(drawn(Overlays(trail=trail)) - drawn(None)).max(axis=2) > 40
    _, right, left = SETTINGS.panels
    assert changed[right.box].sum() > 20
    assert not changed[left.box].any()


def test_what_jerks_is_coloured_and_the_rest_is_grey():
    body = load_body()
    shares = np.zeros((1, NUM_JOINTS), np.float32)
    hand = [i for name, i in JOINT_INDEX.items() if name.startswith("right_") and name[-1] in "123"]
    shares[0, [JOINT_INDEX["right_wrist"], *hand]] = 1.0
    (colors,) = heat_colors(body, shares)
    owner = np.asarray(body.weights.argmax(axis=1)).ravel()
    still = colors[owner == JOINT_INDEX["head"]]
    moving = colors[owner == JOINT_INDEX["right_middle2"]]
    assert np.ptp(still, axis=1).max() < 0.03, "grey"
    assert moving.sum(axis=1).max() < 0.5 * still.sum(axis=1).min(), "darker in any eye"
    assert (moving[:, 2] > 2 * moving[:, 1]).all()
    heat = HeatMap(np.repeat(shares, 40, axis=0), "jerk")
    _, right, left = SETTINGS.panels
    picture = drawn(Overlays(heat=heat))
    purple = (picture[..., 2] - picture[..., 1]) > 40
    assert purple[right.box].mean() > 0.1 > 0.001 > purple[left.box].mean()
    shares = np.zeros((40, NUM_JOINTS), np.float32)
    shares[20:] = 1.0
    overlays = Overlays(heat=HeatMap(shares))
    before, after = drawn(overlays, frame=19), drawn(overlays, frame=20)
    assert np.abs(before - after).max(axis=2).max() > 100, "from frame to frame"


def test_nobody_overlooks_that_a_picture_is_exaggerated():
    overlays = Overlays(notice="EXAGGERATED x20", close_up_notice="x20")
    picture = drawn(overlays)
    for panel, least in zip(SETTINGS.panels, (0.04, 0.02, 0.02), strict=True):
        loud = np.abs(picture[panel.box] - (196, 52, 0)).max(axis=2) < 12
        assert loud.mean() > least
    assert (np.abs(drawn(None) - (196, 52, 0)).max(axis=2) < 12).mean() == 0


def test_marks_beyond_the_picture_are_cut_off():
    body, motion = load_body(), BodyMotion.zero_pose(4)
    stage = camera_setup_for(body, [motion], SETTINGS)
    far = np.tile(np.array([[50.0, 0.0, 0.0]]), (4, 1))
    behind = np.tile(np.array([[0.0, 0.0, 50.0]]), (4, 1))
    for way in (far, behind):
        overlays = Overlays(
            trail=Trail(way, np.ones(4), np.ones(4, bool), close_up_view="right_hand")
        )
        assert render_stills(body, motion, [3], SETTINGS, stage=stage, overlays=overlays).any()


def test_painting_leaves_the_picture_it_was_given_and_legends_lie_apart():
    blank, panel = np.full((240, 160, 3), 200, np.uint8), SETTINGS.panels[0]
    nowhere = Trail(np.full((1, 3), np.nan), np.ones(1), np.zeros(1, bool), "slow to fast")
    overlays = Overlays(nowhere, HeatMap(np.zeros((1, NUM_JOINTS)), "jerk"), "n", "t")
    camera = camera_setup_for(load_body(), [BodyMotion.zero_pose()], SETTINGS).camera
    painted = OverlayPainter(overlays, SETTINGS.panels).paint(blank, 0, 3 * [camera])
    assert (blank == 200).all()
    edges = np.flatnonzero(np.diff((painted[: panel.height] != 200).any(axis=(1, 2))))
    assert np.diff(edges)[1::2].tolist() == [4, 4]  # between two legends and the notice
