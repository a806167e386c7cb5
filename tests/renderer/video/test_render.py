"""From a body's motion to pictures and videos."""

from dataclasses import replace

import numpy as np
import pytest

from renderer.body.body import BodyMotion, load_body
from renderer.scene.camera_setup import layout_panels, make_camera_setup
from renderer.video.render import RenderSettings
from tests.renderer.drawn import render_stills
from tests.renderer.scene.test_camera import waving_motion

pytestmark = pytest.mark.gl


def small(**changes) -> RenderSettings:
    return replace(RenderSettings(width=128, height=128), **changes)


def beside(*close_ups: str) -> RenderSettings:
    return small(layout=layout_panels("front", 128, 128, close_ups))


def test_stills_come_in_the_order_asked_for():
    body, motion = load_body(), waving_motion(10)
    stills = render_stills(body, motion, [7, 2, 7], small())
    np.testing.assert_array_equal(stills[0], stills[2])
    assert (stills[0] != stills[1]).any()
    assert render_stills(body, motion, [], small()).shape == (0, 128, 128, 3)
    for frame in (-1, 10):
        with pytest.raises(ValueError, match=f"Frame {frame} is outside the motion, which has 10"):
            render_stills(body, motion, [frame], small())
    with pytest.raises(ValueError, match="different close-ups"):
        stage = make_camera_setup(body, [motion])
        render_stills(body, motion, [0], beside("hands"), stage=stage)


def test_close_ups_stand_beside_a_body_that_they_leave_as_it_is():
    body, motion = load_body(), BodyMotion.zero_pose(6)
    plain, both = small(), beside("face", "hands")
    assert both.picture_size == (128, 256)
    assert beside("hands").picture_size == (128, 192)
    (alone,) = render_stills(body, motion, [3], plain)
    (picture,) = render_stills(body, motion, [3], both)
    front, face, right, left = (picture[panel.box] for panel in both.panels)
    inside = slice(2, -2)  # of the lines between panels
    assert np.abs(front[inside].astype(int) - alone[inside]).max() <= 1
    for panel in (face, right, left):
        part = panel[inside, inside].astype(int)
        shown = (np.abs(part - part[0, -1]).max(axis=2) > 25).mean()
        assert 0.15 < shown < 0.8, "a close-up is filled by what it shows"
    assert front.shape == (128, 128, 3) and face.shape == (64, 128, 3)
    assert right.shape == left.shape == (64, 64, 3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"width": 511}, "511 x 512 .*even"),
        ({"width": 32}, "32 x 512 pixels is outside the limits"),
        ({"height": 9000}, "64 to 2160"),
    ],
)
def test_impossible_settings_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        RenderSettings(**changes)
