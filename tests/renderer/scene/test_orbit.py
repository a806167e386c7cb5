"""Cameras that a person has moved."""

import numpy as np
import pytest

from renderer.body.body import load_body
from renderer.scene.camera import FARTHEST_M, STEEPEST_RAD, ZOOMS, Camera, Orbit
from renderer.scene.panels import Panel
from renderer.scene.stage import MIDDLE_M, camera_track, close_up_tracks, set_stage
from tests.renderer.scene.test_camera import waving_motion

CAMERA = Camera(eye=(0.3, 1.4, 4.0), target=(0.3, 1.1, 0.0))
AROUND = np.array([0.1, 1.0, 0.2])


def middle_of(camera: Camera) -> np.ndarray:
    """On the camera's axis, as deep as what it is moved around."""
    backward = camera.axes()[2]
    return np.asarray(camera.eye) - backward @ (np.asarray(camera.eye) - AROUND) * backward


def test_one_that_nobody_has_moved_stands_where_it_was():
    moved = Orbit().moved(CAMERA, AROUND)
    assert np.allclose(moved.eye, CAMERA.eye) and np.allclose(moved.axes(), CAMERA.axes())


@pytest.mark.parametrize(
    "orbit", [Orbit(0.7), Orbit(-2.0, 0.4), Orbit(0.0, -0.6, 3.0), Orbit(3.0, 1.0, 0.5)]
)
def test_turned_and_nearer_it_keeps_its_middle_in_the_middle(orbit: Orbit):
    moved, middle = orbit.moved(CAMERA, AROUND), middle_of(CAMERA)
    assert moved.project(middle, 400, 300) == pytest.approx([200, 150])
    before, after = (np.linalg.norm(np.subtract(each.eye, middle)) for each in (CAMERA, moved))
    assert after == pytest.approx(before / orbit.zoom)
    assert moved.axes()[0][1] == pytest.approx(0.0), "it stands upright"


def test_a_quarter_turn_sees_the_left_of_the_body():
    level = Camera(eye=(0.0, 1.0, 4.0), target=(0.0, 1.0, 0.0))
    moved = Orbit(np.pi / 2).moved(level, np.array([0.0, 1.0, 0.0]))
    assert moved.eye == pytest.approx((4.0, 1.0, 0.0))
    aside = Orbit(right_m=0.5, up_m=-0.25).moved(level, np.array([0.0, 1.0, 0.0]))
    assert aside.eye == pytest.approx((0.5, 0.75, 4.0))


def test_it_never_stands_on_its_head():
    moved = Orbit(pitch_rad=STEEPEST_RAD).moved(CAMERA, AROUND)
    assert np.arcsin(moved.axes()[2][1]) == pytest.approx(STEEPEST_RAD)


@pytest.mark.parametrize(
    ("orbit", "words"),
    [
        (Orbit(pitch_rad=1.6), "pitch is -1.48 to 1.48; got 1.6"),
        (Orbit(zoom=20.0), f"zoom is {ZOOMS[0]:g} to {ZOOMS[1]:g}; got 20"),
        (Orbit(zoom=float("nan")), "got nan"),
        (Orbit(right_m=2 * FARTHEST_M), "way to the right"),
        (Orbit(yaw_rad=float("inf")), "yaw"),
    ],
)
def test_where_no_camera_of_the_stage_stands_is_refused(orbit: Orbit, words: str):
    with pytest.raises(ValueError, match=words):
        orbit.check()


def test_a_stage_is_seen_from_elsewhere_around_the_middle_of_its_bodies():
    stage = set_stage(load_body(), [waving_motion(20)], framing="knees")
    assert stage.seen_from(Orbit()) is stage
    turned = stage.seen_from(Orbit(yaw_rad=np.pi, zoom=2.0))
    pivot = np.array([stage.centre_xz[0], stage.floor_m + MIDDLE_M, stage.centre_xz[1]])
    backward = stage.camera.axes()[2]
    depth = float(backward @ (np.asarray(stage.camera.eye) - pivot))
    behind = turned.camera.axes()[2]
    assert behind[2] == pytest.approx(-backward[2]) and behind[1] == pytest.approx(backward[1])
    middle = np.asarray(stage.camera.eye) - depth * backward
    assert np.asarray(turned.camera.eye) == pytest.approx(middle + depth / 2 * behind)


def test_cameras_follow_the_motion_they_are_told_to_and_no_other():
    body = load_body()
    calm, other = waving_motion(20), waving_motion(20, walk_m=3.0)
    stage = set_stage(body, [calm, other], close_ups=[Panel("right_hand", 0, 0, 40, 40)])
    assert stage.is_following
    told, way = stage.following(body, calm), camera_track(body, calm, "front", stage)
    assert np.array_equal(camera_track(body, other, "front", told), way)
    assert np.array_equal(close_up_tracks(body, other, told), close_up_tracks(body, calm, stage))
    assert not np.allclose(camera_track(body, other, "front", stage), way)
