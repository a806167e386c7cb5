"""Speech in; motion, numbers, videos and Figure 6 out. The page, the command line and the
benchmark all call `generate_all`; it knows nothing of Gradio."""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from app.errors import CancelledRun, RunError
from app.loaded import get_body, get_system
from app.numbers import write_diagnostics
from app.outputs import ResultFolder, require_free_space
from app.provenance import make_provenance
from app.rendering import body_motion, render_settings
from app.request import (
    MAX_COMPARED,
    MAX_SAMPLES,
    POST_FILTERS,
    REFERENCE_NAME,
    SAMPLERS,
    VIEWS,
    Artefact,
    ArtefactKind,
    GenerateRequest,
    GenerateResult,
    OnEvent,
    Progress,
    Sampler,
    ShouldCancel,
    Stage,
    file_stem,
    sample_name,
)
from app.tips import TIP_TITLE, TipSource, choose_tip_source
from app.videos import draw_videos

if TYPE_CHECKING:
    import numpy as np

    from model.motion import Motion
    from model.speech.audio import Speech
    from model.systems import System
    from renderer.body import Body, BodyMotion

log = logging.getLogger(__name__)

DEFAULT_STEPS = 10
DEFAULT_SAMPLER: Sampler = "euler"


def generate_all(
    request: GenerateRequest,
    on_event: OnEvent = lambda event: None,
    should_cancel: ShouldCancel = lambda: False,
) -> GenerateResult:
    """Do one run and leave its files in ``request.out``, all of them or none.

    Args:
        on_event: told of progress and of every file as soon as it is whole.
        should_cancel: asked many times a second.

    Raises:
        CancelledRun: when ``should_cancel`` said so.
        RunError, SpeechError, MotionError, BodyError, UnknownNameError, GLError, VideoError,
        WriteError: each with one sentence for the person who asked.
    """
    check_request(request)
    with ResultFolder(request.out) as folder:
        run = _Run(request, folder, on_event, should_cancel)
        try:
            return run.do()
        except Exception as error:
            if _is_cancellation(error):
                raise CancelledRun from error
            raise


def check_request(request: GenerateRequest) -> None:
    """Refuse what needs no model to be seen as wrong.

    Raises:
        RunError: with one sentence.
    """
    for value, allowed, what in (
        (request.post_filter, POST_FILTERS, "post-filter"),
        (request.sampler, (None, *SAMPLERS), "sampler"),
        *((view, VIEWS, "view") for view in request.views),
    ):
        if value not in allowed:
            names = ", ".join(str(name) for name in allowed if name)
            raise RunError(f"There is no {what} {value!r}; choose one of {names}.")
    if not request.views:
        raise RunError(f"No view is named; choose some of {', '.join(VIEWS)}.")
    if not 1 <= request.samples <= MAX_SAMPLES:
        raise RunError(f"Samples must be 1 to {MAX_SAMPLES}; got {request.samples}.")
    if request.steps is not None and not 1 <= request.steps <= 1000:
        raise RunError(f"Steps must be 1 to 1000; got {request.steps}.")
    if request.seed < 0:
        raise RunError(f"The seed must not be negative; got {request.seed}.")


@dataclass(frozen=True)
class _Row:
    """One motion of the comparison, as generated or as recorded."""

    name: str
    raw: Motion
    shown: Motion
    """After the post-filter, if one was asked for: what files and pictures hold."""


class _Run:
    """The steps of one run, in order, and what they hand on."""

    def __init__(
        self,
        request: GenerateRequest,
        folder: ResultFolder,
        on_event: OnEvent,
        should_cancel: ShouldCancel,
    ) -> None:
        self.request = request
        self.folder = folder
        self.on_event = on_event
        self.should_cancel = should_cancel
        self.notes: list[str] = []

    def do(self) -> GenerateResult:
        request = self.request
        speech = self._read_speech()
        body = get_body(request.body)
        systems = self._load_systems()
        speaker = request.speaker or next(iter(systems[0].speakers))
        for system in systems:
            system.speaker_index(speaker)
        reference = self._read_reference(speech)
        if request.has_video:
            render_settings(request.views[0], request.size)
        backend = _backend() if request.has_video else None
        self._require_space(speech.num_frames, len(systems))
        self._progress("speech", 1.0)

        rows = self._generate(systems, speech, speaker)
        if reference is not None:
            rows.append(_Row(REFERENCE_NAME, reference, reference))
        motions = {row.name: body_motion(row.shown) for row in rows}
        for name, motion in motions.items():
            self._note(*(f"{name}: {note}" for note in body.notes(motion)))
        tip = choose_tip_source(body, request.body)
        diagnostics = self._measure(rows, tip)
        if request.has_video:
            snapshots = self._draw(body, motions, speech)
            self._compare(list(motions))
        else:
            snapshots = {}
        self._figure(rows, snapshots, tip)
        self._write_provenance(systems, speech, speaker, body, backend)
        return GenerateResult(
            out=request.out,
            files=self.folder.publish(),
            names=tuple(motions),
            num_frames=speech.num_frames,
            diagnostics=diagnostics,
            notes=tuple(self.notes),
        )

    # Reading

    def _read_speech(self) -> Speech:
        from model.speech.audio import SpeechLimits, load_speech, write_wav

        self._progress("speech", 0.0)
        limits = SpeechLimits(max_s=self.request.max_speech_s)
        speech = load_speech(self.request.speech, limits)
        self._note(*speech.notes)
        self._wav = self.folder.scratch("speech.wav")
        write_wav(self._wav, speech.waveform)
        return speech

    def _load_systems(self) -> list[System]:
        from model.cards import list_systems

        names = self.request.systems or list_systems(self.request.weights)
        if not names:
            raise RunError(
                f"No trained systems were found in {self.request.weights}; "
                "name a folder of weights with --weights DIR."
            )
        return [get_system(name, self.request.weights) for name in dict.fromkeys(names)]

    def _read_reference(self, speech: Speech) -> Motion | None:
        if self.request.reference is None:
            return None
        from model.diagnostics import first_frames
        from model.motion import load_motion

        motion = load_motion(self.request.reference)
        if motion.num_frames == speech.num_frames:
            return motion
        common = min(motion.num_frames, speech.num_frames)
        self._note(
            f"The reference has {motion.num_frames} frames and the speech {speech.num_frames}; "
            + (
                f"the reference was cut to {common}."
                if motion.num_frames > common
                else "where it has ended, the comparison holds its last frame."
            )
        )
        return first_frames(motion, common)

    def _require_space(self, num_frames: int, num_systems: int) -> None:
        """Ask for what such runs have taken, and half as much again."""
        count = num_systems * self.request.samples + 1
        motion_bytes = 4 * 268 * num_frames
        pixels = self.request.size**2 * len(self.request.views) * 2
        video_bytes = 0.012 * pixels * num_frames if self.request.has_video else 0
        needed = 1.5 * count * (motion_bytes + video_bytes) + 10e6
        require_free_space(self.folder.out, int(needed))

    # Making

    def _generate(self, systems: Sequence[System], speech: Speech, speaker: str) -> list[_Row]:
        from model.diagnostics import smooth_motion
        from model.generate import GenerateOptions, generate_motion
        from model.motion import save_motion

        request = self.request
        options = GenerateOptions(
            speaker=speaker,
            seed=request.seed,
            samples=request.samples,
            steps=request.steps or DEFAULT_STEPS,
            sampler=request.sampler or DEFAULT_SAMPLER,
        )
        rows = []
        for done, system in enumerate(systems):
            motions = generate_motion(
                system,
                speech,
                options,
                on_progress=lambda part, done=done, system=system: self._progress(
                    "motion", (done + part) / len(systems), system.name
                ),
                should_cancel=self.should_cancel,
            )
            for sample, raw in enumerate(motions, start=1):
                shown = smooth_motion(raw) if request.post_filter == "savgol" else raw
                row = _Row(sample_name(system.name, sample), raw, shown)
                path = self.folder.path(f"{file_stem(row.name)}.npz")
                save_motion(shown, path)
                self._tell("motion", row.name, path)
                rows.append(row)
        return rows

    def _measure(self, rows: Sequence[_Row], tip: TipSource) -> dict:
        from model.diagnostics import diagnose
        from model.skeleton import open_body_skeleton

        self._progress("numbers", 0.0)
        self._stop_if_asked()
        reference = next((row.raw for row in rows if row.name == REFERENCE_NAME), None)
        generated = {row.name: row.raw for row in rows if row.name != REFERENCE_NAME}
        diagnostics = diagnose(
            generated,
            open_body_skeleton(),
            reference=reference,
            tip_track=None if self.request.body is None else tip.track,
            tip_source=tip.name,
        )
        self._note(*diagnostics["notes"])
        json_path = self.folder.path("diagnostics.json")
        csv_path = self.folder.path("diagnostics.csv")
        write_diagnostics(diagnostics, json_path, csv_path)
        self._tell("diagnostics", "diagnostics", json_path)
        self._tell("diagnostics", "diagnostics", csv_path)
        self._progress("numbers", 1.0)
        return diagnostics

    def _draw(
        self, body: Body, motions: dict[str, BodyMotion], speech: Speech
    ) -> dict[str, np.ndarray]:
        """All videos; returns the pictures for Figure 6 by row."""
        from renderer.figures import choose_snapshot_frames
        from renderer.stage import set_stage
        from renderer.worker import RenderJob

        self._progress("video", 0.0)
        request = self.request
        shortest = min(motion.num_frames for motion in motions.values())
        frames = choose_snapshot_frames(shortest)
        jobs: dict[str, RenderJob] = {}
        rows: dict[str, str] = {}
        for view in request.views:
            settings = render_settings(view, request.size)
            stage = set_stage(body, list(motions.values()), view, settings.aspect)
            for name, motion in motions.items():
                is_main = view == request.views[0]
                file_name = file_stem(name) + ("" if is_main else f".{view}") + ".mp4"
                rows[file_name] = name
                jobs[file_name] = RenderJob(
                    motion=motion,
                    out=self.folder.path(file_name),
                    speech_wav=self._wav,
                    settings=settings,
                    body_path=request.body,
                    stage=stage,
                    still_frames=frames if is_main else (),
                )
        results = draw_videos(
            jobs,
            on_progress=lambda part: self._progress("video", part),
            on_done=lambda file: self._tell("video", rows[file], self.folder.path(file)),
            should_cancel=self.should_cancel,
        )
        self._progress("video", 1.0)
        return {rows[file]: result.stills for file, result in results.items() if len(result.stills)}

    def _compare(self, names: Sequence[str]) -> None:
        from renderer.compose import compose_videos

        self._progress("comparison", 0.0)
        shown = self._rows_that_fit(names)
        out = self.folder.path("comparison.mp4")
        compose_videos(
            [self.folder.path(f"{file_stem(name)}.mp4") for name in shown],
            list(shown),
            out,
            self._wav,
            on_progress=lambda part: self._progress("comparison", part),
            should_cancel=self.should_cancel,
        )
        self._tell("comparison", "comparison", out)
        self._progress("comparison", 1.0)

    def _rows_that_fit(self, names: Sequence[str]) -> list[str]:
        """All rows, or where they are too many the first sample of each system."""
        if len(names) <= MAX_COMPARED:
            return list(names)
        first = [name for name in names if not _is_later_sample(name)]
        self._note(
            f"Comparison and figure hold {MAX_COMPARED} motions at most; they show the first "
            "sample of each system."
        )
        return first[:MAX_COMPARED]

    def _figure(
        self, rows: Sequence[_Row], snapshots: dict[str, np.ndarray], tip: TipSource
    ) -> None:
        from model.diagnostics import first_frames
        from renderer.figures import WINDOW_FRAMES, choose_snapshot_frames, figure6

        self._progress("figure", 0.0)
        self._stop_if_asked()
        fits = self._rows_that_fit([row.name for row in rows])
        shown = [row for row in rows if row.name in fits]
        files = figure6(
            {row.name: tip.track(first_frames(row.shown, WINDOW_FRAMES)) for row in shown},
            {row.name: snapshots[row.name] for row in shown} if snapshots else {},
            choose_snapshot_frames(min(row.shown.num_frames for row in shown)),
            30.0,
            self.folder.path("figure6.png").with_suffix(""),
            reference=REFERENCE_NAME if REFERENCE_NAME in fits else None,
            point=TIP_TITLE,
            tip_source=tip.name,
            post_filter=self.request.post_filter,
            clip=self.request.speech.stem,
        )
        for path in files:
            self._tell("figure", "figure6", self.folder.path(path.name))
        self._progress("figure", 1.0)

    def _write_provenance(
        self,
        systems: Sequence[System],
        speech: Speech,
        speaker: str,
        body: Body,
        backend: str | None,
    ) -> None:
        request = self.request
        record = make_provenance(
            systems,
            speech={
                "file": request.speech.name,
                "sha256": speech.sha256,
                "duration_s": round(speech.duration_s, 6),
                "frames": speech.num_frames,
            },
            options={
                "speaker": speaker,
                "seed": request.seed,
                "samples": request.samples,
                "steps": request.steps or DEFAULT_STEPS,
                "sampler": request.sampler or DEFAULT_SAMPLER,
                "post_filter": request.post_filter,
                "reference": request.reference.name if request.reference else None,
            },
            drawing={
                "body": body.name,
                "body_sha256": body.sha256,
                "backend": backend,
                "views": list(request.views),
                "size": request.size,
            },
            notes=self.notes,
        )
        path = self.folder.path("provenance.json")
        path.write_text(json.dumps(record, indent=1) + "\n")
        self._tell("provenance", "provenance", path)

    # Telling

    def _progress(self, stage: Stage, fraction: float, detail: str = "") -> None:
        self.on_event(Progress(stage, fraction, detail))

    def _tell(self, kind: ArtefactKind, name: str, path: Path) -> None:
        self.on_event(Artefact(kind, name, path))

    def _note(self, *sentences: str) -> None:
        self.notes.extend(note for note in sentences if note not in self.notes)

    def _stop_if_asked(self) -> None:
        if self.should_cancel():
            raise CancelledRun


def _backend() -> str:
    from renderer.probe import choose_backend

    return choose_backend()


def _is_later_sample(name: str) -> bool:
    return name.rpartition(".s")[2].isdigit() and ".s" in name


def _is_cancellation(error: Exception) -> bool:
    from model.generate import Cancelled as GenerationCancelled
    from renderer.video import Cancelled as RenderCancelled

    return isinstance(error, GenerationCancelled | RenderCancelled)
