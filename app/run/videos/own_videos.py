"""Videos of anyone's motion files, laid onto each other and with close-ups."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.run.body_motion import body_motion
from app.run.output.result_folder import ResultFolder
from app.run.requests.display import Display, displayed, marks_of
from app.run.requests.request import Artefact
from app.run.videos.export import render_settings
from app.run.videos.videos import POSTER_SUFFIX, draw_videos, write_poster
from conventions.names import file_stem
from conventions.views import CLOSE_UPS, CloseUp, Framing

if TYPE_CHECKING:
    from app.run.followed_point import TipSource
    from model.motion.motion import Motion
    from renderer.body.body import Body

SOLE_M = 0.05
"""Of the foot joint over the floor; that of recorded clips."""


def in_register(motion: Motion) -> Motion:
    """The same motion, moved and turned about the vertical as a whole: the pelvis is over the
    origin in the median, the lower foot on the floor, and the hips face z on average.

    All bodies are of one size here, whoever moves them.
    """
    import numpy as np
    from scipy.spatial.transform import Rotation

    from model.motion.kinematics import open_body_skeleton

    register = register_of(motion)
    turn = Rotation.from_rotvec([0.0, register.turn_rad, 0.0])
    rest = open_body_skeleton().rest_joints[0].double().numpy()  # the pelvis turns about this
    poses = motion.poses.reshape(len(motion.poses), -1, 3).copy()
    poses[:, 0] = (turn * Rotation.from_rotvec(poses[:, 0])).as_rotvec()
    trans = turn.apply(motion.trans + rest) - rest + np.array(register.shift_m)
    return replace(
        motion, poses=poses.reshape(len(poses), -1), trans=trans.astype(motion.trans.dtype)
    )


@dataclass(frozen=True)
class Register:
    """How a motion is laid onto the others: turned about the world's vertical, then shifted."""

    turn_rad: float
    shift_m: tuple[float, float, float]


def register_of(motion: Motion) -> Register:
    """What `in_register` does to a motion."""
    import numpy as np
    from scipy.spatial.transform import Rotation

    from conventions.joints import JOINT_INDEX
    from model.measures.posture import FEET
    from model.motion.kinematics import open_body_skeleton
    from model.motion.tracks import track_points

    skeleton = open_body_skeleton()
    joints = track_points(motion, skeleton).joints
    across = (joints[:, JOINT_INDEX["left_hip"]] - joints[:, JOINT_INDEX["right_hip"]]).mean(axis=0)
    facing = np.arctan2(-across[2], across[0])  # of the left hip, which is at x for who faces z
    turn = Rotation.from_rotvec([0.0, -facing, 0.0])
    rest = skeleton.rest_joints[0].double().numpy()
    pelvis = np.median(turn.apply(motion.trans + rest), axis=0)
    floor = float(np.median(joints[:, list(FEET), 1].min(axis=1)))
    return Register(float(-facing), (-float(pelvis[0]), SOLE_M - floor, -float(pelvis[2])))


MAX_FRAMES = 10_800
"""Of all videos of a run together: six of one minute."""
OnFile = Callable[[Artefact], None]


@dataclass(frozen=True)
class VideoOptions:
    """How the motions are shown."""

    display: Display = field(default_factory=lambda: Display(has_trail=True))
    size: int = 640
    """Height of the body in pixels."""
    framing: Framing = "knees"
    close_ups: tuple[CloseUp, ...] = CLOSE_UPS


@dataclass(frozen=True)
class Pictured:
    """What is drawn, and what the person should know of it."""

    motions: Mapping[str, Motion]
    """As they stand in the videos, but for exaggeration."""
    notes: tuple[str, ...]


def picture_motions(motions: Mapping[str, Motion]) -> Pictured:
    """The motions in register, cut to what can be drawn in reasonable time."""
    from conventions.rates import FPS
    from model.motion.motion import first_frames

    longest = max(MAX_FRAMES // max(len(motions), 1), 1)
    cut = [name for name, motion in motions.items() if motion.num_frames > longest]
    notes = ()
    if cut:
        notes = (f"Stage and videos show the first {longest / FPS:.0f} s of {', '.join(cut)}.",)
    return Pictured(
        {
            name: in_register(first_frames(motion, min(motion.num_frames, longest)))
            for name, motion in motions.items()
        },
        notes,
    )


def draw_own_videos(
    motions: Mapping[str, Motion],
    options: VideoOptions,
    body: Body,
    body_path: Path | None,
    tip: TipSource,
    speech: Path | None,
    folder: ResultFolder,
    on_share: Callable[[float], None],
    on_file: OnFile,
) -> None:
    """A video of each motion, under one camera; each file is told of as soon as it is whole.

    Args:
        motions: as `picture_motions` gives them.
        on_share: told the share of all frames done; what it raises ends the work.

    Raises:
        BodyError, GLError, VideoError: see `app.run.videos.videos.draw_videos`.
    """
    from renderer.video.render import stage_for
    from renderer.video.worker_process import RenderJob

    settings = render_settings(
        "front", options.size, close_ups=options.close_ups, framing=options.framing
    )
    posed = [body_motion(motion) for motion in motions.values()]
    stage = stage_for(body, posed, settings)
    jobs: dict[str, Any] = {}
    for name, motion in motions.items():
        jobs[name] = RenderJob(
            motion=body_motion(displayed(motion, options.display)),
            out=folder.path(f"{file_stem(name)}.mp4"),
            speech_wav=speech,
            settings=settings,
            body_path=body_path,
            stage=stage,
            marks=marks_of(motion, options.display, tip, body),
        )

    def on_done(name: str) -> None:
        poster = folder.path(f"shown/{file_stem(name)}{POSTER_SUFFIX}")
        write_poster(jobs[name].out, poster)
        on_file(Artefact("poster", name, poster))
        on_file(Artefact("video", name, jobs[name].out))

    draw_videos(
        jobs,
        on_progress=on_share,
        on_done=on_done,
        should_cancel=lambda: False,  # on_share ends it
    )
