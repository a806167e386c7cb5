"""One run, for whoever asks: speech or motions in; motion, numbers, videos and figures out.

The page, the command line, the notebook and the bench all call `do`; it knows nothing of Gradio.
"""

from __future__ import annotations

import ctypes
import json
import sys
import time
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import replace

from app import text
from app.errors import RunError
from app.findings.sentences import sentences_of
from app.run.ask import Ask, Done, OnEvent, ShouldCancel
from app.run.body_motion import body_motion, in_register
from app.run.diagnostics import (
    figure6_of,
    jitter_of,
    measure_motions,
    write_diagnostics,
)
from app.run.given import NO_SPEECH, as_read, given_rows
from app.run.made import made_rows
from app.run.models import nothing_draws
from app.run.output.provenance import PROVENANCE
from app.run.output.result_folder import ResultFolder
from app.run.output.run_folder import RunRecord, begun, read_run
from app.run.run_writer import Rows, RunWriter
from app.run.settings import settings_of, title_of
from app.run.timeline import said_in
from app.run.videos.videos import Snapshots, draw_rows, joined_side_by_side
from app.run.words import SpokenWords, given_words
from conventions.names import REFERENCE_NAME, printable
from model.diagnostics import Diagnostics
from model.motion.motion import Motion
from model.storage.files import file_sha256
from renderer.figures.figure6 import choose_snapshot_frames, draw_figure6
from renderer.figures.jitter import draw_sheet, sheet_caption

_M_MMAP_THRESHOLD = -3  # malloc.h
_LARGE_BYTES = 1 << 20
POSES_PX = 512
"""Of poses where no video is drawn."""
_POSES = 0.6
"""Share of the time of all figures that the poses take where no video is drawn."""
MEASURED = "Measured {motions}."
OPENED = "Opened from its file; its {motions} were measured anew."


def do(
    ask: Ask,
    on_event: OnEvent = lambda event: None,
    should_cancel: ShouldCancel = lambda: False,
) -> Done:
    """Do one run and leave its files in ``ask.out``, all of them or none.

    Args:
        on_event: told of progress, and when the folder holds more.
        should_cancel: asked many times a second.

    Raises:
        Cancelled: when ``should_cancel`` said so.
        RunError, SpeechError, MotionError, TranscriptError, BodyError, UnknownNameError,
        CheckpointError, GLError, VideoError, FigureError, WriteError: each with one sentence for
        the person who asked.
    """
    ask.check()
    _return_large_blocks()
    started = time.monotonic()
    with (
        SpokenWords(ask.transcript, ask.words) as words,
        ResultFolder(ask.out, is_kept=ask.is_kept) as folder,
        RunWriter(folder, record_of(ask), on_event, should_cancel) as run,
    ):
        if words.need_speech and ask.speech is None:
            raise RunError(NO_SPEECH)
        return _do(_as_far_as_anything_draws(ask, run), words, run, started)


def _do(ask: Ask, words: SpokenWords, run: RunWriter, started: float) -> Done:
    run.progress("speech", 0.0)
    rows = (given_rows if ask.motions else made_rows)(ask, words, run)
    said = given_words(ask.transcript) if ask.opened is None else said_in(ask.opened)
    run.timeline(rows.timeline, said)
    for name, motion in rows.staged.items():
        run.note(*(f"{name}: {note}" for note in rows.body.notes(body_motion(motion))))
    diagnostics = _measure(rows, run)
    run.find_plans(rows.staged)
    snapshots = _draw_videos(ask, rows, run) if ask.has_video else None
    beside = nullcontext()
    if ask.has_video and rows.is_made:
        beside = joined_side_by_side(list(rows.drawn), rows.sound, run.folder, run, run.file)
    with beside:
        if ask.has_figures:
            _draw_figures(ask, rows, snapshots, diagnostics, run)
    if ask.opened is None:
        given = said
        said, notes = words.found(run.stop_if_asked)
        run.note(*notes)
        if said.origin != given.origin:
            run.timeline(rows.timeline, said)
    run.file(*write_diagnostics(diagnostics, run.folder, said))
    if rows.is_made:
        path = run.folder.path(PROVENANCE)
        words_of = {"origin": said.origin, "count": len(said.words)} if said.words else None
        speech = {**rows.origin["speech"], "words": words_of}
        record = {**rows.origin, "speech": speech, "notes": run.notes}
        path.write_text(json.dumps(record, indent=1) + "\n")
        run.file(path)
    num_frames = max(motion.num_frames for motion in rows.staged.values())
    run.finish(_line(ask, len(rows.measured), num_frames, time.monotonic() - started))
    return Done(ask.out, diagnostics, tuple(run.notes), said)


def record_of(ask: Ask) -> RunRecord:
    """What is known of a run before anything is read."""
    kind = "given" if ask.motions else "generated"
    run = begun(ask, kind, title_of(ask, ask.systems), settings_of(ask))
    if ask.opened is not None:
        before = read_run(ask.opened)
        known = ("title", "settings", "speech_sha256")
        return run.model_copy(update={key: getattr(before, key) for key in known})
    if ask.motions and ask.speech is not None and ask.speech.is_file():
        run.speech_sha256 = file_sha256(ask.speech)
    return run


def _as_far_as_anything_draws(ask: Ask, run: RunWriter) -> Ask:
    """Motion, numbers and trajectories need no OpenGL."""
    if not (ask.has_video or (ask.has_poses and ask.has_figures)):
        return ask
    missing = nothing_draws()
    run.note(*filter(None, [missing]))
    return replace(ask, has_video=False, has_poses=False) if missing else ask


def _measure(rows: Rows, run: RunWriter) -> Diagnostics:
    """All numbers."""
    on_share = run.share("numbers")
    on_share(0.0)
    diagnostics = measure_motions(
        *(rows.measured, rows.tip, rows.onsets_s, on_share, rows.windows),
        heard=rows.heard,
        mean_speeds=rows.mean_speeds,
    )
    if rows.readings:
        diagnostics = as_read(diagnostics, rows)
    run.note(*diagnostics.notes)
    run.progress("numbers", 1.0)
    run.measured(diagnostics)
    return diagnostics


def _draw_videos(ask: Ask, rows: Rows, run: RunWriter) -> Snapshots | None:
    """Of each motion; with poses for Figure 6 where they were made here."""
    is_made = rows.is_made
    placed = {name: in_register(each) if is_made else each for name, each in rows.staged.items()}
    on_share = run.share("video")
    on_share(0.0)
    snapshots = draw_rows(
        *(placed, ask, rows.body, rows.tip, on_share),
        folder=run.folder,
        speech=rows.sound,
        frames=_pose_frames(ask, placed) if is_made else (),
        on_file=run.file,
    )
    return snapshots if is_made else None


def _draw_figures(
    ask: Ask,
    rows: Rows,
    snapshots: Snapshots | None,
    diagnostics: Diagnostics,
    run: RunWriter,
) -> None:
    """Figure 6, of trajectories only where no pose was drawn, and the jitter sheet."""
    begun = 0.0 if snapshots is not None else _POSES
    if snapshots is None:
        snapshots = _draw_poses(ask, rows, run)
    on_share = run.share("figure")
    on_share(begun)
    clip = printable(ask.speech.stem) if ask.speech is not None and not ask.motions else ""
    contents = figure6_of(rows.drawn, snapshots, rows.tip, ask, clip, run.stop_if_asked)
    run.figure("figure6", lambda: draw_figure6(contents), contents.caption)
    on_share((begun + 1) / 2)
    systems = [name for name in rows.drawn if name != REFERENCE_NAME]
    sheet, said = jitter_of(diagnostics, rows.tip, systems), sentences_of(diagnostics)
    told = f"{said['trajectory']} {said['depth']}"
    run.figure("jitter", lambda: draw_sheet(sheet), sheet_caption(sheet, clip, told))
    run.progress("figure", 1.0)


def _draw_poses(ask: Ask, rows: Rows, run: RunWriter) -> Snapshots:
    """For Figure 6, without any video."""
    frames = _pose_frames(ask, rows.drawn)
    if not ask.has_poses or "b" not in ask.figure.panels:
        return Snapshots(frames)
    is_made = rows.is_made
    placed = {name: in_register(each) if is_made else each for name, each in rows.drawn.items()}
    asked = replace(ask, size=POSES_PX, views=("front",))
    on_share = run.share("figure", _POSES)
    return draw_rows(placed, asked, rows.body, rows.tip, on_share, frames=frames)


def _pose_frames(ask: Ask, motions: Mapping[str, Motion]) -> tuple[int, ...]:
    shortest = min(motion.num_frames for motion in motions.values())
    return ask.figure.frames or choose_snapshot_frames(shortest, ask.start_frame)


def _line(ask: Ask, num_rows: int, num_frames: int, seconds: float) -> str:
    """How it went."""
    if ask.motions:
        count = num_rows - (ask.reference is not None)
        motions = f"{count} motion{'s' if count > 1 else ''}"
        return (MEASURED if ask.opened is None else OPENED).format(motions=motions)
    rows = f"{num_rows} {'motion' if num_rows == 1 else 'motions'}"
    line = text.DONE.format(seconds=seconds, rows=rows, frames=num_frames)
    return f"{line} {ask.take.why_less}".rstrip() if ask.take else line


def _return_large_blocks() -> None:
    """Make glibc map each block of a megabyte and more by itself, and return it when it is freed.

    By default it raises that limit to 32 MB as a program goes on, and what a long clip needs for a
    moment then stays in the heap: the peak of a ten-minute clip grows by a tenth. Elsewhere than on
    glibc this does nothing.
    """
    if not sys.platform.startswith("linux"):
        return
    try:
        ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)
    except (OSError, AttributeError):  # another C library
        return
