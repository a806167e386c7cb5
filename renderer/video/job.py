"""What a rendering process is asked for, and what it answers."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from conventions.views import LOOKS
from renderer.body.body import BodyError, BodyMotion
from renderer.draw.offscreen import GLError
from renderer.scene.stage import Stage
from renderer.video.encoder import VideoError
from renderer.video.marks import Marks
from renderer.video.render import Cancelled, RenderSettings

KNOWN_ERRORS: dict[str, type[Exception]] = {
    error.__name__: error for error in (BodyError, Cancelled, GLError, ValueError, VideoError)
}
"""Errors that keep their type on the way from the child; each holds one sentence."""


@dataclass(frozen=True)
class RenderJob:
    """One video, or only stills of a motion."""

    motion: BodyMotion
    out: Path | None = None
    """The mp4 to write; None draws the stills alone."""
    speech_wav: Path | None = None
    settings: RenderSettings = field(default_factory=RenderSettings)
    body_path: Path | None = None
    """An SMPL-X npz; None is the open body."""
    look: str = LOOKS[0]
    """Of the open body."""
    stage: Stage | None = None
    """Shared camera and floor; None makes them for this motion alone."""
    marks: Marks | None = None
    """What else is shown in the pictures."""
    still_frames: tuple[int, ...] = ()
    """Frames to return as pictures, in this order."""
    num_processes: int | None = None
    """How many draw the frames of a video; None is as many as its cores and length are worth."""


@dataclass(frozen=True)
class RenderResult:
    """What a job gave."""

    out: Path | None
    stills: UInt8[np.ndarray, "N H W 3"]
