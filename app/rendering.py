"""One motion file to a video, a sheet of stills or a 3D file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from app.errors import RunError
from app.loaded import get_body
from app.request import View

if TYPE_CHECKING:
    from renderer.body import Body, BodyMotion
    from renderer.render import RenderSettings

MAX_STILLS = 64
ENDINGS = (".mp4", ".png", ".glb", ".bvh")


@dataclass(frozen=True)
class _Task:
    body: Body
    motion: BodyMotion
    out: Path
    speech: Path | None
    body_path: Path | None
    view: View
    size: int
    is_draft: bool
    num_stills: int
    on_progress: Callable[[float], None]


def render_motion(
    motion_path: Path,
    out: Path,
    *,
    speech: Path | None = None,
    body_path: Path | None = None,
    view: View = "front",
    size: int = 720,
    is_draft: bool = False,
    num_stills: int = 7,
    on_progress: Callable[[float], None] = lambda fraction: None,
) -> tuple[str, ...]:
    """Write ``out`` in the format of its ending; returns what a person should know of it.

    Raises:
        RunError: if the ending is not one of `ENDINGS`, or the folder cannot be used.
        MotionError, BodyError, GLError, VideoError: each with one sentence.
    """
    from model.motion import load_motion

    draw = {".mp4": _video, ".png": _stills, ".glb": _glb, ".bvh": _bvh}.get(out.suffix.lower())
    if draw is None:
        raise RunError(f"{out.name} must end in one of {', '.join(ENDINGS)}.")
    if not out.parent.is_dir():
        raise RunError(f"The folder {out.parent} does not exist; create it first.")
    if not 1 <= num_stills <= MAX_STILLS:
        raise RunError(f"Stills must be 1 to {MAX_STILLS}; got {num_stills}.")
    if speech is not None and not speech.is_file():
        raise RunError(f"There is no speech file at {speech}.")
    motion = body_motion(load_motion(motion_path))
    body = get_body(body_path)
    draw(
        _Task(
            *(body, motion, out, speech, body_path, view, size, is_draft, num_stills, on_progress)
        )
    )
    return body.notes(motion)


def body_motion(motion) -> BodyMotion:
    """A `model.motion.Motion` for the renderer, which does not know the model's types."""
    from renderer.body import BodyMotion

    return BodyMotion(
        poses=motion.poses,
        trans=motion.trans,
        expressions=motion.expressions,
        expression_basis=motion.expression_basis,
        betas=motion.betas,
    )


def render_settings(view: View, size: int, is_draft: bool = False) -> RenderSettings:
    """Square pictures of that size.

    Raises:
        RunError: if the size cannot be drawn or encoded.
    """
    from renderer.render import RenderSettings

    try:
        return RenderSettings(width=size, height=size, view=view, antialias=not is_draft)
    except ValueError as error:
        raise RunError(str(error)) from error


def _settings(task: _Task) -> RenderSettings:
    return render_settings(task.view, task.size, task.is_draft)


def _video(task: _Task) -> None:
    from renderer.worker import RenderJob, run_job

    run_job(
        RenderJob(
            motion=task.motion,
            out=task.out,
            speech_wav=task.speech,
            settings=_settings(task),
            body_path=task.body_path,
        ),
        task.on_progress,
    )


def _stills(task: _Task) -> None:
    import numpy as np
    from PIL import Image

    from model.files import written_atomically
    from renderer.worker import RenderJob, run_job

    last = task.motion.num_frames - 1
    count = min(task.num_stills, task.motion.num_frames)
    frames = tuple(int(frame) for frame in np.linspace(0, last, count).round())
    result = run_job(
        RenderJob(
            motion=task.motion,
            settings=_settings(task),
            body_path=task.body_path,
            still_frames=frames,
        ),
        task.on_progress,
    )
    with written_atomically(task.out) as partial:
        Image.fromarray(np.concatenate(list(result.stills), axis=1)).save(partial)


def _glb(task: _Task) -> None:
    from renderer.glb import write_glb

    write_glb(task.body, task.motion, task.out)


def _bvh(task: _Task) -> None:
    from renderer.bvh import write_bvh

    write_bvh(task.body, task.motion, task.out)
