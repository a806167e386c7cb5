"""Rendering of one motion file to a video or stills, and its export for 3D software."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from app.errors import RunError
from app.run.bodies import body_motion, make_point_tracker
from app.run.callbacks import NO_CALLBACKS, RunCallbacks
from app.run.models import get_body
from app.run.requests.requests import MARKERS_SUFFIX, MAX_STILLS, SHEET_POSES, RenderRequest
from app.run.videos.videos import draw_videos
from conventions.views import View
from model.formats.read import read_any_motion
from model.formats.reading import ImportedMotion, length_notes
from model.motion.flame import flame_to_arkit, read_flame_matrix
from model.motion.motion import Motion
from model.plan.files import markers_csv, plan_markers, read_plan_file, write_plan_file
from model.plan.plan import GesturePlan
from model.speech.audio import load_speech
from model.storage.files import write_atomically, written_atomically
from renderer.body.body import Body, BodyMotion
from renderer.files import exports
from renderer.files.character_glb import character_glb_bytes
from renderer.files.vrma import vrma_bytes
from renderer.video.compose import contact_sheet
from renderer.video.workers import run_render_jobs


def render_or_export_motion(
    request: RenderRequest, callbacks: RunCallbacks = NO_CALLBACKS
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Render or export a motion file.

    Raises Cancelled, RunError if the request cannot be done, and MotionError, BodyError, GLError,
    VideoError, each with one sentence.
    """
    request.check()
    request.import_overrides.check_files_exist([request.motion])
    reading = read_any_motion(request.motion, request.import_overrides, request.video.body)
    read = reading.motion
    if request.flame_to_arkit_matrix is not None:
        read = flame_to_arkit(read, read_flame_matrix(request.flame_to_arkit_matrix))
    motion = body_motion(read)
    body = get_body(request.video.body, request.video.look)
    if request.is_video_or_picture:
        files = _draw(request, read, body, callbacks.progress_callback("video"))
    else:
        files = _export(request, body, motion)
    apart = () if request.speech is None else _length_notes(request.speech, reading)
    # Blender uses its own body
    own = (*body.remarks, *body.unsupported_notes(motion))
    if request.suffix == ".blender.npz":
        own = exports.blender_unsupported_notes(motion)
    return files, (*reading.notes, *apart, *own)


def convert_plan(request: RenderRequest, *_: object) -> None:
    """Convert a gesture plan, the request's ``motion``, to the format of the output file."""
    plan = read_plan_file(request.motion).plan
    if request.out.name.endswith(MARKERS_SUFFIX):
        request.out.write_text(markers_csv(plan), encoding="utf-8")
    else:
        write_plan_file(plan, request.out)


def _length_notes(speech: Path, reading: ImportedMotion) -> list[str]:
    length_s, name = load_speech(speech).duration_s, "the motion"
    return length_notes(length_s, {name: reading.motion.duration_s}, {name: reading.source_fps})


def _export(request: RenderRequest, body: Body, motion: BodyMotion) -> tuple[Path, ...]:
    plan = _plan(request)
    markers = [] if plan is None else plan_markers(plan)
    files = [request.out]
    with written_atomically(request.out) as part:
        match request.suffix:
            case ".glb":
                part.write_bytes(character_glb_bytes(body, motion, markers))
            case ".vrma":
                part.write_bytes(vrma_bytes(body, motion, markers))
            case ".obj" | ".ply":
                frame = request.stills.mesh_frame
                if not 0 <= frame < motion.num_frames:
                    raise RunError(
                        f"There is no frame {frame}: the motion has {motion.num_frames} frames, "
                        "counted from 0."
                    )
                exports.write_posed_mesh(body, motion, frame, part)
            case ".bvh":
                exports.write_bvh(body, motion, part)
                if plan is not None:  # BVH cannot store markers
                    files.append(request.out.with_suffix(MARKERS_SUFFIX))
                    write_atomically(files[1], markers_csv(plan))
            case _:
                exports.write_blender_npz(motion, part, markers)
    return tuple(files)


def _plan(request: RenderRequest) -> GesturePlan | None:
    """Read the plan named in the request or next to the motion; raises PlanError."""
    beside = request.motion.with_suffix(".plan.json")
    path = request.plan or (beside if beside.is_file() else None)
    return None if path is None else read_plan_file(path).plan


def _draw(
    request: RenderRequest, read: Motion, body: Body, on_progress: Callable[[float], None]
) -> tuple[Path, ...]:
    stills, sheet = _chosen_frames(request, read.num_frames)

    def named(view: View) -> Path:
        is_first = view == request.video.views[0]
        return request.out if is_first else request.out.with_suffix(f".{view}{request.out.suffix}")

    pictures_of = draw_videos(
        {"": read},
        request.video,
        body,
        make_point_tracker(request.video.body, request.tracked_point),
        lambda _, view: named(view) if request.suffix == ".mp4" else None,
        on_progress,
        speech=request.speech,
        frames=(*stills, *sheet),
        draw=partial(run_render_jobs, num_parallel=1),
        is_transparent=request.stills.background == "transparent",
    )
    files: list[Path] = []
    for (_, view), pictures in pictures_of.items():
        files += [named(view)] if request.suffix == ".mp4" else []
        files += _write_stills(named(view), pictures[: len(stills)], has_sheet=bool(sheet))
        files += _write_sheet(named(view), pictures[len(stills) :], sheet)
    return tuple(files)


def _chosen_frames(
    request: RenderRequest, num_frames: int
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the frames of the stills, and those of the contact sheet."""
    count = min(request.stills.num_stills or 0, num_frames)
    # The middle of equal parts, so that one still shows the middle of the motion.
    stills = ((np.arange(count) + 0.5) * num_frames / max(count, 1)).astype(int)
    every = request.stills.contact_sheet_interval
    if every is None and request.suffix == ".png" and not count:
        every = -(-num_frames // SHEET_POSES)
    sheet = range(0, num_frames, every) if every else ()
    if len(sheet) > MAX_STILLS:
        raise RunError(
            f"One picture every {every} frames gives {len(sheet)} pictures for {num_frames} "
            f"frames; a contact sheet can have at most {MAX_STILLS}. Use --contact-sheet-every "
            f"{-(-num_frames // MAX_STILLS)} or more."
        )
    return tuple(stills.tolist()), tuple(sheet)


def _write_stills(
    out: Path, pictures: UInt8[np.ndarray, "N H W C"], *, has_sheet: bool
) -> list[Path]:
    """Write stills numbered from 1; a single one without a sheet gets the output file's name."""
    if len(pictures) == 1 and out.suffix.lower() == ".png" and not has_sheet:
        paths = [out]
    else:
        paths = [out.with_suffix(f".{number}.png") for number in range(1, len(pictures) + 1)]
    for path, picture in zip(paths, pictures, strict=True):
        _save(Image.fromarray(picture), path)
    return paths


def _write_sheet(
    out: Path, pictures: UInt8[np.ndarray, "N H W C"], frames: tuple[int, ...]
) -> list[Path]:
    if not frames:
        return []
    path = out if out.suffix.lower() == ".png" else out.with_suffix(".sheet.png")
    _save(contact_sheet(pictures, frames), path)
    return [path]


def _save(image, path: Path) -> None:
    with written_atomically(path) as partial:
        image.save(partial, format="PNG")
