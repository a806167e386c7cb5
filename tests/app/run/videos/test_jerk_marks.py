"""Jerk around the snapshots: shaken joints stand out, and a smooth motion stays pale."""

import numpy as np

from app.run.body_motion import body_motion
from app.run.videos.comparison import AROUND_FRAMES, LEAST_FULL_SCALE, jerk_marks
from conventions.joints import JOINT_INDEX
from renderer.body.body import load_body
from renderer.scene.stage import set_stage
from renderer.video.settings import RenderSettings
from tests.helpers import smooth_motion_example


def test_the_shaken_joint_stands_out_where_it_is_shaken() -> None:
    smooth, shaken = (body_motion(smooth_motion_example(90)) for _ in range(2))
    elbow, wrist = JOINT_INDEX["right_elbow"], JOINT_INDEX["right_wrist"]
    rng = np.random.default_rng(0)
    shaken.poses[60:, 3 * elbow : 3 * elbow + 3] += rng.normal(scale=0.1, size=(30, 3))
    motions = {"smooth": smooth, "shaken": shaken}
    body, settings = load_body(), RenderSettings(128, 128)
    stage = set_stage(body, list(motions.values()))

    marks = jerk_marks(body, motions, (0, 40, 75), settings, stage)

    values = marks.values
    assert values["shaken"].shape == (3, 55) and marks.pixels["shaken"].shape == (3, 55, 2)
    assert 40 + AROUND_FRAMES < 60
    np.testing.assert_allclose(values["shaken"][:2], values["smooth"][:2], rtol=1e-3, atol=0.5)
    assert values["shaken"][2, wrist] > 5 * values["smooth"][2, wrist]
    assert values["shaken"][2, elbow] < 2 * values["smooth"][2, elbow]  # it turns, and stays
    assert marks.full_scale >= values["shaken"][2, wrist] > LEAST_FULL_SCALE


def test_a_smooth_motion_has_no_strong_mark_and_one_frame_none() -> None:
    body, settings = load_body(), RenderSettings(128, 128)
    calm = body_motion(smooth_motion_example(60))
    calm.poses[:] *= 0.3
    motions = {"a": calm}
    stage = set_stage(body, list(motions.values()))
    marks = jerk_marks(body, motions, (0, 50), settings, stage)
    assert marks.full_scale == LEAST_FULL_SCALE
    assert marks.values["a"].max() < 0.5 * LEAST_FULL_SCALE

    one = {"a": body_motion(smooth_motion_example(1))}
    assert not jerk_marks(body, one, (0,), settings, stage).values["a"].any()
