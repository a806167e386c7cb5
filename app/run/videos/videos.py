"""Pictures of motions with the same camera and scales: videos, comparison, poses with jerk."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from app.errors import RunError
from app.run.bodies import PointTracker, align_and_cap_lengths, body_motion, make_point_tracker
from app.run.callbacks import FolderUpdated, RunCallbacks
from app.run.display import FULL_SPEED_M_S, Display
from app.run.models import get_body
from app.run.output import run_folder
from app.run.output.result_folder import ResultFolder
from app.run.requests.parts import MAX_COMPARED, VideoOptions
from app.run.requests.requests import RunVideosRequest
from conventions.joints import FINGERTIP_VERTICES
from conventions.names import COMPARISON, REFERENCE_NAME, SampleName, safe_file_stem
from conventions.views import View
from model.metrics.smoothness import derivative_magnitudes
from model.motion.motion import Motion, load_motion
from model.motion.transforms import exaggerate_tremor
from renderer.body.body import Body, BodyMotion
from renderer.figures.figure6.contents import JointMarks
from renderer.scene.camera_setup import CameraSetup, Panel, layout_panels, select_frames
from renderer.video import render
from renderer.video.compose import compose_videos
from renderer.video.overlays import HeatMap, Overlays, Trail
from renderer.video.render import RenderSettings
from renderer.video.workers import MotionRenderJob, run_render_jobs

FileCallback = Callable[..., None]
"""Callback with the signature of `app.run.run_writer.RunWriter.add_files`."""
PictureKey = tuple[str, View]
"""Name of a motion, and view."""
Jobs = dict[PictureKey, MotionRenderJob]
Draw = Callable[..., dict[PictureKey, np.ndarray]]
"""Function with the parameters of `renderer.video.workers.run_render_jobs`."""


def render_settings(
    video: VideoOptions, view: View, layout: tuple[Panel, ...] | None = None, **others: Any
) -> RenderSettings:
    """Return the render settings of a view, with close-ups if it is the first.

    Close-ups are square next to the whole body, and have three quarters of the width next to a body
    from the knees up. Raises RunError if the size cannot be rendered or encoded.
    """
    height = video.picture_height_px
    width = height if video.framing == "whole" else 2 * (3 * height // 8)
    size = (layout[0].width, layout[0].height) if layout else (width, height)
    if video.close_ups and view == video.views[0]:
        layout = layout or layout_panels(view, *size, video.close_ups)
    try:
        return RenderSettings(*size, view, video.framing, layout=layout, **others)
    except ValueError as error:
        raise RunError(str(error)) from error


@dataclass(frozen=True)
class Snapshots:
    """Poses of Figure 6: frames, and pictures (N, H, W, 3) by motion."""

    frames: tuple[int, ...] = ()
    pictures: dict[str, np.ndarray] = field(default_factory=dict)
    marks: JointMarks | None = None
    """Jerk of each joint around each of the frames; None without pictures."""


def draw_videos(
    motions: Mapping[str, Motion],
    video: VideoOptions,
    body: Body,
    tracker: PointTracker,
    video_path: Callable[[str, View], Path | None],
    on_progress: Callable[[float], None],
    *,
    on_done: Callable[[PictureKey], None] = lambda key: None,
    speech: Path | None = None,
    frames: tuple[int, ...] = (),
    camera_motions: Sequence[Motion] = (),
    layouts: Mapping[str, tuple[Panel, ...]] | None = None,
    move_cameras: Callable[[Jobs], Jobs] = lambda jobs: jobs,
    draw: Draw | None = None,
    **settings: Any,
) -> dict[PictureKey, np.ndarray]:
    """Render each motion in each view, with one camera for all bodies; return stills by key.

    All videos of the program are rendered by this function. The camera frames the original motions,
    also if they are exaggerated.

    Args:
        video_path: returns the video of a motion and view, or None for no video.
        on_progress: called with the fraction of frames done; an exception from it stops the work.
        on_done: called with the key of each complete video.
        frames: frames to return as stills.
        camera_motions: motions that the camera frames, if they are other ones.
        layouts: panels by motion; None for the default ones.
        settings: further fields of `RenderSettings`.

    Raises:
        RunError: if the size cannot be rendered or encoded.
        BodyError, GLError, VideoError: as `run_render_jobs`.
    """
    posed = [body_motion(motion) for motion in camera_motions or motions.values()]
    looks = {
        name: {
            "motion": body_motion(with_exaggerated_tremor(motion, video.display)),
            "overlays": make_overlays(motion, video.display, tracker, body),
        }
        for name, motion in motions.items()
    }
    cameras: dict[RenderSettings, CameraSetup] = {}
    jobs: Jobs = {}
    for view, name in product(video.views, motions):
        how = render_settings(video, view, (layouts or {}).get(name), **settings)
        if how not in cameras:
            cameras[how] = render.camera_setup_for(body, posed, how)
        jobs[name, view] = MotionRenderJob(
            **looks[name],
            out=video_path(name, view),
            speech_wav=speech,
            settings=how,
            body_path=video.body,
            look=video.look,
            stage=cameras[how],
            still_frames=frames,
        )
    return (draw or run_render_jobs)(move_cameras(jobs), on_progress=on_progress, on_done=on_done)


def render_row_videos(
    motions: Mapping[str, Motion],
    video: VideoOptions,
    body: Body,
    tracker: PointTracker,
    on_share: Callable[[float], None],
    folder: ResultFolder,
    speech: Path | None,
    on_file: FileCallback,
) -> None:
    """Render a video of each row of a run in each view, of aligned motions; see `draw_videos`.

    ``on_file`` is called with each video as soon as it is complete.
    """

    def out(name: str, view: View) -> Path:
        return folder.new_path(run_folder.video_file_name(name, view, video.views))

    def on_done(key: PictureKey) -> None:
        name, view = key
        on_file(out(name, view), row=name if view == video.views[0] else "", kind="video")

    draw_videos(motions, video, body, tracker, out, on_share, on_done=on_done, speech=speech)


def draw_snapshots(
    motions: Mapping[str, Motion],
    video: VideoOptions,
    body: Body,
    on_share: Callable[[float], None],
    frames: tuple[int, ...],
) -> Snapshots:
    """Render snapshots for Figure 6, of the whole body in the first view.

    They are rendered in this process, which has loaded the body, and in one context: starting
    another process takes as long as some forty pictures. `choose_backend` has tested the driver in
    a separate process before.

    Args:
        motions: aligned motions.
        on_share: called with the fraction of pictures done; an exception from it stops the work.

    Raises:
        GLError: if the driver renders no picture.
    """
    whole = replace(video, framing="whole", close_ups=(), views=video.views[:1])
    settings = render_settings(whole, whole.views[0])
    posed = {name: body_motion(motion) for name, motion in motions.items()}
    stage = render.camera_setup_for(body, [*posed.values()], settings)
    groups: dict[Any, list[str]] = {}
    for name, motion in posed.items():
        groups.setdefault((motion.expression_basis, motion.betas.tobytes()), []).append(name)
    pictures: dict[str, list[np.ndarray]] = {name: [] for name in posed}
    for names in groups.values():  # rendered as consecutive frames of one motion
        still = [select_frames(posed[name], frames) for name in names]
        parts = {
            part: np.concatenate([getattr(each, part) for each in still])
            for part in ("poses", "trans", "expressions")
        }
        ways = [stage.followed_positions(body, posed[name])[0][list(frames)] for name in names]
        looks = (
            body,
            replace(still[0], **parts),
            settings,
            stage.with_camera_paths([np.concatenate(ways)]),
        )
        with closing(render.draw_frames(*looks)) as drawn:
            for number, picture in enumerate(drawn):
                pictures[names[number // len(frames)]].append(picture.copy())
                done = sum(map(len, pictures.values()))
                on_share(done / (len(posed) * len(frames)))
    stacks = {name: render.stack_pictures(each, settings) for name, each in pictures.items()}
    return Snapshots(frames, stacks, jerk_marks(body, posed, frames, settings, stage))


_HEAT_SIGMA_FRAMES = 3.0
"""Smoothing of jerk over time (frames); the jerk of single frames is noise, and would flicker."""


def with_exaggerated_tremor(motion: Motion, display: Display) -> Motion:
    """Return the motion as it is rendered: exaggerated above the cut-off, if requested."""
    return exaggerate_tremor(motion, display.exaggeration, display.cutoff_hz)


def make_overlays(
    motion: Motion, display: Display, tracker: PointTracker, body: Body
) -> Overlays | None:
    """Return the overlays of a motion's pictures; None if nothing is displayed.

    Jerk and speed are those of the original motion, also if it is exaggerated.
    """
    if display.is_default:
        return None
    factor, cutoff = (f"{round(value, 1):g}" for value in (display.exaggeration, display.cutoff_hz))
    is_larger = display.exaggeration != 1
    return Overlays(
        trail=_trail(motion, display, tracker, body) if display.has_trail else None,
        heat=_heat(motion, display, body) if display.coloring == "jerk" else None,
        notice=f"EXAGGERATED x{factor} above {cutoff} Hz" if is_larger else "",
        close_up_notice=f"x{factor}" if is_larger else "",
    )


def _trail(motion: Motion, display: Display, tracker: PointTracker, body: Body) -> Trail:
    track, drawn = tracker.track(motion), tracker
    # A character's trail leaves its own hand; the numbers are those of the skeleton.
    if body.rig is not None:
        joint = f"{tracker.name}3" if tracker.name in FINGERTIP_VERTICES else tracker.name
        drawn = PointTracker(joint, body)
    speed = _by_frame(derivative_magnitudes(track, 1), len(track))
    jerk = _by_frame(derivative_magnitudes(track, 3), len(track))
    side = tracker.name.split("_")[0]
    return Trail(
        points=drawn.track(
            motion if display.exaggeration == 1 else with_exaggerated_tremor(motion, display)
        ),
        normalized_speeds=np.minimum(speed / FULL_SPEED_M_S, 1.0),
        is_spike=jerk > display.max_jerk_m_s3,
        legend=f"speed 0 to {FULL_SPEED_M_S:g} m/s; dots: jerk over {display.max_jerk_m_s3:g} m/s³",
        close_up_view=f"{side}_hand" if side in ("left", "right") else "",
        length_frames=display.trail_frames,
    )


def _heat(motion: Motion, display: Display, body: Body) -> HeatMap:
    jerk = derivative_magnitudes(body.joint_positions(body_motion(motion)), 3)
    of_frame = _by_frame(jerk, motion.num_frames)
    smooth = ndimage.gaussian_filter1d(of_frame, _HEAT_SIGMA_FRAMES, axis=0, mode="nearest")
    shares = np.minimum(smooth / display.max_jerk_m_s3, 1.0)
    return HeatMap(shares.astype(np.float32), f"jerk: 0 to {display.max_jerk_m_s3:g} m/s³")


def _by_frame(values: Float[np.ndarray, " N *C"], num_frames: int) -> np.ndarray:
    """Return a value for each frame, from differences that are centred on frames.

    The ends repeat the nearest value; a clip without differences gets zeros.
    """
    if not len(values):
        return np.zeros((num_frames, *values.shape[1:]))
    before = (num_frames - len(values)) // 2
    return values[np.clip(np.arange(num_frames) - before, 0, len(values) - 1)]


MEAN_JERK_RADIUS_FRAMES = 8
"""Half-width (frames) of the mean of jerk around a snapshot; the jerk of single frames is noise."""
LEAST_FULL_SCALE = 500.0
"""Minimum of the colour scale (m/s³). Recorded speakers reach this with a hand in quick gestures,
so smooth motion stays pale, however smooth the other motions are."""
_PERCENTILE = 98.0


def jerk_marks(
    body: Body,
    motions: Mapping[str, BodyMotion],
    frames: Sequence[int],
    settings: RenderSettings,
    stage: CameraSetup,
) -> JointMarks:
    """Compute the jerk of each joint in the snapshots of motions, on a common scale.

    The end of the scale is a round number that nearly all values stay below.
    """
    values = {name: _jerk_around(body, motion, frames) for name, motion in motions.items()}
    highest = float(np.percentile(np.concatenate(list(values.values())), _PERCENTILE))
    return JointMarks(
        pixels={
            name: render.projected_joints(body, motion, frames, settings, stage)
            for name, motion in motions.items()
        },
        joint_jerk=values,
        full_scale=_round_up(max(highest, LEAST_FULL_SCALE)),
    )


def _jerk_around(body: Body, motion: BodyMotion, frames: Sequence[int]) -> np.ndarray:
    """Compute the mean jerk (N, J) in m/s³ of joints around frames; 0 in a clip under 4 frames."""
    values = []
    for frame in frames:
        near = slice(max(0, frame - MEAN_JERK_RADIUS_FRAMES), frame + MEAN_JERK_RADIUS_FRAMES + 1)
        jerk = derivative_magnitudes(body.joint_positions(select_frames(motion, near)), 3)
        values.append(jerk.mean(axis=0) if len(jerk) else np.zeros(jerk.shape[1]))
    return np.stack(values)


def _round_up(value: float) -> float:
    """Round up to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value))


def choose_compared_motions(names: list[str]) -> tuple[list[str], tuple[str, ...]]:
    """Return the motions that fit a comparison, and a note if some are omitted.

    If there are too many, these are the first sample of each system and the reference.
    """
    if len(names) <= MAX_COMPARED:
        return names, ()
    reference = [name for name in names if name == REFERENCE_NAME]
    first = [name for name in names if name not in reference and SampleName.parse(name).number == 1]
    fitting = [*first[: MAX_COMPARED - len(reference)], *reference]
    note = (
        f"The comparison and the figures show only {', '.join(fitting)}; at most {MAX_COMPARED} "
        "motions fit."
    )
    return fitting, (note,)


@contextmanager
def composing_comparison_video(
    names: Sequence[str],
    wav: Path | None,
    folder: ResultFolder,
    callbacks: RunCallbacks,
    on_file: FileCallback,
) -> Iterator[None]:
    """Join the videos of rows side by side, with one sound track, while the block runs.

    Raises on leaving:
        Cancelled, VideoError: see `renderer.video.compose.compose_videos`.
    """
    callbacks.report_progress("comparison", 0.0)
    out, is_cancelled = folder.new_path(f"{COMPARISON}.mp4"), Event()
    with ThreadPoolExecutor(1) as beside:
        joining = beside.submit(
            compose_videos,
            [folder.current_path(f"{safe_file_stem(name)}.mp4") for name in names],
            names,
            out,
            wav,
            on_progress=partial(callbacks.report_progress, "comparison"),
            should_cancel=lambda: is_cancelled.is_set() or callbacks.should_cancel(),
        )
        try:
            yield
            joining.result()
        except BaseException:
            is_cancelled.set()
            raise
    on_file(out)
    callbacks.report_progress("comparison", 1.0)


def draw_run_videos(request: RunVideosRequest, callbacks: RunCallbacks) -> None:
    """Render the videos of a run's motions and ``comparison.mp4``, and add them to its folder.

    Raises Cancelled, and MotionError, BodyError, GLError, VideoError, each with one sentence.
    """
    run, video = request.run, request.video
    record = run_folder.read_run(run)

    def add(path: Path, row: str = "", kind: run_folder.RowFileKind | None = None) -> None:
        run_folder.add_file(run, path, row, kind)
        callbacks.on_event(FolderUpdated(run))

    motions = {
        row.name: load_motion(file)
        for row in record.rows
        if row.edit is None and (file := run_folder.existing_file(run, row.files.get("motion")))
    }
    speech = run_folder.existing_file(run, record.audio) if record.speech_sha256 else None
    body = get_body(video.body, video.look)
    with ResultFolder(request.out) as folder:
        render_row_videos(
            align_and_cap_lengths(motions)[0],
            video,
            body,
            make_point_tracker(video.body, record.tracked_point),
            callbacks.progress_callback("video"),
            folder,
            speech,
            add,
        )
        if len(motions) > 1:
            names = choose_compared_motions(list(motions))[0]
            with composing_comparison_video(names, speech, folder, callbacks, add):
                pass
