"""A motion to a video, to pictures, or to a file for 3D software."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Any

from app.notebook.inputs import MotionLike, SpeechLike, motion_file, speech_file
from app.notebook.progress import Bar
from app.run.videos.export import RenderRequest, render_motion


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
        asked: further fields of `app.run.videos.export.RenderRequest`, such as ``size``,
            ``views``, ``close_ups``, ``framing``, ``num_stills`` or ``sheet_every``.

    Returns:
        The files that were written.

    Raises:
        ValueError: of what cannot be done, with one sentence.
    """
    out = Path(out)
    with ExitStack() as held:
        bar = held.enter_context(Bar(f"draw {out.name}", progress))
        sound = None if speech is None else held.enter_context(speech_file(speech))
        moved = held.enter_context(motion_file(motion))
        files, _ = render_motion(RenderRequest(moved, out, sound, **asked), bar.take)
    return files
