"""One run, for whoever asks: speech or motions in; motion, numbers, videos and figures out.

The page, the command line, the notebook and the bench all call `do`; it knows nothing of Gradio.
"""

from __future__ import annotations

import ctypes
import json
import sys
import time
from contextlib import nullcontext
from dataclasses import replace

from app import text
from app.errors import RunError
from app.findings.sentences import sentences_of
from app.run.ask import DEAF, Ask, Done, Ear
from app.run.bodies import body_motion, in_register
from app.run.diagnostics import (
    figure6_of,
    jitter_of,
    measure_motions,
    write_diagnostics,
)
from app.run.given import NO_SPEECH, as_read, given_rows
from app.run.made import made_rows
from app.run.models import nothing_draws
from app.run.output.provenance import PROVENANCE, settings_of, title_of
from app.run.output.run_folder import RunRecord, cut, read_run, told_of
from app.run.run_writer import Rows, RunWriter, writing_run
from app.run.timeline import SpokenWords, said_in
from app.run.videos.videos import Snapshots, draw_poses, draw_rows, joined_side_by_side
from conventions.names import REFERENCE_NAME, printable
from model.diagnostics import Diagnostics
from model.motion.motion import Motion
from model.storage.files import file_sha256
from renderer.figures.figure6 import choose_snapshot_frames
from renderer.figures.jitter import sheet_caption

_M_MMAP_THRESHOLD = -3  # malloc.h
_LARGE_BYTES = 1 << 20
POSES_PX = 512
"""Of poses where no video is drawn."""
_POSES = 0.6
"""Share of the time of all figures that the poses take."""
MEASURED = "Measured {motions}."
OPENED = "Opened from its file; its {motions} were measured anew."


def do(ask: Ask, ear: Ear = DEAF) -> Done:
    """Do one run and leave its files in ``ask.out``, all of them or none.

    Raises:
        Cancelled: when ``ear`` said so.
        RunError, SpeechError, MotionError, TranscriptError, BodyError, UnknownNameError,
        CheckpointError, GLError, VideoError, FigureError, WriteError: each with one sentence for
        the person who asked.
    """
    ask.check()
    _return_large_blocks()
    started = time.monotonic()
    with (
        SpokenWords(said_in(ask.opened) if ask.opened else ask.transcript, ask.words) as words,
        writing_run(ask.out, record_of(ask), ear, is_kept=ask.is_kept) as run,
    ):
        if words.need_speech and ask.speech is None:
            raise RunError(NO_SPEECH)
        return _do(_as_far_as_anything_draws(ask, run), words, run, started)


def _do(ask: Ask, words: SpokenWords, run: RunWriter, started: float) -> Done:
    run.progress("speech", 0.0)
    rows = (given_rows if ask.motions else made_rows)(ask, words, run)
    run.timeline(rows.timeline, words.given)
    for name, motion in rows.staged.items():
        run.note(*(f"{name}: {note}" for note in rows.body.notes(body_motion(motion))))
    diagnostics = _measure(rows, run)
    run.find_plans(rows.staged)
    if ask.has_video:
        _draw_videos(ask, rows, run)
    beside = nullcontext()
    if ask.has_video and rows.is_made:
        beside = joined_side_by_side(list(rows.drawn), rows.sound, run.folder, run, run.file)
    with beside:
        if ask.has_figures:
            _draw_figures(ask, rows, diagnostics, run)
    said, notes = words.found(run.stop_if_asked)
    run.note(*notes)
    if said.origin != words.given.origin:
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
    run = RunRecord(
        kind="given" if ask.motions else "generated",
        title=cut(title_of(ask, ask.systems)),
        asked={key: each for key, each in told_of(ask).items() if each is not None},
        settings={key: cut(value) for key, value in settings_of(ask).items()},
        point=ask.joint,
    )
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


def _draw_videos(ask: Ask, rows: Rows, run: RunWriter) -> None:
    """Of each motion."""
    on_share = run.share("video")
    on_share(0.0)
    placed = {name: _placed(motion, rows) for name, motion in rows.staged.items()}
    draw_rows(placed, ask, rows.body, rows.tip, on_share, run.folder, rows.sound, run.file)


def _placed(motion: Motion, rows: Rows) -> Motion:
    """Where it stands in pictures."""
    return in_register(motion) if rows.is_made else motion


def _draw_figures(ask: Ask, rows: Rows, diagnostics: Diagnostics, run: RunWriter) -> None:
    """Figure 6, of trajectories only where no pose is drawn, and the jitter sheet."""
    snapshots, on_share = _draw_poses(ask, rows, run), run.share("figure")
    on_share(_POSES)
    clip = printable(ask.speech.stem) if ask.speech is not None and not ask.motions else ""
    contents = figure6_of(rows.drawn, snapshots, rows.tip, ask, clip, run.stop_if_asked)
    run.figure("figure6", contents, contents.caption, ask.figure_forms)
    on_share((_POSES + 1) / 2)
    systems = [name for name in rows.drawn if name != REFERENCE_NAME]
    sheet, said = jitter_of(diagnostics, rows.tip, systems), sentences_of(diagnostics)
    told = f"{said['trajectory']} {said['depth']}"
    run.figure("jitter", sheet, sheet_caption(sheet, clip, told), ask.figure_forms)
    run.progress("figure", 1.0)


def _draw_poses(ask: Ask, rows: Rows, run: RunWriter) -> Snapshots:
    """For Figure 6; of the frames alone where none is asked for."""
    shortest = min(motion.num_frames for motion in rows.drawn.values())
    frames = ask.figure_frames or choose_snapshot_frames(shortest, ask.start_frame)
    if not ask.has_poses or "b" not in ask.figure_panels:
        return Snapshots(frames)
    if not (ask.has_video and rows.is_made):  # else as the videos are
        ask = replace(ask, size=POSES_PX, views=("front",))
    placed = {name: _placed(motion, rows) for name, motion in rows.drawn.items()}
    on_share = run.share("figure", _POSES)
    return draw_poses(placed, ask, rows.body, on_share, frames)


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
