"""One motion file to videos, pictures or a file for 3D software."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import arg

from app.errors import RunError
from app.flags import File, written
from app.run.ask import Ask, CloseUps, Height, OnEvent, ShouldCancel
from app.run.body_motion import body_motion
from app.run.followed_point import choose_tip_source
from app.run.models import get_body
from app.run.output.telling import Reporter
from app.run.videos.videos import draw_videos, jobs_of
from conventions.views import Framing, View
from model.formats.read import lengths_apart

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


@dataclass(frozen=True, kw_only=True)
class RenderAsk(Ask):
    """What is to be drawn of one motion file, the only one of its motions; ``out`` is a file whose
    ending says what is made: .mp4, .png, .glb, .bvh, .blender.npz, .obj, .ply."""

    out: Path
    """File whose ending says what is made: .mp4, .png, .glb, .bvh, .blender.npz, .obj, .ply."""
    speech: File = None
    """Sound of the video."""
    close_ups: CloseUps = ()
    """Face or hands beside the body, in the videos and pictures of the first view, whose files are
    called as --out; the others' have the view in their name."""
    framing: Framing = "whole"
    """The whole body, or from the knees up and larger."""
    size: Height = 720
    """Width and height of the body's picture."""
    plan: File = None
    """Whose events .glb, .bvh (in a .markers.csv beside it) and .blender.npz carry as markers; by
    default the .plan.json that a run has left beside the motion, if there is one."""
    num_stills: Annotated[int | None, written(int, "N", "none"), arg(name="stills")] = None
    """So many single pictures as .png, evenly spread over the motion."""
    sheet_every: Annotated[int | None, written(int, "N", "none"), arg(name="sheet")] = None
    """One picture with every so-many-th frame above its time, as .png."""
    frame: int = 0
    """Which a .obj or .ply holds, counted from 0."""
    background: Background = "studio"
    """transparent: the body alone, in a .png."""

    @property
    def ending(self) -> str:
        """Raises `RunError` if it is not one of `ENDINGS`."""
        name = self.out.name.lower()
        for ending in ENDINGS:
            if name.endswith(ending) and name != ending:
                return ending
        raise RunError(f"{self.out.name} must end in one of {', '.join(ENDINGS)}.")

    @property
    def is_picture(self) -> bool:
        return self.ending in (".mp4", ".png")

    def check(self) -> None:
        """
        Raises:
            RunError: for what cannot be drawn.
        """
        super().check()
        if len(self.motions) != 1:
            raise RunError(f"One motion is drawn; got {len(self.motions)}.")
        is_lone = self.background == "transparent"
        if not self.is_picture and not self.display.is_plain:
            raise RunError(
                f"A {self.ending} file holds the motion as it is; trails, colours and exaggeration "
                "are for a .png or .mp4."
            )
        if not self.out.parent.is_dir():
            raise RunError(f"The folder {self.out.parent} does not exist; create it first.")
        if self.num_stills is not None and not 1 <= self.num_stills <= MAX_STILLS:
            raise RunError(f"Stills must be 1 to {MAX_STILLS}; got {self.num_stills}.")
        if self.sheet_every is not None and self.sheet_every < 1:
            raise RunError(f"A sheet shows every frame or fewer; got one in {self.sheet_every}.")
        if not self.is_picture and (self.num_stills or self.sheet_every):
            raise RunError(
                f"A {self.ending} file holds no pictures; write stills to a .png or .mp4."
            )
        if is_lone and self.ending != ".png":
            raise RunError(
                f"A {self.ending} file cannot have a transparent background; write a .png."
            )
        if is_lone and not self.display.is_plain:
            raise RunError("Trails, colours and exaggeration are shown in the studio only.")
        if is_lone and self.close_ups:
            raise RunError("Close-ups are shown in the studio only; leave the background out.")
        if self.speech is not None and not self.speech.is_file():
            raise RunError(f"There is no speech file at {self.speech}.")


def render_motion(
    ask: RenderAsk,
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

    ask.check()
    ask.told.check(ask.motions)
    reading = read_any_motion(ask.motions[0], ask.told, ask.body)
    read = reading.motion
    motion = body_motion(read)
    body = get_body(ask.body, ask.look)
    if ask.is_picture:
        files = _draw(ask, read, body, Reporter(on_event, should_cancel).share("video"))
    else:
        files = _export(ask, body, motion)
    apart = () if ask.speech is None else _apart(ask.speech, read)
    return files, (*reading.notes, *apart, *body.notes(motion))


def write_plan(ask: RenderAsk, *_: object) -> None:
    """A plan in one of the forms that other programs read, of what a page shows of it."""
    from model.plan.files import markers_csv, write_plan_file
    from model.plan.plan import read_plan

    plan = read_plan(ask.motions[0])
    if ask.out.name.endswith(MARKERS_ENDING):
        ask.out.write_text(markers_csv(plan), encoding="utf-8")
    else:
        write_plan_file(plan, ask.out)


def _apart(speech: Path, motion: Motion) -> list[str]:
    from model.speech.audio import load_speech

    return lengths_apart(load_speech(speech).duration_s, {"the motion": motion.duration_s})


def _export(ask: RenderAsk, body: Body, motion: BodyMotion) -> tuple[Path, ...]:
    from model.plan.files import markers_csv, markers_of
    from model.storage.files import written_atomically
    from renderer.files.exports import write_blender, write_bvh, write_still
    from renderer.files.glb import glb_bytes

    plan = _plan(ask)
    markers = [] if plan is None else [(one.time_s, one.name) for one in markers_of(plan)]
    files = [ask.out]
    with written_atomically(ask.out) as part:
        match ask.ending:
            case ".glb":
                part.write_bytes(glb_bytes(body, motion, markers=markers))
            case ".obj" | ".ply":
                if not 0 <= ask.frame < motion.num_frames:
                    raise RunError(
                        f"Frame {ask.frame} was asked for; the motion has {motion.num_frames}, "
                        "counted from 0."
                    )
                write_still(body, motion, ask.frame, part)
            case ".bvh":
                write_bvh(body, motion, part)
                if plan is not None:  # the format has no place for them
                    files.append(ask.out.with_suffix(MARKERS_ENDING))
                    with written_atomically(files[1]) as beside:
                        beside.write_text(markers_csv(plan), encoding="utf-8")
            case _:
                write_blender(motion, part, markers)
    return tuple(files)


def _plan(ask: RenderAsk) -> GesturePlan | None:
    """
    Raises:
        PlanError: if the plan that is named cannot be used.
    """
    from model.plan.files import read_plan_file

    beside = ask.motions[0].with_suffix(".plan.json")
    path = ask.plan or (beside if beside.is_file() else None)
    return None if path is None else read_plan_file(path).plan


def _draw(
    ask: RenderAsk, read: Motion, body: Body, on_progress: Callable[[float], None]
) -> tuple[Path, ...]:
    stills, sheet = _chosen_frames(ask, read.num_frames)

    def named(view: View) -> Path:
        is_first = view == ask.views[0]
        return ask.out if is_first else ask.out.with_suffix(f".{view}{ask.out.suffix}")

    jobs = jobs_of(
        *({"": read}, ask, body, choose_tip_source(body, ask.body, ask.joint)),
        lambda _, view: named(view) if ask.ending == ".mp4" else None,
        *(ask.speech, (*stills, *sheet)),
        is_transparent=ask.background == "transparent",
    )
    files: list[Path] = []
    for (_, view), pictures in draw_videos(jobs, on_progress, parallel=1).items():
        files += [named(view)] if ask.ending == ".mp4" else []
        files += _write_stills(named(view), pictures[: len(stills)], has_sheet=bool(sheet))
        files += _write_sheet(named(view), pictures[len(stills) :], sheet)
    return tuple(files)


def _chosen_frames(ask: RenderAsk, num_frames: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Frames of the single stills, and of the sheet."""
    import numpy as np

    count = min(ask.num_stills or 0, num_frames)
    # The middle of equal parts, so that one still shows the middle of the motion.
    stills = ((np.arange(count) + 0.5) * num_frames / max(count, 1)).astype(int)
    every = ask.sheet_every
    if every is None and ask.ending == ".png" and not count:
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
