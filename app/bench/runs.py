"""Benchmark of speech features, generation, training, whole runs, page start and memory."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import torch

from app.config import BUNDLED_WEIGHTS, EXAMPLES, PROJECT
from app.run.callbacks import FolderUpdated, RunCallbacks, RunEvent, StageProgress
from app.run.experiments.speech_effect import measure_speech_effect
from app.run.experiments.step_sweep import measure_step_sweep
from app.run.models import get_system
from app.run.output.run_folder import read_run
from app.run.pipeline import generate
from app.run.requests.convert import request_from
from app.run.requests.requests import GenerateRequest, SpeechEffectRequest, StepSweepRequest
from conventions.rates import FPS, SAMPLE_RATE
from conventions.views import CLOSE_UPS
from model.data.prepared import PreparedClip, PreparedData
from model.motion.motion import NUM_FACE_UNITS, Motion
from model.systems.registry import families, family_of, list_systems, representatives
from model.training.task import TaskSetup
from renderer.figures.style import FIGURE_FORMATS

START_TIMEOUT_S = 60.0
SAMPLES = 5
PAGE_PICTURE_HEIGHT_PX = 640
"""Height of a body in the page's player (pixels)."""
SHORT_S, LONG_S = 60.0, 600.0
BATCH, WARM_STEPS, TIMED_STEPS = 64, 2, 8
SPEECH_DIMS = {"mel64": 68, "wavlm": 1024}
_FRAMES = 600
Result = TypeVar("Result")


@dataclass(frozen=True)
class BenchResult:
    name: str
    value: float
    unit: str
    aim: str = ""
    value_by_cpu_time: float | None = None
    """The value in ``unit``, by CPU time, which is less sensitive to a busy machine."""

    def line(self) -> str:
        cpu = "" if self.value_by_cpu_time is None else f"(CPU {self.value_by_cpu_time:.2f})"
        return f"{self.name:<44} {self.value:>9.2f} {self.unit:<9} {cpu:<14} {self.aim}".rstrip()


def measure_peak_memory_mb(*arguments: str) -> float:
    """Measure the peak memory (MB) of Python with these arguments, or of a larger child process."""
    command, nowhere = [sys.executable, *arguments], subprocess.DEVNULL
    child = subprocess.Popen(command, cwd=PROJECT, stdout=nowhere, stderr=nowhere)
    _, status, usage = os.wait4(child.pid, 0)
    if status:
        raise RuntimeError(f"The command failed: {' '.join(command)}")
    return usage.ru_maxrss / 1024  # kilobytes on Linux


def time_page_start(folder: Path) -> BenchResult:
    """Measure the time until a newly started page answers, with empty caches."""
    started = time.monotonic()
    with tempfile.TemporaryDirectory(dir=folder) as fresh:
        page = subprocess.Popen(
            [sys.executable, "app.py", "--port", "7899"],
            cwd=PROJECT,
            env={**os.environ, "TMPDIR": fresh, "XDG_CACHE_HOME": fresh},
            stdout=subprocess.DEVNULL,  # keeps other output out of the table
            stderr=subprocess.DEVNULL,
        )
        try:
            while True:
                try:
                    urllib.request.urlopen("http://127.0.0.1:7899/", timeout=5).read()
                    return BenchResult("page start", time.monotonic() - started, "s", "at most 8 s")
                except (urllib.error.URLError, ConnectionError) as error:
                    if time.monotonic() - started > START_TIMEOUT_S or page.poll() is not None:
                        raise RuntimeError("The page did not start.") from error
                    time.sleep(0.05)
        finally:
            page.terminate()
            page.wait()


def write_example_of_duration(duration_s: float, folder: Path) -> Path:
    """Write speech of exactly this duration, made by cutting or repeating an example."""
    from model.speech.audio import load_speech, write_wav

    out = folder / f"{duration_s:g}.wav"
    waveform = load_speech(min(EXAMPLES.glob("*.wav"))).waveform
    write_wav(out, np.resize(waveform, round(duration_s * SAMPLE_RATE)))
    return out


def time_features_and_generation(clip: Path) -> list[BenchResult]:
    """Measure features, generation of each system with default steps, and a batch of samples."""
    from model.generation.windows import measure_ms_per_frame
    from model.speech.audio import load_speech

    speech = load_speech(clip)
    systems = [get_system(name, BUNDLED_WEIGHTS) for name in list_systems(BUNDLED_WEIGHTS)]
    started = time.perf_counter()
    systems[0].encoder.encode(speech.waveform, speech.num_motion_frames)
    features_ms = 1000 * (time.perf_counter() - started) / speech.num_motion_frames
    figures = [BenchResult("speech features", features_ms, "ms/frame")]
    for system in systems:
        steps = system.samplers[0].default_steps
        each = measure_ms_per_frame(system, speech, steps)  # features are cached by now
        title = f"generation, {system.name}, {steps} steps"
        figures.append(BenchResult(title, each, "ms/frame", "at most 4"))
    each = measure_ms_per_frame(systems[-1], speech, systems[-1].samplers[0].default_steps, SAMPLES)
    title = f"generation, {systems[-1].name}, per sample ({SAMPLES} in one batch)"
    return [*figures, BenchResult(title, each, "ms/frame", "at most 2")]


def measure_training_rates() -> list[BenchResult]:
    """Measure training at the demo's size, without compilation, which takes minutes."""
    rates = {
        name: measure_training_windows_per_s(name, BUNDLED_WEIGHTS)
        for name in representatives("training")
    }
    title = "training, {}, demo size, not compiled"
    return [BenchResult(title.format(name), rate, "windows/s") for name, rate in rates.items()]


def time_run_with_page_settings(clip: Path, folder: Path) -> list[BenchResult]:
    """Measure a run of the explained systems with the page's settings, in a warm process.

    Times: until the first motion of the first system can be shown, until its whole motion is there,
    which players without window playback wait for, and until the run is finished.
    """
    moving_at: list[float] = []
    whole_at: list[float] = []

    def watch(event: RunEvent) -> None:
        if isinstance(event, FolderUpdated):
            rows = read_run(event.folder).rows
            if any("frames" in row.files for row in rows):
                moving_at.append(time.monotonic())
            if any("motion" in row.files for row in rows):
                whole_at.append(time.monotonic())

    explained = _explained_systems()
    started = time.monotonic()
    fields = {"speech": clip, "out": folder / "page", "systems": explained}
    shown = {"picture_height_px": PAGE_PICTURE_HEIGHT_PX, "close_ups": CLOSE_UPS}
    generate(request_from(GenerateRequest, fields | shown), RunCallbacks(watch))
    seconds = time.monotonic() - started
    first = moving_at[0] - started
    whole = f"{len(explained)} systems end to end, 10 s clip, as on the page"
    return [
        BenchResult("first window in the viewer, 10 s clip", first, "s", "at most 2 s"),
        BenchResult("first whole motion, 10 s clip", whole_at[0] - started, "s"),
        BenchResult(whole, seconds, "s", "at most 30 s"),
    ]


def _explained_systems() -> tuple[str, ...]:
    ablations = [family.ablation for family in families() if family.ablation is not None]
    explained = {step.system for ablation in ablations for step in ablation.steps}
    return tuple(name for name in list_systems(BUNDLED_WEIGHTS) if name in explained)


def measure_figure_cpu_time(clip: Path, folder: Path) -> list[BenchResult]:
    """Measure the CPU time of figures of the explained systems, for the page and a command."""
    figures, systems = [], _explained_systems()
    for title, formats, aim in (
        ("page (PNG)", ("png",), 4),
        ("command line (all formats)", FIGURE_FORMATS, 8),
    ):
        cpu_at: list[float] = []
        of_figures: list[int] = []

        def watch(
            event: RunEvent, cpu_at: list[float] = cpu_at, of_figures: list[int] = of_figures
        ) -> None:
            if isinstance(event, StageProgress) and event.stage == "figure":
                of_figures.append(len(cpu_at))
            cpu_at.append(cpu_time_s())

        fields = {"speech": clip, "out": folder / f"figures {len(formats)}", "systems": systems}
        how = {"has_video": False, "figure_formats": formats}
        generate(request_from(GenerateRequest, fields | how), RunCallbacks(watch))
        seconds = cpu_at[of_figures[-1]] - cpu_at[of_figures[0] - 1]  # from what came before them
        name = f"CPU time, figures of {len(systems)} systems, {title}"
        figures.append(BenchResult(name, seconds, "s", f"at most {aim} s"))
    return figures


def time_speech_effect(folder: Path) -> BenchResult:
    """Measure the speech effect of two examples with two seeds, in a warm process."""
    values = {"inputs": tuple(sorted(EXAMPLES.glob("*.wav"))[:2]), "out": folder / "effect"}
    request = request_from(SpeechEffectRequest, values)
    _, wall_s, cpu = measure_time(lambda: measure_speech_effect(request))
    return BenchResult(
        "speech-effect measurement, two recordings", wall_s, "s", value_by_cpu_time=cpu
    )


def time_step_sweep(clip: Path, folder: Path) -> BenchResult:
    """Measure the comparison of sampling steps of one system, in a warm process."""
    values = {
        "speech": clip,
        "out": folder / "steps",
        "systems": list_systems(BUNDLED_WEIGHTS)[-1:],
    }
    request = request_from(StepSweepRequest, values)
    _, wall_s, cpu = measure_time(lambda: measure_step_sweep(request))
    return BenchResult(
        "comparison of sampling steps, one system", wall_s, "s", value_by_cpu_time=cpu
    )


def time_metrics(motion: Motion) -> BenchResult:
    """Measure the time of all measures for one minute of motion, raw and filtered."""
    from model.diagnostics import diagnose
    from model.motion.kinematics import open_body_skeleton

    frames = np.resize(np.arange(motion.num_frames), round(SHORT_S * FPS))
    minute = motion.part(frames)
    started = time.perf_counter()
    diagnose({"motion": minute}, open_body_skeleton())
    seconds = time.perf_counter() - started
    return BenchResult("all metrics, 1-minute clip, one system", seconds, "s", "at most 1 s")


def measure_run_peak_memory(folder: Path) -> list[BenchResult]:
    """Measure the peak memory of a run without videos, for a long and a short clip."""
    system = list_systems(BUNDLED_WEIGHTS)[-1]
    imports = (
        "import app.run.pipeline, model.diagnostics, model.generation.windows, "
        "renderer.figures.figure6.layout"
    )
    imports_mb = measure_peak_memory_mb("-c", imports)
    peaks_mb = []
    for duration_s in (SHORT_S, LONG_S):
        clip = write_example_of_duration(duration_s, folder)
        out = folder / f"{duration_s:g}"
        flags = ["--systems", system, "--steps", "1", "--no-video"]
        command = ["-m", "app", "generate", str(clip), "--out", str(out), *flags]
        peaks_mb.append(measure_peak_memory_mb(*command))
    short_mb, long_mb = peaks_mb
    return [
        BenchResult("peak memory, 1-minute clip", short_mb, "MB"),
        BenchResult("peak memory, 10-minute clip", long_mb, "MB"),
        BenchResult(
            "peak memory beyond imports, 10-minute clip",
            long_mb - imports_mb,
            "MB",
            "at most 600 MB",
        ),
        BenchResult(
            "peak memory, 10-minute clip relative to 1-minute clip",
            long_mb / short_mb,
            "x",
            "at most 1.3",
        ),
    ]


def measure_training_windows_per_s(system: str, helpers: Path, config_name: str = "demo") -> float:
    """Measure a training in windows/s, in one process on synthetic data; raises CheckpointError."""
    family = family_of(system)
    config = replace(family.config(config_name, system), batch_size=BATCH)
    with tempfile.TemporaryDirectory(prefix="training-rate-") as folder:
        data = _made_up_data(Path(folder), SPEECH_DIMS[config.encoder])
        task = family.make_task(config, data, TaskSetup(helpers))
        started = 0.0
        for step in range(WARM_STEPS + TIMED_STEPS):
            if step == WARM_STEPS:
                started = time.perf_counter()
            rng = np.random.default_rng(step)
            batch = data.draw_windows(data.clips, task.window_frames, BATCH, rng)
            task.step(step, batch, torch.Generator().manual_seed(step))
        return TIMED_STEPS * BATCH / (time.perf_counter() - started)


def _made_up_data(folder: Path, speech_dim: int) -> PreparedData:
    rng = np.random.default_rng(0)

    def noise(columns: int, spread: float) -> np.ndarray:
        return rng.normal(0, spread, (_FRAMES, columns)).astype(np.float32)

    return PreparedData(
        folder,
        folder,
        clips=(PreparedClip("1_made_0", 1, "train", 0, _FRAMES),),
        poses=noise(165, 0.1),
        transl=noise(3, 0.01),
        arkit_weights=noise(NUM_FACE_UNITS, 0.1),
        speech=noise(speech_dim, 1.0),
        speaker_names={1: "made"},
    )


def measure_time(work: Callable[[], Result]) -> tuple[Result, float, float]:
    """Run ``work``; return its result, wall time (s) and CPU time (s)."""
    cpu_started, started = cpu_time_s(), time.perf_counter()
    result = work()
    return result, time.perf_counter() - started, cpu_time_s() - cpu_started


def cpu_time_s() -> float:
    """Return the CPU time (s) of this process and of its children that have ended."""
    usages = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)
