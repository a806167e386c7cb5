"""Pictures drawn in the process of a test."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import UInt8

from renderer.body.body import Body, BodyMotion
from renderer.scene.stage import Stage
from renderer.video.marks import Marks
from renderer.video.render import RenderSettings, draw_frames, stacked


def render_stills(
    body: Body,
    motion: BodyMotion,
    frames: Sequence[int],
    settings: RenderSettings,
    *,
    stage: Stage | None = None,
    marks: Marks | None = None,
) -> UInt8[np.ndarray, "N H W C"]:
    """Of single frames, framed as the video of the whole motion would be."""
    pictures = draw_frames(body, motion, settings, stage, marks, frames)
    return stacked([picture.copy() for picture in pictures], settings)
