"""Cameras put things where they belong, keep whole motions in the picture, and can be moved."""

from dataclasses import replace

import hypothesis.strategies as st
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis.extra import numpy as hnp

from conventions.joints import FINGERTIP_VERTICES, JOINT_INDEX
from conventions.views import VIEWS
from renderer.body.body import BodyMotion, load_body
from renderer.scene.camera import (
    MARGIN_NDC,
    MAX_PAN_M,
    MAX_PITCH_RAD,
    ZOOM_RANGE,
    Camera,
    Orbit,
    extreme_positions_per_joint,
    fit_camera,
    view_axes,
)
from renderer.scene.camera_setup import (
    ORBIT_CENTRE_HEIGHT_M,
    Panel,
    close_up_mesh,
    layout_panels,
    make_camera_setup,
    select_frames,
)

COORDINATES = st.floats(-3.0, 3.0, width=32)
POINTS = hnp.arrays(np.float64, st.tuples(st.integers(1, 12), st.just(3)), elements=COORDINATES)


def sees(camera: Camera, points: np.ndarray, width: int, height: int) -> np.ndarray:
    """Which points fall inside the picture."""
    pixels = camera.project(points, width, height)
    return ((pixels >= 0.0) & (pixels <= (width, height))).all(axis=-1)


def test_projection_of_a_hand_computed_point():
    # Half of a 90 degree picture 100 px high is 50 px; 1 m aside at 5 m is a fifth of it.
    camera = Camera(eye=(0.0, 0.0, 5.0), target=(0.0, 0.0, 0.0), yfov_rad=np.pi / 2)
    pixels = camera.project(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), 200, 100)
    np.testing.assert_allclose(pixels, [[100, 50], [110, 50], [100, 40]], atol=1e-9)


def test_points_behind_the_camera_are_not_seen():
    camera = Camera(eye=(0.0, 0.0, 5.0), target=(0.0, 0.0, 0.0))
    assert np.isnan(camera.project(np.array([0.0, 0.0, 6.0]), 10, 10)).all()
    assert not sees(camera, np.array([0.0, 0.0, 6.0]), 10, 10)


@pytest.mark.parametrize(
    ("view", "towards_eye"),
    [("front", (0.0, 0.0, 1.0)), ("side", (1.0, 0.0, 0.0)), ("three_quarter", (0.643, 0, 0.766))],
)
def test_each_view_looks_from_its_side_and_a_little_down(view, towards_eye):
    right, up, backward = view_axes(view)
    assert backward[1] > 0.05
    flat = backward * (1.0, 0.0, 1.0)
    np.testing.assert_allclose(flat / np.linalg.norm(flat), towards_eye, atol=1e-3)
    assert up[1] > 0.9
    np.testing.assert_allclose(np.cross(right, up), backward, atol=1e-12)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(POINTS, st.sampled_from(VIEWS), st.integers(400, 3000), st.floats(0.0, 0.4))
def test_every_ball_lies_inside_the_picture(points, view, width, radius):
    height = 1000
    camera = fit_camera(points, view, aspect=width / height, radius_m=radius)
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(64, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    surface = (points[:, None] + 0.999 * radius * directions).reshape(-1, 3)
    pixels = camera.project(surface, width, height)
    free = 0.5 * MARGIN_NDC * np.array([width, height])
    assert (pixels > free - 1e-3).all() and (pixels < (width, height) - free + 1e-3).all()


def test_the_camera_comes_as_near_as_it_may():
    rng = np.random.default_rng(1)
    points = rng.normal(size=(50, 3))
    for view in VIEWS:
        pixels = fit_camera(points, view, aspect=1.5).project(points, 1500, 1000)
        used = np.ptp(pixels, axis=0) / (1500, 1000)
        # One axis decides the distance: it uses the picture up to the margin on both sides.
        assert used.max() == pytest.approx(1 - MARGIN_NDC, abs=1e-6)
        np.testing.assert_array_less(used, 1 - MARGIN_NDC + 1e-6)


@pytest.mark.parametrize("view", VIEWS)
def test_the_outermost_places_give_the_same_camera_as_all(view):
    radius = np.array([0.0, 0.1, 0.3])
    for seed in range(40):
        rng = np.random.default_rng(seed)
        points, aspect = rng.normal(size=(20, 3, 3)), rng.uniform(0.3, 3.0)
        eyes = [
            fit_camera(
                places.reshape(-1, 3), view, aspect=aspect, radius_m=np.tile(radius, len(places))
            ).eye
            for places in (points, extreme_positions_per_joint(points, view, aspect=aspect))
        ]
        np.testing.assert_allclose(*eyes, rtol=0.0, atol=1e-9)


def waving_motion(num_frames: int = 40, walk_m: float = 0.0) -> BodyMotion:
    """Arms swung wide, over the head and forward, while walking along x."""
    motion = BodyMotion.zero_pose(num_frames)
    poses = motion.poses.reshape(num_frames, 55, 3).copy()
    swing = np.sin(np.linspace(0.0, 1.6 * np.pi, num_frames))
    poses[:, JOINT_INDEX["left_shoulder"], 2] = 1.4 * swing
    poses[:, JOINT_INDEX["right_shoulder"], 1] = 1.3 * swing
    poses[:, JOINT_INDEX["right_elbow"], 1] = 0.6
    poses[:, JOINT_INDEX["spine1"], 0] = 0.5 * swing
    trans = np.linspace(0.0, walk_m, num_frames)[:, None] * np.array([[1.0, 0.0, 0.3]])
    return replace(motion, poses=poses.reshape(num_frames, 165), trans=trans)


def test_from_the_knees_up_a_body_is_larger_and_nothing_above_them_is_cut():
    body, motion = load_body(), waving_motion(30)
    owner = np.asarray(body.weights.argmax(axis=1)).ravel()
    legs = [JOINT_INDEX[f"{s}_{n}"] for s in ("left", "right") for n in ("knee", "ankle", "foot")]
    above = ~np.isin(owner, legs)
    camera = make_camera_setup(body, [motion], aspect=0.75, framing="knees").camera
    for vertices in np.concatenate(
        list(body.posed_vertices(select_frames(motion, slice(0, 30, 4))))
    ):
        assert sees(camera, vertices[above], 300, 400).all()
    standing = BodyMotion.zero_pose(2)
    poses = standing.poses.reshape(2, 55, 3).copy()
    for side, sign in (("left", -1.0), ("right", 1.0)):
        poses[:, JOINT_INDEX[f"{side}_shoulder"], 2] = 1.2 * sign  # arms down
    standing = replace(standing, poses=poses.reshape(2, 165))
    joints = body.joint_positions(standing)[0]
    trunk = joints[[JOINT_INDEX["head"], JOINT_INDEX["pelvis"]]]
    whole, knees = (
        make_camera_setup(body, [standing], aspect=0.75, framing=framing).camera
        for framing in ("whole", "knees")
    )
    tall = [np.ptp(camera.project(trunk, 300, 400)[:, 1]) for camera in (whole, knees)]
    assert tall[1] > 1.25 * tall[0]
    feet = body.template[np.isin(owner, [JOINT_INDEX["left_foot"], JOINT_INDEX["right_foot"]])]
    assert not sees(knees, feet, 300, 400).any()


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_arm_of_a_hand_beside_the_picture_ends_closed_in_the_upper_arm(side):
    body = load_body()
    part = close_up_mesh(body, f"{side}_hand")
    shown = trimesh.Trimesh(body.template[part.vertices], part.faces, process=False)
    shown.merge_vertices()
    assert shown.is_winding_consistent
    shoulder, elbow, wrist = (
        body.rest_joints[JOINT_INDEX[f"{side}_{name}"]] for name in ("shoulder", "elbow", "wrist")
    )
    arm = elbow - shoulder
    assert 0.5 <= ((shown.vertices - shoulder) @ arm).min() / (arm @ arm) < 0.55
    open_edges = trimesh.grouping.group_rows(shown.edges_sorted, require_count=1)
    sleeve = shown.vertices[shown.edges_sorted[open_edges]]
    assert np.linalg.norm(sleeve - wrist, axis=-1).max() < 0.05, "that of the sleeve alone is open"


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_hand_beside_the_picture_stays_in_its_place_and_keeps_its_tremble(side):
    body, view = load_body(), f"{side}_hand"
    panels = layout_panels("front", 400, 400, ["hands"])[1:]
    place = [panel.view for panel in panels].index(view)
    tips = [vertex for name, vertex in FINGERTIP_VERTICES.items() if name.startswith(side)]

    def shown(motion: BodyMotion) -> np.ndarray:
        stage = make_camera_setup(body, [motion], close_ups=panels)
        shot, track = (
            stage.panel_cameras[1 + place],
            stage.followed_positions(body, motion)[1 + place],
        )
        chunks = np.concatenate([chunk[:, tips] for chunk in body.posed_vertices(motion)])
        cameras = [shot.camera.translated(offset) for offset in track]
        assert all(
            sees(camera, tip, 200, 200).all() for camera, tip in zip(cameras, chunks, strict=True)
        )
        pixels = [c.project(tip, 200, 200) for c, tip in zip(cameras, chunks, strict=True)]
        return np.mean(pixels, axis=1)

    calm = waving_motion(90, walk_m=1.5)
    poses = calm.poses.reshape(90, 55, 3).copy()
    poses[::2, JOINT_INDEX[f"{side}_wrist"], 2] += 0.05  # 15 Hz
    still, trembling = shown(calm), shown(replace(calm, poses=poses.reshape(90, 165)))
    jumps = [np.abs(np.diff(way, n=2, axis=0)).mean() for way in (still, trembling)]
    assert jumps[1] > 5 * jumps[0]
    from_middle = np.abs(still[5:-5] - 100.0)
    assert from_middle.max() < 60, "of 200 pixels, while the body walks and swings its arms"


def test_the_face_fills_its_close_up_and_the_camera_follows_it():
    body = load_body()
    still, walking, some = BodyMotion.zero_pose(40), waving_motion(walk_m=3.0), slice(0, 40, 5)
    head = body.template[:, 1] > body.rest_joints[JOINT_INDEX["head"], 1] + 0.05
    stage = make_camera_setup(body, [still, walking], "face")
    (heads,) = (chunk[:, head] for chunk in body.posed_vertices(select_frames(walking, some)))
    for vertices, offset in zip(
        heads, stage.followed_positions(body, walking)[0][some], strict=True
    ):
        assert sees(stage.camera.translated(offset), vertices, 400, 400).all()
    stage = make_camera_setup(body, [still], "face")
    camera = stage.camera.translated(stage.followed_positions(body, still)[0][0])
    pixels = camera.project(body.template[head], 400, 400)
    assert np.ptp(pixels[:, 1]) > 130


@pytest.mark.parametrize("view", ["front", "three_quarter", "side"])
def test_a_body_that_wanders_far_stays_large_and_whole(view):
    body = load_body()
    stays, way_m = waving_motion(120), np.zeros((120, 3))
    way_m[60:] = (20.0, 0.0, -5.0)
    way_m[90:, 1] = 8.0
    motions = [waving_motion(120, walk_m=9.0), replace(stays, trans=way_m), stays]
    stage = make_camera_setup(body, motions, view)
    heights = []
    for motion in motions:
        track, some = stage.followed_positions(body, motion)[0], slice(0, 120, 14)
        (posed,) = body.posed_vertices(select_frames(motion, some))
        for vertices, offset in zip(posed, track[some], strict=True):
            camera = stage.camera.translated(offset)
            assert sees(camera, vertices, 500, 500).all()
            heights.append(np.ptp(camera.project(vertices, 500, 500)[:, 1]))
    assert min(heights) > 200, "of 500 pixels"
    assert np.ptp(track, axis=0).max() < 0.2, "the one that stays has a camera that stays"


@pytest.mark.parametrize(
    ("view", "size"), [("front", (512, 512)), ("three_quarter", (320, 480)), ("side", (854, 480))]
)
def test_one_stage_shows_all_of_all_motions_of_a_comparison_and_stands_still(view, size):
    body = load_body()
    motions = [waving_motion(walk_m=0.7), waving_motion(walk_m=-0.7), BodyMotion.zero_pose(3)]
    stage = make_camera_setup(body, motions, view, size[0] / size[1])
    assert stage == make_camera_setup(body, motions[::-1], view, size[0] / size[1])
    assert (
        not stage.panel_cameras[0].is_following
        and not stage.followed_positions(body, motions[0])[0].any()
    )
    for motion in motions:
        for chunk in body.posed_vertices(select_frames(motion, slice(0, None, 3))):
            assert sees(stage.camera, chunk, *size).all()


def test_the_floor_lies_under_the_soles():
    body = load_body()
    motion = BodyMotion.zero_pose(4)
    lifted = replace(motion, trans=motion.trans + np.array([0.0, 0.7, 0.0]))
    lowest = float(body.template[:, 1].min())
    assert make_camera_setup(body, [motion]).floor_m == pytest.approx(lowest, abs=0.01)
    assert make_camera_setup(body, [lifted]).floor_m == pytest.approx(lowest + 0.7, abs=0.01)


CAMERA = Camera(eye=(0.3, 1.4, 4.0), target=(0.3, 1.1, 0.0))
AROUND = np.array([0.1, 1.0, 0.2])


def middle_of(camera: Camera) -> np.ndarray:
    """On the camera's axis, as deep as what it is moved around."""
    backward = camera.axes()[2]
    return np.asarray(camera.eye) - backward @ (np.asarray(camera.eye) - AROUND) * backward


@pytest.mark.parametrize(
    "orbit", [Orbit(), Orbit(-2.0, 0.4), Orbit(0.0, -0.6, 3.0), Orbit(3.0, 1.0, 0.5)]
)
def test_turned_and_nearer_it_keeps_its_middle_in_the_middle(orbit):
    moved, middle = orbit.apply(CAMERA, AROUND), middle_of(CAMERA)
    assert moved.project(middle, 400, 300) == pytest.approx([200, 150])
    before, after = (np.linalg.norm(np.subtract(each.eye, middle)) for each in (CAMERA, moved))
    assert after == pytest.approx(before / orbit.zoom)
    assert moved.axes()[0][1] == pytest.approx(0.0), "it stands upright"
    if orbit == Orbit():
        assert np.allclose(moved.eye, CAMERA.eye) and np.allclose(moved.axes(), CAMERA.axes())


def test_a_quarter_turn_sees_the_left_of_the_body():
    level = Camera(eye=(0.0, 1.0, 4.0), target=(0.0, 1.0, 0.0))
    moved = Orbit(np.pi / 2).apply(level, np.array([0.0, 1.0, 0.0]))
    assert moved.eye == pytest.approx((4.0, 1.0, 0.0))
    aside = Orbit(right_m=0.5, up_m=-0.25).apply(level, np.array([0.0, 1.0, 0.0]))
    assert aside.eye == pytest.approx((0.5, 0.75, 4.0))
    moved = Orbit(pitch_rad=MAX_PITCH_RAD).apply(CAMERA, AROUND)
    assert np.arcsin(moved.axes()[2][1]) == pytest.approx(MAX_PITCH_RAD)


@pytest.mark.parametrize(
    ("orbit", "words"),
    [
        (Orbit(pitch_rad=1.6), "pitch must be from -1.48 to 1.48; got 1.6"),
        (Orbit(zoom=20.0), f"zoom must be from {ZOOM_RANGE[0]:g} to {ZOOM_RANGE[1]:g}; got 20"),
        (Orbit(zoom=float("nan")), "got nan"),
        (Orbit(right_m=2 * MAX_PAN_M), "offset to the right"),
        (Orbit(yaw_rad=float("inf")), "yaw"),
    ],
)
def test_where_no_camera_of_the_stage_stands_is_refused(orbit, words):
    with pytest.raises(ValueError, match=words):
        orbit.check()


def test_a_stage_is_seen_from_elsewhere_around_the_middle_of_its_bodies():
    stage = make_camera_setup(load_body(), [waving_motion(20)], framing="knees")
    assert stage.with_orbit(Orbit()) is stage
    turned = stage.with_orbit(Orbit(yaw_rad=np.pi, zoom=2.0))
    pivot = np.array(
        [stage.centre_xz[0], stage.floor_m + ORBIT_CENTRE_HEIGHT_M, stage.centre_xz[1]]
    )
    backward = stage.camera.axes()[2]
    depth = float(backward @ (np.asarray(stage.camera.eye) - pivot))
    behind = turned.camera.axes()[2]
    assert behind[2] == pytest.approx(-backward[2]) and behind[1] == pytest.approx(backward[1])
    middle = np.asarray(stage.camera.eye) - depth * backward
    assert np.asarray(turned.camera.eye) == pytest.approx(middle + depth / 2 * behind)


def test_cameras_follow_the_motion_they_are_told_to_and_no_other():
    body = load_body()
    calm, other = waving_motion(20), waving_motion(20, walk_m=3.0)
    stage = make_camera_setup(body, [calm, other], close_ups=[Panel("right_hand", 0, 0, 40, 40)])
    assert stage.panel_cameras[0].is_following
    ways = stage.followed_positions(body, calm)
    assert np.array_equal(stage.with_camera_paths(ways).followed_positions(body, other), ways)
    assert not np.allclose(stage.followed_positions(body, other)[0], ways[0])
