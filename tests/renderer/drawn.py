"""Pictures drawn in the process of a test, and the processes that draw for it."""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from renderer.body.body import Body, BodyMotion
from renderer.scene.camera_setup import CameraSetup
from renderer.video.overlays import Overlays
from renderer.video.render import RenderSettings, draw_frames, stack_pictures


def render_stills(
    body: Body,
    motion: BodyMotion,
    frames: Sequence[int],
    settings: RenderSettings,
    *,
    stage: CameraSetup | None = None,
    overlays: Overlays | None = None,
) -> UInt8[np.ndarray, "N H W C"]:
    """Of single frames, framed as the video of the whole motion would be."""
    pictures = draw_frames(body, motion, settings, stage, overlays, frames)
    return stack_pictures([picture.copy() for picture in pictures], settings)


def children_that_draw() -> list[int]:
    """Those of this process; other tests draw beside this one."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            parent = (entry / "stat").read_text().rsplit(")", 1)[1].split()[1]
            command = (entry / "cmdline").read_bytes()  # none of one that waits to be counted
        except OSError:  # it has just ended
            continue
        if int(parent) == os.getpid() and b"renderer.video.workers" in command.split(b"\0"):
            found.append(int(entry.name))
    return found
