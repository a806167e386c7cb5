"""Equal noise on local and on global rotations: the paper's argument on a body."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from pandas import DataFrame

from app.errors import RunError
from app.run.bodies import make_point_tracker
from app.run.callbacks import NO_CALLBACKS, RunCallbacks
from app.run.models import get_body
from app.run.output.run_folder import RunRecord
from app.run.requests.parts import DEFAULT_TRACKED_POINT
from app.run.requests.requests import ROTATION_NOISE_VIDEO, WITHOUT_NOISE, RotationNoiseRequest
from app.run.run_writer import RunWriter, open_run_writer
from app.run.videos.videos import draw_videos
from model.formats.read import read_any_motion
from model.metrics.error_growth import ErrorGrowth, error_growth_summary, measure_error_growth
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion
from model.motion.tracks import kinematic_chain
from model.motion.transforms import with_local_and_global_noise
from model.speech.transcript import EMPTY_TRANSCRIPT
from renderer.video.compose import compose_videos

NOISY_MOTION_NAMES: tuple[str, str] = ("local noise", "global noise")
"""Names of the two bodies, by the rotations with noise."""
DRAWN = "Noise of {noise:g} rad on local rotations (left) and on global rotations (right)."
_DRAWN = 0.85
"""Fraction of the work that is done when both bodies are rendered."""


def compare_rotation_noise(
    request: RotationNoiseRequest, callbacks: RunCallbacks = NO_CALLBACKS
) -> None:
    """Add noise to two copies of a motion, and show both, with a video if requested.

    Raises Cancelled, RunError, MotionError, BodyError, GLError or VideoError.
    """
    request.check()
    motion = request.motion
    if not kinematic_chain(request.tracked_point):
        raise RunError(
            "Joint rotations do not move the pelvis; track another joint, such as a wrist."
        )
    request.import_overrides.check_files_exist([motion])
    reading = read_any_motion(motion, request.import_overrides, request.body)
    growth = measure_error_growth(
        reading.motion,
        open_body_skeleton(),
        request.tracked_point,
        request.noise_rad,
        seed=request.seed,
    )
    noisy = dict(
        zip(
            NOISY_MOTION_NAMES,
            with_local_and_global_noise(reading.motion, request.noise_rad, request.seed),
            strict=True,
        )
    )
    record = RunRecord(kind="imported", tracked_point=DEFAULT_TRACKED_POINT)
    with open_run_writer(
        request.output.out, record, callbacks, is_incremental=request.output.is_incremental
    ) as run:
        tracker = make_point_tracker(request.body, DEFAULT_TRACKED_POINT)
        run.add_notes(*reading.notes, *_growth_sentences(growth, request.noise_rad))
        shown = run.write_motions_and_make_timeline(
            {**noisy, WITHOUT_NOISE: reading.motion}, None, tracker
        )
        run.write_timeline(shown, EMPTY_TRANSCRIPT)
        _draw_growth(request, growth, run)
        if request.has_video:
            _draw_bodies(request, reading.motion, noisy, run)
        run.finish(DRAWN.format(noise=request.noise_rad))


def _draw_growth(request: RotationNoiseRequest, growth: ErrorGrowth, run: RunWriter) -> None:
    """Draw the displacement of points along the kinematic chain."""
    spreads = DataFrame(
        {
            "point": growth.point_names,
            "local": growth.local_rms_m,
            "global": growth.global_rms_m,
            "predicted_local": growth.predicted_local_rms_m,
            "predicted_global": growth.predicted_global_rms_m,
        }
    )
    summary = error_growth_summary(growth, request.noise_rad)
    run.write_figure("error_growth", spreads, summary, request.output.figure_formats)


def _draw_bodies(
    request: RotationNoiseRequest, clean: Motion, noisy: Mapping[str, Motion], run: RunWriter
) -> None:
    body = get_body(request.body)
    tracker = make_point_tracker(request.body, request.tracked_point)
    drawn = run.folder.scratch("bodies")
    drawn.mkdir()
    paths = {name: drawn / f"{number}.mp4" for number, name in enumerate(noisy)}

    def out(name: str, _: object) -> Path:
        return paths[name]

    # The camera frames the clean motion.
    on_progress = run.progress_callback("video", _DRAWN)
    draw_videos(noisy, request.video, body, tracker, out, on_progress, camera_motions=[clean])
    video = run.folder.new_path(ROTATION_NOISE_VIDEO)
    compose_videos(
        list(paths.values()),
        [f"{name}, {request.noise_rad:g} rad" for name in noisy],
        video,
        request.speech,
        on_progress=run.progress_callback("video", 1.0 - _DRAWN, _DRAWN),
    )
    run.add_files(video)


def _growth_sentences(growth: ErrorGrowth, noise_rad: float) -> Iterator[str]:
    """Yield sentences on the result of the experiment, and on its limits."""
    jerk = growth.jerk_m_s3
    yield error_growth_summary(growth, noise_rad)
    yield (
        f"The jerk of this point is {jerk['local']:.0f} m/s³ with noise on local rotations, "
        f"{jerk['global']:.0f} m/s³ on global ones and {jerk['clean']:.0f} m/s³ without noise."
    )
    yield (
        "This assumes equal noise on local and on global rotations; whether a trained network "
        "makes equal errors in both is not tested here."
    )
