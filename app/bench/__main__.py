"""``python -m app.bench``: what each stage costs here, as a table and bench.json."""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.config import BUNDLED_WEIGHTS, EXAMPLES, PROJECT
from app.run.body_motion import body_motion
from app.run.models import get_body, get_system, warm_up
from app.run.output.provenance import versions
from app.run.output.run_folder import read_run
from app.run.pipeline import do
from app.run.requests.request import SIZES_PX, Ask, Event, Grown, Progress
from conventions.names import file_stem
from conventions.rates import FPS
from conventions.views import CLOSE_UPS
from model.systems.registry import families, list_systems, usual_systems

if TYPE_CHECKING:
    from app.bench.drawing import Cost
    from model.speech.audio import Speech
    from renderer.body.body import BodyMotion

CLIP_S = 10.0
SAMPLES = 5
PAGE_SIZE_PX = 640
"""Height of a body in the page's player."""
SHORT_S, LONG_S = 60.0, 600.0
START_TIMEOUT_S = 60.0
WARM_UP_S = 30.0
"""In which a page that nobody uses has read all models."""


@dataclass(frozen=True)
class Figure:
    """One measured number beside what was aimed at."""

    name: str
    value: float
    unit: str
    aim: str = ""
    cpu: float | None = None
    """The same by CPU time, which a busy machine disturbs less."""

    def line(self) -> str:
        cpu = "" if self.cpu is None else f"(CPU {self.cpu:.2f})"
        return f"{self.name:<44} {self.value:>9.2f} {self.unit:<9} {cpu:<14} {self.aim}".rstrip()


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print the table, write the file."""
    parser = argparse.ArgumentParser(prog="python -m app.bench", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("bench.json"), metavar="FILE")
    parser.add_argument("--weights", type=Path, default=BUNDLED_WEIGHTS, metavar="DIR")
    parser.add_argument("--speech", type=Path, metavar="WAV", help="default: an example clip")
    parser.add_argument(
        "--no-memory", action="store_true", help="leave out the ten-minute clip, which takes long"
    )
    parser.add_argument(
        "--short",
        action="store_true",
        help="a few minutes: without training, families, busy cores, a run of all systems, "
        "browser, stages of drawing and memory",
    )
    options = parser.parse_args(argv)
    speech = options.speech or min(EXAMPLES.glob("*.wav"))
    figures: list[Figure] = []

    def add(new: list[Figure]) -> None:
        for figure in new:
            sys.stdout.write(figure.line() + "\n")
            sys.stdout.flush()
        figures.extend(new)

    with tempfile.TemporaryDirectory(prefix="bench-") as name:
        folder = Path(name)
        clip = repeat_speech(speech, CLIP_S, folder / "clip.wav")
        add(time_page_start(options.weights, folder))
        warm_up(options.weights, None)
        add(time_motion(clip, options.weights))
        if not options.short:
            add(time_families())
            add(time_training(options.weights))
            add(time_beside_busy_cores(clip, options.weights, folder))
            add(time_run(clip, options.weights, folder))
        add(time_page_run(clip, options.weights, folder))
        if not options.short:
            add(time_browser(clip, options.weights, folder))
        made = folder / ("page" if options.short else "run")
        add(time_measures(made / f"{file_stem(usual_systems('bench-busy')[0])}.npz"))
        add(time_rendering(made, folder, options.short))
        if not (options.no_memory or options.short):
            add(measure_memory(speech, options.weights, folder))
    record = {
        "figures": [asdict(figure) for figure in figures],
        "machine": {"cores": os.cpu_count(), "processor": platform.processor() or "unknown"},
        "versions": versions(),
    }
    options.out.write_text(json.dumps(record, indent=1) + "\n")
    return 0


def repeat_speech(path: Path, duration_s: float, out: Path) -> Path:
    """Speech of exactly that length, made by cutting or repeating ``path``."""
    from conventions.rates import SAMPLE_RATE
    from model.speech.audio import load_speech, write_wav

    waveform = load_speech(path).waveform
    num_samples = round(duration_s * SAMPLE_RATE)
    write_wav(out, np.resize(waveform, num_samples))
    return out


def time_page_start(weights: Path, folder: Path) -> list[Figure]:
    """From the command to the first answer of the page."""
    started = time.monotonic()
    with served_page(weights, folder):
        return [Figure("page start", time.monotonic() - started, "s", "at most 8 s")]


@contextmanager
def served_page(weights: Path, folder: Path) -> Iterator[str]:
    """The address of a page that has just been started, as on a fresh machine."""
    address = "http://127.0.0.1:7899/"
    started = time.monotonic()
    with tempfile.TemporaryDirectory(dir=folder) as fresh:
        page = subprocess.Popen(
            [sys.executable, "app.py", "--port", "7899", "--weights", str(weights.resolve())],
            cwd=PROJECT,
            env={**os.environ, "TMPDIR": fresh, "XDG_CACHE_HOME": fresh},
            stderr=subprocess.DEVNULL,
        )
        try:
            while True:
                try:
                    urllib.request.urlopen(address, timeout=5).read()
                    break
                except (urllib.error.URLError, ConnectionError) as error:
                    if time.monotonic() - started > START_TIMEOUT_S or page.poll() is not None:
                        raise RuntimeError("The page did not start.") from error
                    time.sleep(0.05)
            yield address
        finally:
            page.terminate()
            page.wait()


def time_motion(clip: Path, weights: Path) -> list[Figure]:
    """Features, generation of each system at the default number of steps, and five samples."""
    from model.generation.cost import generation_ms
    from model.speech.audio import load_speech

    speech: Speech = load_speech(clip)
    systems = [get_system(name, weights) for name in list_systems(weights)]
    started = time.perf_counter()
    systems[0].encoder.encode(speech.waveform, speech.num_frames)
    features_ms = _ms_per_frame(started, speech.num_frames)
    figures = [Figure("speech features", features_ms, "ms/frame")]
    for system in systems:
        steps = system.samplers[0].steps
        each = generation_ms(system, speech, steps) - features_ms
        title = f"generation, {system.name}, {steps} steps"
        figures.append(Figure(title, each, "ms/frame", "at most 4"))
    each = generation_ms(systems[-1], speech, systems[-1].samplers[0].steps, SAMPLES)
    title = f"one of {SAMPLES} samples, {systems[-1].name}"
    return [*figures, Figure(title, each, "ms/frame", "at most 2")]


def time_families() -> list[Figure]:
    """What families measure of their own networks, each in a process of its own."""
    figures = []
    for family in families():
        if family.has_cost:
            code = f"import json; from {family.package}.cost import measured; "
            rows = json.loads(_told("-c", code + "print(json.dumps(measured()))"))
            figures += [Figure(*row) for row in rows]
    return figures


def time_training(weights: Path) -> list[Figure]:
    """Training at the demo's and at the paper's size as it is done here, and as it was before: in
    fp32 and not compiled."""
    from app.bench.generation import training_rate

    name, *others = usual_systems("bench-training")
    figures = []
    for config, aim in (("demo", 150), ("paper", 40)):
        for is_fast, kind in ((False, "fp32, not compiled"), (True, "as trained")):
            rate = training_rate(name, weights, config, fast=is_fast)
            title = f"training, {name}, {config} size, {kind}"
            figures.append(Figure(title, rate, "windows/s", f"at least {aim}" if is_fast else ""))
    for other in others:
        rate = training_rate(other, weights)
        figures.append(Figure(f"training, {other}, demo size, as trained", rate, "windows/s"))
    for instructions, capability in (("AVX512_CORE", "avx512"), ("AVX2", "avx2")):
        # Of processors without AMX, and without AVX-512.
        code = (
            "from pathlib import Path; from app.bench.generation import training_rate; "
            f"print(training_rate({name!r}, Path({str(weights.resolve())!r})))"
        )
        with tempfile.TemporaryDirectory(prefix="bench-compiled-") as compiled:
            environment = {
                "ONEDNN_MAX_CPU_ISA": instructions,
                "ATEN_CPU_CAPABILITY": capability,
                "TORCHINDUCTOR_CACHE_DIR": compiled,  # code kept for other instructions crashes
            }
            rate = float(_told("-c", code, **environment))
        title = f"training, {name}, demo size, {instructions}"
        figures.append(Figure(title, rate, "windows/s"))
    return figures


def time_beside_busy_cores(clip: Path, weights: Path, folder: Path) -> list[Figure]:
    """The command line with three systems: alone, beside one busy process, and beside one on each
    core."""
    figures = []
    for busy in (0, 1, os.cpu_count() or 1):
        out = folder / f"beside-{busy}"
        flags = [
            "--systems",
            ",".join(usual_systems("bench-busy")),
            "--no-video",
            "--panels",
            "a,c,d",
            "--out",
            str(out),
        ]
        loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(busy)]
        try:
            started = time.perf_counter()
            _told("-m", "app", "generate", str(clip), *flags, "--weights", str(weights.resolve()))
            wall_s = time.perf_counter() - started
        finally:
            for loop in loops:
                loop.kill()
                loop.wait()
        figures.append(Figure(f"three systems beside {busy} busy processes", wall_s, "s"))
    return figures


def time_run(clip: Path, weights: Path, folder: Path) -> list[Figure]:
    """A whole run of all systems, as after a click on the warm page, and Figure 6 in it; its files
    stay."""
    figure_times: dict[float, float] = {}

    def watch(event: Event) -> None:
        if isinstance(event, Progress) and event.stage == "figure":
            figure_times[event.fraction] = time.monotonic()

    started = time.monotonic()
    request = Ask(speech=clip, out=folder / "run", weights=weights, has_video=True)
    do(request, watch)
    seconds = time.monotonic() - started
    return [
        Figure(f"whole run, {CLIP_S:g} s clip, all systems", seconds, "s", "at most 45 s"),
        Figure("Figure 6 of it", figure_times[0.5] - figure_times[0.0], "s", "at most 6 s"),
        Figure("jitter sheet of it", figure_times[1.0] - figure_times[0.5], "s"),
    ]


def time_page_run(clip: Path, weights: Path, folder: Path) -> list[Figure]:
    """A run as the page asks for it, of the ladder of systems, in a process that is warm: until the
    first of them moves on the stage, until all of its motion is there, as a stage without windows
    begins with, and until everything is there."""

    moving_at: list[float] = []
    whole_at: list[float] = []

    def watch(event: Event) -> None:
        if isinstance(event, Grown):
            rows = read_run(event.folder).rows
            if any("frames" in row.files for row in rows):
                moving_at.append(time.monotonic())
            if any("motion" in row.files for row in rows):
                whole_at.append(time.monotonic())

    explained = [rung.system for each in families() if each.ladder for rung in each.ladder.rungs]
    ladder = tuple(name for name in list_systems(weights) if name in explained)
    started = time.monotonic()
    request = Ask(
        speech=clip,
        out=folder / "page",
        weights=weights,
        has_video=True,
        systems=ladder,
        size=PAGE_SIZE_PX,
        close_ups=CLOSE_UPS,
    )
    do(request, watch)
    seconds = time.monotonic() - started
    first = moving_at[0] - started
    whole = f"{len(ladder)} systems end to end, {CLIP_S:g} s clip, as on the page"
    return [
        Figure(f"first window for the stage, {CLIP_S:g} s clip", first, "s", "at most 2 s"),
        Figure(f"first whole motion, {CLIP_S:g} s clip", whole_at[0] - started, "s"),
        Figure(whole, seconds, "s", "at most 30 s"),
    ]


def time_browser(clip: Path, weights: Path, folder: Path) -> list[Figure]:
    """What a visitor waits for and sees in a Chromium that draws on the processor: from the address
    to the example that moves, from the click to the first movement and to the end, and pictures a
    second of one body and of five; each beside what it would be without windows, and without
    coarser bodies."""
    from app.bench import browser as bench_browser

    five = [name for name in usual_systems("bench-browser") if name in list_systems(weights)]
    with bench_browser.browser() as browser:
        if browser is None:
            sys.stderr.write(bench_browser.WITHOUT + "\n")
            return []
        with served_page(weights, folder) as address:
            fresh = bench_browser.opening_s(browser, address)
            figures = [Figure("opening a fresh page to movement", fresh, "s", "at most 10 s")]
            time.sleep(WARM_UP_S)
            warm = bench_browser.opening_s(browser, address)
            figures.append(Figure("opening the page again to movement", warm, "s", "at most 3 s"))
            page = bench_browser.opened_page(browser, address)
            bench_browser.run_waits(page, clip, five)  # each family's first motion takes longer
            for systems in (five[-1:], five):
                waits = bench_browser.run_waits(page, clip, systems)
                what = f"{len(systems)} system{'s' if len(systems) > 1 else ''}, {CLIP_S:g} s clip"
                finest, _ = bench_browser.pictures_per_second(page, level=0)
                rate, level = bench_browser.pictures_per_second(page)
                whose = f"stage, {len(systems)} of {bench_browser.WINDOW['width']} px"
                coarse = f"{whose}, at {level['pixels']:g} of the pixels"
                figures += [
                    Figure(f"click to movement, {what}", waits.moves, "s", "at most 2 s"),
                    Figure(f"click to a first whole motion, {what}", waits.whole, "s"),
                    Figure(f"click to all motion, {what}", waits.all, "s"),
                    Figure(f"click to measures, {what}", waits.measured, "s", "at most 6 s"),
                    Figure(f"click to figures, {what}", waits.done, "s", "at most 11 s"),
                    Figure(f"{whose}, whole meshes", finest, "pictures/s"),
                    Figure(coarse, rate, "pictures/s", "at least 15"),
                ]
            sys.stderr.write(bench_browser.gpu_sentence(page, len(five)) + "\n")
    return figures


def time_measures(motion_file: Path) -> list[Figure]:
    """All measures of a motion of a minute, raw and filtered."""
    from model.diagnostics import diagnose
    from model.motion.kinematics import open_body_skeleton
    from model.motion.motion import load_motion

    motion = load_motion(motion_file)
    frames = np.resize(np.arange(motion.num_frames), round(SHORT_S * FPS))
    minute = motion.part(frames)
    started = time.perf_counter()
    diagnose({"motion": minute}, open_body_skeleton())
    seconds = time.perf_counter() - started
    return [Figure("all measures, 1-minute clip, one system", seconds, "s", "at most 1 s")]


def time_rendering(made: Path, folder: Path, is_short: bool) -> list[Figure]:
    """Videos of the first motion that was made, and unless in short by each backend, the stages of
    drawing it, and the usual loop beside."""
    from model.motion.motion import load_motion

    motion = body_motion(load_motion(min(made.glob("*.npz"))))
    if is_short:
        return _video_rates(motion, folder)
    return [
        *_video_rates(motion, folder),
        *_other_backends(motion, folder),
        *_stages(motion, folder),
    ]


def _video_rates(motion: BodyMotion, folder: Path) -> list[Figure]:
    """Frames of finished video in a second, as the app draws them."""
    from app.bench.drawing import end_to_end_cost
    from renderer.video.settings import RenderSettings

    figures = []
    for title, count, settings, aim in (
        ("video, 512 x 512", 1, RenderSettings(512, 512), "at least 30"),
        ("video, 720 x 720", 1, RenderSettings(720, 720), "at least 20"),
        ("five side by side, 320 x 480 each", 5, RenderSettings(320, 480), "at least 12"),
        ("draft, 512 x 512", 1, RenderSettings(512, 512, antialias=False), "at least 60"),
    ):
        cost = end_to_end_cost([motion] * count, folder, settings)
        figures.append(_rate(title, cost, aim))
    return figures


def _other_backends(motion: BodyMotion, folder: Path) -> list[Figure]:
    """The same video by each backend that works, whichever is used here."""
    from app.bench.drawing import end_to_end_cost
    from renderer.draw.probe import probe_backends
    from renderer.video.settings import RenderSettings

    figures = []
    for report in probe_backends():
        if report.works:
            settings = RenderSettings(512, 512, backend=report.name)
            cost = end_to_end_cost([motion], folder, settings)
            figures.append(_rate(f"video, 512 x 512, {report.name}", cost))
    return figures


def _stages(motion: BodyMotion, folder: Path) -> list[Figure]:
    """What each stage costs, with and without anti-aliasing, against the usual loop."""
    from app.bench.drawing import naive_cost, stage_costs
    from renderer.draw.offscreen import GLError
    from renderer.video.settings import RenderSettings

    body = get_body(None)
    try:
        naive = naive_cost(body, motion)
    except GLError:  # it is a loop over OpenGL
        naive = None
    figures = []
    for kind, is_smooth, aim in (("", True, "at least 4"), (", draft", False, "at least 8")):
        costs = stage_costs(body, motion, folder, RenderSettings(512, 512, antialias=is_smooth))
        figures += [
            Figure(f"{cost.stage}, 512 x 512{kind}", cost.wall_ms, "ms/frame", cpu=cost.cpu_ms)
            for cost in costs
            if is_smooth or cost.stage == "drawing"
        ]
        if naive is not None:
            # The loop has its vertices ready, and encodes nothing: compared with the same part.
            ours = [cost for cost in costs if cost.stage not in ("skinning", "encoding")]
            wall, cpu = sum(c.wall_ms for c in ours), sum(c.cpu_ms for c in ours)
            title = f"naive loop over normals, shadow and drawing{kind}"
            figures.append(Figure(title, naive.wall_ms / wall, "x", aim, naive.cpu_ms / cpu))
    return figures


def _rate(title: str, cost: Cost, aim: str = "") -> Figure:
    """Frames in a second by the clock, and by the CPU time if all cores had been free."""
    cores = len(os.sched_getaffinity(0))
    return Figure(title, 1e3 / cost.wall_ms, "frames/s", aim, cores * 1e3 / cost.cpu_ms)


def measure_memory(speech: Path, weights: Path, folder: Path) -> list[Figure]:
    """Peak memory of any process of a run of one system, for a long clip against a short one."""

    system = list_systems(weights)[-1]
    imports = (
        "import app.run.pipeline, model.diagnostics, model.generation.windows, "
        "renderer.figures.figure6.figure6"
    )
    imports_mb = _peak_mb("-c", imports)
    peaks_mb = []
    for duration_s in (SHORT_S, LONG_S):
        clip = repeat_speech(speech, duration_s, folder / f"{duration_s:g}.wav")
        out = folder / f"{duration_s:g}"
        flags = ["--systems", system, "--steps", "1", "--size", str(SIZES_PX[0])]
        command = ["-m", "app", "generate", str(clip), "--out", str(out), *flags]
        peaks_mb.append(_peak_mb(*command, "--weights", str(weights.resolve())))
    short_mb, long_mb = peaks_mb
    return [
        Figure("peak memory, 1-minute clip", short_mb, "MB"),
        Figure("peak memory, 10-minute clip", long_mb, "MB"),
        Figure("10-minute clip above the imports", long_mb - imports_mb, "MB", "at most 600 MB"),
        Figure("10-minute over 1-minute clip", long_mb / short_mb, "x", "at most 1.3"),
    ]


def _peak_mb(*arguments: str) -> float:
    """Peak memory of Python with these arguments, or of a process it starts if that is more."""
    command = [sys.executable, *arguments]
    nowhere = subprocess.DEVNULL  # its bars, which would stand between the rows
    child = subprocess.Popen(command, cwd=PROJECT, stdout=nowhere, stderr=nowhere)
    _, status, usage = os.wait4(child.pid, 0)
    if status:
        raise RuntimeError(f"It failed: {' '.join(command)}")
    return usage.ru_maxrss / 1024  # kilobytes on Linux


def _told(*arguments: str, **environment: str) -> str:
    """What Python with these arguments writes."""
    child = subprocess.run(
        [sys.executable, *arguments], cwd=PROJECT, env={**os.environ, **environment},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if child.returncode:
        raise RuntimeError(f"It failed: {' '.join(arguments)}\n{child.stderr}")
    return child.stdout


def _ms_per_frame(started: float, num_frames: int) -> float:
    return 1000 * (time.perf_counter() - started) / num_frames


if __name__ == "__main__":
    sys.exit(main())
