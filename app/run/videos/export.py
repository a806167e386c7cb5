"""One motion file to videos, pictures or a file for 3D software."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from app.errors import RunError
from app.flags import File, written
from app.run.body_motion import body_motion
from app.run.followed_point import choose_tip_source
from app.run.models import get_body
from app.run.output.telling import share_teller
from app.run.requests.display import Display, check_display
from app.run.requests.request import (
    Assumed,
    CloseUps,
    Height,
    Look,
    OnEvent,
    ShouldCancel,
    Views,
    check_size,
)
from app.run.videos.videos import VideoOptions, draw_videos, jobs_of
from conventions.views import LOOKS, Framing, View
from model.formats.reading import Told, lengths_apart

if TYPE_CHECKING:
    import numpy as np

    from model.motion.motion import Motion
    from model.plan.plan import GesturePlan
    from renderer.body.body import Body, BodyMotion

Background = Literal["studio", "transparent"]
MAX_STILLS = 64
MARKERS_ENDING = ".markers.csv"
"""Of the table beside a BVH file."""
SHEET_POSES = 8
"""Poses on a sheet where nothing else is asked for."""
ENDINGS = (".mp4", ".png", ".glb", ".bvh", ".blender.npz", ".obj", ".ply")


@dataclass(frozen=True)
class RenderRequest:
    """What is to be drawn of one motion file."""

    motion: Positional[Path]
    """In BEAT2's form, or any that is read."""
    out: Path
    """File whose ending says what is made: .mp4, .png, .glb, .bvh, .blender.npz, .obj, .ply."""
    speech: File = None
    """Sound of the video."""
    told: Assumed = field(default_factory=Told)
    body: File = None
    """Licensed SMPLX_NEUTRAL*.npz; by default $SMPLX_MODEL, else the open body."""
    look: Look = LOOKS[0]
    """Build and tone of the open body."""
    views: Views = ("front",)
    """The first one's files are called as --out; the others' have the view in their name."""
    close_ups: CloseUps = ()
    """Face or hands beside the body, in the videos and pictures of the first view."""
    framing: Framing = "whole"
    """The whole body, or from the knees up and larger."""
    display: Display = field(default_factory=Display)
    """What pictures show beyond the body as it moves."""
    joint: str = "right_middle"
    """Fingertip or joint that a trail follows."""
    size: Height = 720
    """Width and height of the body's picture."""
    is_draft: Annotated[bool, arg(name="draft")] = False
    """Faster, with jagged edges."""
    num_stills: Annotated[int | None, written(int, "N", "none"), arg(name="stills")] = None
    """So many single pictures as .png, evenly spread over the motion."""
    sheet_every: Annotated[int | None, written(int, "N", "none"), arg(name="sheet")] = None
    """One picture with every so-many-th frame above its time, as .png."""
    frame: int = 0
    """Which a .obj or .ply holds, counted from 0."""
    background: Background = "studio"
    """transparent: the body alone, in a .png."""
    plan: File = None
    """Whose events .glb, .bvh (in a .markers.csv beside it) and .blender.npz carry as markers; by
    default the .plan.json that a run has left beside the motion, if there is one."""

    @property
    def ending(self) -> str:
        """Raises `RunError` if it is not one of `ENDINGS`."""
        name = self.out.name.lower()
        for ending in ENDINGS:
            if name.endswith(ending) and name != ending:
                return ending
        raise RunError(f"{self.out.name} must end in one of {', '.join(ENDINGS)}.")


def render_motion(
    request: RenderRequest,
    on_event: OnEvent = lambda event: None,
    should_cancel: ShouldCancel = lambda: False,
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Make what is asked for.

    Returns:
        The files written, and what a person should know of them.

    Raises:
        CancelledRun: when ``should_cancel`` said so.
        RunError: if what is asked for cannot be.
        MotionError, BodyError, GLError, VideoError: each with one sentence.
    """
    from model.formats.read import read_any_motion

    _check(request)
    request.told.check([request.motion])
    reading = read_any_motion(request.motion, request.told, request.body)
    read = reading.motion
    motion = body_motion(read)
    body = get_body(request.body, request.look)
    if request.ending in (".mp4", ".png"):
        files = _draw(request, read, body, share_teller("video", on_event, should_cancel))
    else:
        files = _export(request, body, motion)
    apart = () if request.speech is None else _apart(request.speech, read)
    return files, (*reading.notes, *apart, *body.notes(motion))


def write_plan(request: RenderRequest, *_: object) -> None:
    """A plan in one of the forms that other programs read, of what a page shows of it."""
    from model.plan.files import markers_csv, write_plan_file
    from model.plan.plan import read_plan

    told = json.loads(request.motion.read_text(encoding="utf-8"))
    told.pop("origin", None)
    bare = request.out.with_name(f".{request.out.name}.bare")
    bare.write_text(json.dumps(told), encoding="utf-8")
    plan = read_plan(bare)
    if request.out.name.endswith(MARKERS_ENDING):
        request.out.write_text(markers_csv(plan), encoding="utf-8")
    else:
        write_plan_file(plan, request.out)


def _apart(speech: Path, motion: Motion) -> list[str]:
    from model.speech.audio import load_speech

    return lengths_apart(load_speech(speech).duration_s, {"the motion": motion.duration_s})


def _check(request: RenderRequest) -> None:
    has_pictures = request.ending in (".mp4", ".png")
    check_size(request.size)
    check_display(request.display)
    if not has_pictures and not request.display.is_plain:
        raise RunError(
            f"A {request.ending} file holds the motion as it is; trails, colours and exaggeration "
            "are for a .png or .mp4."
        )
    if not request.out.parent.is_dir():
        raise RunError(f"The folder {request.out.parent} does not exist; create it first.")
    if request.num_stills is not None and not 1 <= request.num_stills <= MAX_STILLS:
        raise RunError(f"Stills must be 1 to {MAX_STILLS}; got {request.num_stills}.")
    if request.sheet_every is not None and request.sheet_every < 1:
        raise RunError(f"A sheet shows every frame or fewer; got one in {request.sheet_every}.")
    if not has_pictures and (request.num_stills or request.sheet_every):
        raise RunError(
            f"A {request.ending} file holds no pictures; write stills to a .png or .mp4."
        )
    if request.background == "transparent" and request.ending != ".png":
        raise RunError(
            f"A {request.ending} file cannot have a transparent background; write a .png."
        )
    if request.background == "transparent" and not request.display.is_plain:
        raise RunError("Trails, colours and exaggeration are shown in the studio only.")
    if request.background == "transparent" and request.close_ups:
        raise RunError("Close-ups are shown in the studio only; leave the background out.")
    if request.speech is not None and not request.speech.is_file():
        raise RunError(f"There is no speech file at {request.speech}.")


def _export(request: RenderRequest, body: Body, motion: BodyMotion) -> tuple[Path, ...]:
    from model.plan.files import markers_csv, markers_of
    from model.storage.files import written_atomically
    from renderer.files.exports import write_blender, write_bvh, write_still
    from renderer.files.glb import write_glb

    plan = _plan(request)
    markers = [] if plan is None else [(one.time_s, one.name) for one in markers_of(plan)]
    match request.ending:
        case ".glb":
            write_glb(body, motion, request.out, markers=markers)
        case ".obj" | ".ply":
            if not 0 <= request.frame < motion.num_frames:
                raise RunError(
                    f"Frame {request.frame} was asked for; the motion has {motion.num_frames}, "
                    "counted from 0."
                )
            write_still(body, motion, request.frame, request.out)
        case ".bvh":
            write_bvh(body, motion, request.out)
            if plan is not None:  # the format has no place for them
                beside = request.out.with_suffix(MARKERS_ENDING)
                with written_atomically(beside) as part:
                    part.write_text(markers_csv(plan), encoding="utf-8")
                return (request.out, beside)
        case _:
            write_blender(motion, request.out, markers)
    return (request.out,)


def _plan(request: RenderRequest) -> GesturePlan | None:
    """
    Raises:
        PlanError: if the plan that is named cannot be used.
    """
    from model.plan.files import read_plan_file

    beside = request.motion.with_suffix(".plan.json")
    path = request.plan or (beside if beside.is_file() else None)
    return None if path is None else read_plan_file(path).plan


def _draw(
    request: RenderRequest, read: Motion, body: Body, on_progress: Callable[[float], None]
) -> tuple[Path, ...]:
    options = VideoOptions(
        *(request.display, request.size, request.framing, request.close_ups, request.views),
        look=request.look,
        is_draft=request.is_draft,
        is_transparent=request.background == "transparent",
    )
    stills, sheet = _chosen_frames(request, read.num_frames)

    def named(view: View) -> Path:
        is_first = view == request.views[0]
        return request.out if is_first else request.out.with_suffix(f".{view}{request.out.suffix}")

    jobs = jobs_of(
        *({"": read}, options, body, request.body),
        choose_tip_source(body, request.body, request.joint),
        lambda _, view: named(view) if request.ending == ".mp4" else None,
        *(request.speech, (*stills, *sheet)),
    )
    files: list[Path] = []
    for (_, view), pictures in draw_videos(jobs, on_progress, parallel=1).items():
        files += [named(view)] if request.ending == ".mp4" else []
        files += _write_stills(named(view), pictures[: len(stills)], has_sheet=bool(sheet))
        files += _write_sheet(named(view), pictures[len(stills) :], sheet)
    return tuple(files)


def _chosen_frames(
    request: RenderRequest, num_frames: int
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Frames of the single stills, and of the sheet."""
    import numpy as np

    count = min(request.num_stills or 0, num_frames)
    # The middle of equal parts, so that one still shows the middle of the motion.
    stills = ((np.arange(count) + 0.5) * num_frames / max(count, 1)).astype(int)
    every = request.sheet_every
    if every is None and request.ending == ".png" and not count:
        every = -(-num_frames // SHEET_POSES)
    sheet = range(0, num_frames, every) if every else ()
    if len(sheet) > MAX_STILLS:
        raise RunError(
            f"One in {every} of {num_frames} frames are {len(sheet)} pictures; a sheet "
            f"holds {MAX_STILLS} at most; use --sheet {-(-num_frames // MAX_STILLS)} or more."
        )
    return tuple(stills.tolist()), tuple(sheet)


def _write_stills(out: Path, pictures: np.ndarray, *, has_sheet: bool) -> list[Path]:
    """Numbered from 1 on; a .png of nothing but one still has the very name asked for."""
    from PIL import Image

    if len(pictures) == 1 and out.suffix.lower() == ".png" and not has_sheet:
        paths = [out]
    else:
        paths = [out.with_suffix(f".{number}.png") for number in range(1, len(pictures) + 1)]
    for path, picture in zip(paths, pictures, strict=True):
        _save(Image.fromarray(picture), path)
    return paths


def _write_sheet(out: Path, pictures: np.ndarray, frames: tuple[int, ...]) -> list[Path]:
    from renderer.video.compose import contact_sheet

    if not frames:
        return []
    path = out if out.suffix.lower() == ".png" else out.with_suffix(".sheet.png")
    _save(contact_sheet(pictures, frames), path)
    return [path]


def _save(image, path: Path) -> None:
    from model.storage.files import written_atomically

    with written_atomically(path) as partial:
        image.save(partial, format="PNG")
