"""A motion to a video, to pictures, or to a file for 3D software."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from app.notebook.inputs import MotionLike, SpeechLike, motion_in, speech_in
from app.run.output.bars import Bars
from app.run.videos.export import RenderAsk, render_motion


def render(
    motion: MotionLike,
    out: str | Path,
    *,
    speech: SpeechLike | None = None,
    progress: bool = True,
    **asked: Any,
) -> tuple[Path, ...]:
    """Draw a motion; the ending of ``out`` says what is made: .mp4, .png, .glb, .bvh, .blender.npz.

    Args:
        speech: sound of the video.
        asked: further fields of `app.run.videos.export.RenderAsk`, such as ``size``,
            ``views``, ``close_ups``, ``framing``, ``num_stills`` or ``sheet_every``.

    Returns:
        The files that were written.

    Raises:
        ValueError: of what cannot be done, with one sentence.
    """
    out = Path(out)
    with TemporaryDirectory() as held, Bars(is_shown=progress, stays=False) as bars:
        sound = None if speech is None else speech_in(Path(held), speech)
        motions = (motion_in(Path(held), motion),)
        files, _ = render_motion(
            RenderAsk(motions=motions, out=out, speech=sound, **asked), bars.take
        )
    return files
