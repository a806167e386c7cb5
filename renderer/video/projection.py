"""Where the joints of a body are in its pictures."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from renderer.body.body import Body, BodyMotion
from renderer.scene.stage import Stage, camera_track, frames_of
from renderer.video.render import RenderSettings


def projected_joints(
    body: Body, motion: BodyMotion, frames: Sequence[int], settings: RenderSettings, stage: Stage
) -> Float[np.ndarray, "N J 2"]:
    """Pixels of all joints in the pictures of some frames, (0, 0) at the upper left corner.

    The pictures are those that ``render_stills`` and ``render_video`` make with these settings on
    this stage, also where the camera follows the body. A joint may lie outside its picture, or be
    hidden behind the body in it.
    """
    chosen = list(frames)
    joints = body.joint_positions(frames_of(motion, chosen))
    track = camera_track(body, motion, settings.view, stage)[chosen]
    size = (settings.width, settings.height)
    return np.stack(
        [
            stage.camera.moved(offset).project(points, *size)
            for offset, points in zip(track, joints, strict=True)
        ]
    )
