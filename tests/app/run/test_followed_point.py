"""The followed point: each fingertip and each joint, of the open body and of one's own."""

import numpy as np
import pytest

from app.errors import RunError
from app.run.bodies import PointTracker, body_motion
from conventions.joints import FINGERTIP_JOINTS, FINGERTIP_NAMES, FINGERTIP_VERTICES, JOINT_NAMES
from model.motion.kinematics import open_body_skeleton
from model.motion.tracks import track_points
from renderer.body.body import Body, load_body
from tests.helpers import smooth_motion_example

MOTION = smooth_motion_example(num_frames=12)


@pytest.fixture(scope="module")
def body() -> Body:
    return load_body()


def test_every_joint_and_every_fingertip_beyond_its_last_joint_is_followed(body: Body) -> None:
    tracks = track_points(MOTION, open_body_skeleton())
    for joint, name in enumerate(JOINT_NAMES):
        source = PointTracker(name)
        assert source.position_kind == "joint"
        np.testing.assert_array_equal(source.track(MOTION), tracks.joints[:, joint])
    assert set(FINGERTIP_VERTICES) == set(FINGERTIP_NAMES)
    for tip, joint in zip(FINGERTIP_NAMES, FINGERTIP_JOINTS, strict=True):
        source = PointTracker(tip)
        beyond = np.linalg.norm(source.track(MOTION) - tracks.joints[:, joint], axis=1)
        assert source.position_kind == "rigid"
        assert beyond == pytest.approx(beyond[0]) and 0.01 < beyond[0] < 0.04


def test_a_body_of_ones_own_gives_a_vertex_or_its_own_joint(body: Body) -> None:
    elbow = PointTracker("right_elbow", body)
    expected = body.joint_positions(body_motion(MOTION))[:, JOINT_NAMES.index("right_elbow")]
    np.testing.assert_array_equal(elbow.track(MOTION), expected)
    assert (elbow.position_kind, elbow.title) == ("joint of the body", "Right elbow")
    assert PointTracker(body=body).position_kind == "vertex 7794"
    assert PointTracker("left_thumb", body).position_kind == "vertex 5361"
    with pytest.raises(RunError, match=r"no point 'nose' to track.*left_index.*right_wrist"):
        PointTracker("nose")


@pytest.mark.parametrize(
    ("point", "is_own", "num_frames", "pieces"),
    [
        ("right_middle", False, 4100, 2),
        ("right_wrist", False, 4100, 2),
        ("right_wrist", True, 4100, 2),
        ("right_middle", True, 130, 9),
    ],
)
def test_a_long_motion_is_followed_in_pieces_between_which_it_can_be_ended(
    body: Body, point: str, is_own: bool, num_frames: int, pieces: int
) -> None:
    motion = smooth_motion_example(num_frames)
    source = PointTracker(point, body if is_own else None)
    told: list[None] = []
    track = source.track(motion, on_piece=lambda: told.append(None))
    assert (track.shape, len(told)) == ((num_frames, 3), pieces)
    end = slice(num_frames - 10, None)
    np.testing.assert_allclose(track[end], source.track(motion.part(end)), atol=1e-6)

    def stop() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        source.track(motion, on_piece=stop)


def test_a_motion_is_followed_once_and_its_start_alone_where_that_is_enough() -> None:
    source = PointTracker()
    start = source.track(MOTION, num_frames=5)
    assert start.shape == (5, 3)
    whole = source.track(MOTION)
    np.testing.assert_array_equal(whole[:5], start)
    assert np.shares_memory(source.track(MOTION), whole)
    assert np.shares_memory(source.track(MOTION, num_frames=5), whole)
    assert not np.array_equal(source.track(MOTION.part(slice(1, None))), whole[:-1])
