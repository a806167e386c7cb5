"""The followed point: each fingertip and each joint, of the open body and of one's own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.errors import RunError
from app.run.body_motion import body_motion
from app.run.followed_point import choose_tip_source
from conventions.joints import FINGERTIP_JOINTS, FINGERTIP_NAMES, JOINT_NAMES, TIP_VERTICES
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion
from model.motion.tracks import track_points
from renderer.body.body import load_body
from tests.helpers import smooth_motion_example

MOTION = smooth_motion_example(num_frames=12)


def piece_of(motion: Motion, frames: slice) -> Motion:
    return replace(
        motion,
        poses=motion.poses[frames],
        trans=motion.trans[frames],
        expressions=motion.expressions[frames],
    )


def test_every_fingertip_is_followed_beyond_its_last_joint() -> None:
    tracks = track_points(MOTION, open_body_skeleton())
    assert set(TIP_VERTICES) == set(FINGERTIP_NAMES)
    for tip, joint in zip(FINGERTIP_NAMES, FINGERTIP_JOINTS, strict=True):
        source = choose_tip_source(load_body(), None, tip)
        beyond = np.linalg.norm(source.track(MOTION) - tracks.joints[:, joint], axis=1)
        assert source.name == "rigid"
        assert beyond == pytest.approx(beyond[0]) and 0.01 < beyond[0] < 0.04


def test_every_joint_is_followed() -> None:
    tracks = track_points(MOTION, open_body_skeleton())
    for joint, name in enumerate(JOINT_NAMES):
        source = choose_tip_source(load_body(), None, name)
        assert source.name == "joint"
        np.testing.assert_array_equal(source.track(MOTION), tracks.joints[:, joint])


def test_a_body_of_ones_own_gives_a_vertex_or_its_own_joint() -> None:
    body = load_body()  # the source asks only where the body came from
    own = Path("own.npz")
    elbow = choose_tip_source(body, own, "right_elbow")
    expected = body.joint_positions(body_motion(MOTION))[:, JOINT_NAMES.index("right_elbow")]
    np.testing.assert_array_equal(elbow.track(MOTION), expected)
    assert (elbow.name, elbow.title) == ("joint of the body", "Right elbow")
    assert choose_tip_source(body, own).name == "vertex 7794"
    assert choose_tip_source(body, own, "left_thumb").name == "vertex 5361"


@pytest.mark.parametrize(
    ("point", "body", "num_frames", "pieces"),
    [
        ("right_middle", None, 4100, 2),
        ("right_wrist", None, 4100, 2),
        ("right_wrist", Path("own.npz"), 4100, 2),
        ("right_middle", Path("own.npz"), 130, 3),
    ],
)
def test_a_long_motion_is_followed_in_pieces_between_which_it_can_be_ended(
    point: str, body: Path | None, num_frames: int, pieces: int
) -> None:
    motion = smooth_motion_example(num_frames)
    source = choose_tip_source(load_body(), body, point)
    told: list[None] = []
    track = source.track(motion, on_piece=lambda: told.append(None))
    assert (track.shape, len(told)) == ((num_frames, 3), pieces)
    end = np.s_[num_frames - 10 :]
    np.testing.assert_allclose(track[end], source.track(piece_of(motion, end)), atol=1e-6)

    def stop() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        source.track(motion, on_piece=stop)


def test_a_motion_is_followed_once_and_its_start_alone_where_that_is_enough() -> None:
    source = choose_tip_source(load_body(), None)
    start = source.track(MOTION, num_frames=5)
    assert start.shape == (5, 3)
    whole = source.track(MOTION)
    np.testing.assert_array_equal(whole[:5], start)
    assert np.shares_memory(source.track(MOTION), whole)
    assert np.shares_memory(source.track(MOTION, num_frames=5), whole)
    assert not np.array_equal(source.track(piece_of(MOTION, np.s_[1:])), whole[:-1])


def test_another_point_is_refused_with_the_choice() -> None:
    with pytest.raises(RunError, match=r"no point 'nose' to follow.*left_index.*right_wrist"):
        choose_tip_source(load_body(), None, "nose")
