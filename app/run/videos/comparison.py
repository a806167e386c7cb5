"""Pictures of motions: a video of each, all side by side, and Figure 6's poses with their jerk."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING

import numpy as np

from app.run.body_motion import body_motion
from app.run.models import get_body
from app.run.output.result_folder import ResultFolder
from app.run.output.telling import Reporter
from app.run.requests.display import displayed, marks_of
from app.run.requests.request import Ask
from app.run.rows import Rows
from app.run.videos.export import render_settings
from app.run.videos.own_videos import in_register
from app.run.videos.videos import POSTER_SUFFIX, draw_videos, write_poster
from conventions.names import file_stem

if TYPE_CHECKING:
    import numpy as np

    from model.motion.motion import Motion
    from renderer.body.body import Body, BodyMotion
    from renderer.figures.figure6.spec import JointMarks
    from renderer.scene.stage import Stage
    from renderer.video.settings import RenderSettings

AROUND_FRAMES = 8
"""Jerk of one frame is chance; the mean over about half a second around a snapshot is told."""
LEAST_FULL_SCALE = 500.0
"""In m/s³. Recorded speakers reach this with a hand in quick gestures: what is smooth stays pale,
however smooth the other motions are."""
_PERCENTILE = 98.0


def jerk_marks(
    body: Body,
    motions: Mapping[str, BodyMotion],
    frames: Sequence[int],
    settings: RenderSettings,
    stage: Stage,
) -> JointMarks:
    """Marks for the snapshots of these motions at some frames, all on one scale.

    The full scale is a round number that nearly all values stay under.
    """
    from renderer.figures.figure6.spec import JointMarks
    from renderer.video.render import projected_joints

    values = {name: _jerk_around(body, motion, frames) for name, motion in motions.items()}
    highest = float(np.percentile(np.concatenate(list(values.values())), _PERCENTILE))
    return JointMarks(
        pixels={
            name: projected_joints(body, motion, frames, settings, stage)
            for name, motion in motions.items()
        },
        values=values,
        full_scale=_round_up(max(highest, LEAST_FULL_SCALE)),
    )


def _jerk_around(body: Body, motion: BodyMotion, frames: Sequence[int]) -> np.ndarray:
    """Mean jerk of each joint around each frame, (N, J) in m/s³; 0 in a clip under 4 frames."""
    from model.measures.smoothness import derivative_magnitudes
    from renderer.scene.stage import frames_of

    found = []
    for frame in frames:
        near = slice(max(0, frame - AROUND_FRAMES), frame + AROUND_FRAMES + 1)
        jerk = derivative_magnitudes(body.joint_positions(frames_of(motion, near)), 3)
        found.append(jerk.mean(axis=0) if len(jerk) else np.zeros(jerk.shape[1]))
    return np.stack(found)


def _round_up(value: float) -> float:
    """The next of 1, 2 and 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value))


STILL_SIZE_PX = 512
_POLL_S = 0.1


@dataclass(frozen=True)
class Snapshots:
    """Poses for Figure 6: the frames, and by name the pictures (N, H, W, 3)."""

    frames: tuple[int, ...] = ()
    pictures: dict[str, np.ndarray] = field(default_factory=dict)
    marks: JointMarks | None = None
    """How much each joint jerks around each of the frames; None without pictures."""


def draw_all(ask: Ask, rows: Rows, folder: ResultFolder, reporter: Reporter) -> Snapshots:
    """A video for each row and view, all bodies in register; the poses for Figure 6, from the first
    view, are taken on the way where videos show the same, and drawn apart where they do not.

    Raises:
        CancelledRun, BodyError, GLError, VideoError: see `app.run.videos.videos.draw_videos`.
    """
    from renderer.figures.figure6.spec import choose_snapshot_frames
    from renderer.video.render import stage_for
    from renderer.video.worker_process import RenderJob

    reporter.progress("video", 0.0)
    placed = {name: in_register(motion) for name, motion in rows.staged.items()}
    motions = {name: body_motion(motion) for name, motion in placed.items()}
    drawn = {name: body_motion(displayed(motion, ask.display)) for name, motion in placed.items()}
    marks = {
        name: marks_of(motion, ask.display, rows.tip, rows.body) for name, motion in placed.items()
    }
    shortest = min(motion.num_frames for motion in motions.values())
    frames = ask.figure.frames or choose_snapshot_frames(shortest, ask.start_frame)
    has_poses = ask.display.is_plain and ask.framing == "whole"
    jobs: dict[str, RenderJob] = {}
    named: dict[str, str] = {}
    for view in ask.views:
        is_main = view == ask.views[0]
        close_ups = ask.close_ups if is_main else ()
        settings = render_settings(view, ask.size, close_ups=close_ups, framing=ask.framing)
        # As for the motions themselves: exaggerated ones stand before the same camera.
        stage = stage_for(rows.body, list(motions.values()), settings)
        for name, motion in drawn.items():
            file_name = file_stem(name) + ("" if is_main else f".{view}") + ".mp4"
            named[file_name] = name
            jobs[file_name] = RenderJob(
                motion=motion,
                out=folder.path(file_name),
                speech_wav=rows.sound,
                settings=settings,
                body_path=ask.body,
                look=ask.look,
                stage=stage,
                marks=marks[name],
                still_frames=frames if is_main and has_poses else (),
            )
    plain = render_settings(ask.views[0], ask.size)
    plain_stage = stage_for(rows.body, list(motions.values()), plain)
    if not has_poses:
        jobs |= {
            f"poses of {name}": RenderJob(
                motion=motion,
                settings=plain,
                body_path=ask.body,
                look=ask.look,
                stage=plain_stage,
                still_frames=frames,
            )
            for name, motion in motions.items()
        }
    results = draw_videos(
        jobs,
        on_progress=lambda part: reporter.progress("video", part),
        on_done=lambda job: _tell_of_video(job, named, folder, reporter),
        should_cancel=reporter.should_cancel,
    )
    reporter.progress("video", 1.0)
    if has_poses:
        main = render_settings(ask.views[0], ask.size, close_ups=ask.close_ups)
        box = main.panels[0].box
        pictures = {name: results[f"{file_stem(name)}.mp4"].stills[:, *box] for name in motions}
    else:
        pictures = {name: results[f"poses of {name}"].stills for name in motions}
    of_joints = jerk_marks(rows.body, motions, frames, plain, plain_stage)
    return Snapshots(frames, pictures, of_joints)


def _tell_of_video(
    job: str,
    named: Mapping[str, str],
    folder: ResultFolder,
    reporter: Reporter,
) -> None:
    if job not in named:
        return
    video = folder.path(job)
    poster = folder.path(f"shown/{video.with_suffix(POSTER_SUFFIX).name}")
    write_poster(video, poster)
    reporter.file("poster", named[job], poster)
    reporter.file("video", named[job], video)


@contextmanager
def joined_side_by_side(
    names: Sequence[str], wav: Path | None, folder: ResultFolder, reporter: Reporter
) -> Iterator[None]:
    """The videos of these rows in lock-step under one sound track, made by ffmpeg while the block
    does something else; whole when it is left.

    Raises on leaving:
        Cancelled, VideoError: see `renderer.video.compose.compose_videos`.
    """
    from renderer.video.compose import compose_videos

    reporter.progress("comparison", 0.0)
    out = folder.path("comparison.mp4")
    done, is_given_up = [0.0], Event()
    with ThreadPoolExecutor(1) as beside:
        joining = beside.submit(
            compose_videos,
            [folder.at(f"{file_stem(name)}.mp4") for name in names],
            names,
            out,
            wav,
            on_progress=done.append,
            should_cancel=lambda: is_given_up.is_set() or reporter.should_cancel(),
        )
        try:
            yield
            while not joining.done():
                reporter.progress("comparison", done[-1])
                wait([joining], timeout=_POLL_S)
        except BaseException:
            is_given_up.set()
            raise
    joining.result()
    reporter.file("comparison", "comparison", out)
    reporter.progress("comparison", 1.0)


def draw_poses(
    motions: Mapping[str, Motion],
    body_path: Path | None,
    frames: tuple[int, ...],
    on_share: Callable[[float], None],
) -> Snapshots:
    """Poses for Figure 6 without videos, all from one camera.

    Args:
        on_share: told the share of all pictures done; what it raises ends the work.

    Raises:
        BodyError, GLError: see `app.run.videos.videos.draw_videos`.
    """
    from renderer.scene.stage import set_stage
    from renderer.video.worker_process import RenderJob

    body = get_body(body_path)
    posed = {name: body_motion(motion) for name, motion in motions.items()}
    settings = render_settings("front", STILL_SIZE_PX)
    stage = set_stage(body, list(posed.values()))
    jobs = {
        name: RenderJob(
            motion, settings=settings, body_path=body_path, stage=stage, still_frames=frames
        )
        for name, motion in posed.items()
    }
    results = draw_videos(
        jobs,
        on_progress=on_share,
        on_done=lambda name: None,
        should_cancel=lambda: False,  # on_share ends it
    )
    return Snapshots(
        frames,
        {name: result.stills for name, result in results.items()},
        jerk_marks(body, posed, frames, settings, stage),
    )
