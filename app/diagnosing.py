"""Anyone's BEAT2-format motion files: the same numbers and the same figure as for our systems."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from app.errors import RunError
from app.loaded import get_body
from app.numbers import write_diagnostics
from app.outputs import ResultFolder
from app.rendering import body_motion
from app.request import MAX_COMPARED, REFERENCE_NAME
from app.tips import TIP_TITLE, choose_tip_source

if TYPE_CHECKING:
    from model.motion import Motion

STILL_SIZE_PX = 512


def diagnose_files(
    paths: Sequence[Path],
    out: Path,
    *,
    reference_path: Path | None = None,
    body_path: Path | None = None,
    has_pictures: bool = True,
    on_progress: Callable[[float], None] = lambda fraction: None,
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Write diagnostics.json, diagnostics.csv and figure6 for the motions in ``paths``.

    Returns:
        The files written, and what a person should know of them.

    Raises:
        RunError, MotionError, BodyError, GLError: each with one sentence.
    """
    from model.diagnostics import diagnose
    from model.motion import load_motion
    from model.skeleton import open_body_skeleton

    motions = {
        name: load_motion(path) for name, path in zip(unique_names(paths), paths, strict=True)
    }
    reference = load_motion(reference_path) if reference_path else None
    body = get_body(body_path)
    tip = choose_tip_source(body, body_path)
    on_progress(0.1)
    with ResultFolder(out) as folder:
        diagnostics = diagnose(
            motions,
            open_body_skeleton(),
            reference=reference,
            tip_track=None if body_path is None else tip.track,
            tip_source=tip.name,
        )
        on_progress(0.4)
        write_diagnostics(
            diagnostics, folder.path("diagnostics.json"), folder.path("diagnostics.csv")
        )
        shown = dict(list(motions.items())[: MAX_COMPARED - (reference is not None)])
        if reference is not None:
            shown[REFERENCE_NAME] = reference
        _draw_figure(shown, folder, tip.track, tip.name, body_path, has_pictures)
        on_progress(1.0)
        notes = list(diagnostics["notes"])
        for motion in shown.values():
            notes += [n for n in body.notes(body_motion(motion)) if n not in notes]
        if len(shown) < len(motions):
            notes.append(f"The figure shows the first {MAX_COMPARED} motions.")
        return folder.publish(), tuple(notes)


def unique_names(paths: Sequence[Path]) -> list[str]:
    """The stem of each file, with its folder where two files have the same stem.

    Raises:
        RunError: if two files cannot be told apart even so.
    """
    stems = [path.stem for path in paths]
    names = [
        f"{path.resolve().parent.name}/{path.stem}" if stems.count(path.stem) > 1 else path.stem
        for path in paths
    ]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise RunError(f"Two of the files would be called {twice!r}; rename one of them.")
    if REFERENCE_NAME in names:
        raise RunError(f"A motion may not be called {REFERENCE_NAME!r}; rename the file.")
    return names


def _draw_figure(
    motions: dict[str, Motion],
    folder: ResultFolder,
    track: Callable,
    tip_source: str,
    body_path: Path | None,
    has_pictures: bool,
) -> None:
    from renderer.figures import choose_snapshot_frames, figure6
    from renderer.render import RenderSettings
    from renderer.stage import set_stage
    from renderer.worker import RenderJob, run_job

    frames = choose_snapshot_frames(min(motion.num_frames for motion in motions.values()))
    snapshots = {}
    if has_pictures:
        posed = {name: body_motion(motion) for name, motion in motions.items()}
        settings = RenderSettings(width=STILL_SIZE_PX, height=STILL_SIZE_PX)
        stage = set_stage(get_body(body_path), list(posed.values()))
        for name, motion in posed.items():
            job = RenderJob(
                motion, settings=settings, body_path=body_path, stage=stage, still_frames=frames
            )
            snapshots[name] = run_job(job).stills
    files = figure6(
        {name: track(motion) for name, motion in motions.items()},
        snapshots,
        frames,
        30.0,
        folder.path("figure6.png").with_suffix(""),
        reference=REFERENCE_NAME if REFERENCE_NAME in motions else None,
        point=TIP_TITLE,
        tip_source=tip_source,
        caveat="",
    )
    for path in files:
        folder.path(path.name)
