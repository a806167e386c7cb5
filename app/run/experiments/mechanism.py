"""The paper's argument on a body, apart from any training: equal noise on local and on global
rotations of one motion, two bodies in lock-step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from pandas import DataFrame

from app.errors import RunError
from app.run.ask import TIP, OnEvent, ShouldCancel
from app.run.display import Display
from app.run.followed_point import choose_tip_source
from app.run.models import get_body
from app.run.output.run_folder import RunRecord
from app.run.run_writer import RunWriter, writing_run
from app.run.tasks import VIDEO, MechanismAsk
from app.run.videos.videos import jobs_of
from model.formats.read import read_any_motion
from model.measures.error_growth import ErrorGrowth, growth_sentence, measure_error_growth
from model.motion.altered import noisy_motions
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion
from model.motion.tracks import moving_chain
from model.speech.transcript import NOTHING_SAID
from renderer.figures.curves import draw_error_growth
from renderer.video.compose import compose_videos
from renderer.video.workers import draw_jobs

NAMES: tuple[str, str] = ("local noise", "global noise")
"""Of the two bodies: where the noise is."""
DRAWN = "Noise of {noise:g} rad: left on local rotations, right on global ones."
_DRAWN = 0.85
"""Share of the work that is done when both bodies are drawn."""


def show_mechanism(
    ask: MechanismAsk,
    on_event: OnEvent = lambda event: None,
    should_cancel: ShouldCancel = lambda: False,
) -> None:
    """Move two bodies, leave both for a player with what the noise does, and draw them beside each
    other where a video is asked for.

    Raises:
        Cancelled: when ``should_cancel`` said so.
        RunError, MotionError, BodyError, GLError, VideoError: each with one sentence.
    """
    ask.check()
    (motion,) = ask.motions
    if not moving_chain(ask.joint):
        raise RunError(f"No rotation moves the {ask.joint}; follow a joint further from it.")
    ask.told.check([motion])
    found = read_any_motion(motion, ask.told, ask.body)
    growth = measure_error_growth(
        found.motion, open_body_skeleton(), ask.joint, ask.noise_rad, seed=ask.seed
    )
    noisy = dict(zip(NAMES, noisy_motions(found.motion, ask.noise_rad, ask.seed), strict=True))
    record = RunRecord(kind="given", point=TIP)
    with writing_run(ask.out, record, on_event, should_cancel, is_kept=ask.is_kept) as run:
        tip = choose_tip_source(ask.body, TIP)
        run.note(*found.notes, *_told(growth, ask.noise_rad))
        run.timeline(run.show(noisy, None, tip), NOTHING_SAID)
        _draw_growth(ask, growth, run)
        if ask.has_video:
            _draw(ask, found.motion, noisy, run)
        run.finish(DRAWN.format(noise=ask.noise_rad))


def _draw_growth(ask: MechanismAsk, growth: ErrorGrowth, run: RunWriter) -> None:
    """How far points along the chain are moved."""
    spreads = DataFrame(
        {
            "point": growth.points,
            "local": growth.local_spread_m,
            "global": growth.global_spread_m,
            "predicted_local": growth.predicted_local_spread_m,
            "predicted_global": growth.predicted_global_spread_m,
        }
    )
    said = growth_sentence(growth, ask.noise_rad)
    run.figure("error_growth", lambda: draw_error_growth(spreads), said)


def _draw(ask: MechanismAsk, clean: Motion, noisy: Mapping[str, Motion], run: RunWriter) -> None:
    body = get_body(ask.body)
    tip = choose_tip_source(ask.body, ask.joint)
    seen = replace(ask, display=Display(has_trail=True))
    drawn = run.folder.scratch("bodies")
    drawn.mkdir()
    paths = {name: drawn / f"{number}.mp4" for number, name in enumerate(noisy)}

    def out(name: str, _: object) -> Path:
        return paths[name]

    # The noise moves no camera.
    jobs = jobs_of(noisy, seen, body, tip, out, staged=[clean])
    draw_jobs(jobs, run.share("video", _DRAWN))
    video = run.folder.path(VIDEO)
    compose_videos(
        list(paths.values()),
        [f"{ask.noise_rad:g} rad of noise on {name}" for name in noisy],
        video,
        ask.speech,
        on_progress=run.share("video", 1.0 - _DRAWN, _DRAWN),
    )
    run.file(video)


def _told(growth: ErrorGrowth, noise_rad: float) -> Iterator[str]:
    """What the experiment shows, and what it does not."""
    jerk = growth.jerk_m_s3
    yield growth_sentence(growth, noise_rad)
    yield (
        f"Its jerk is {jerk['local']:.0f} m/s³ with noise on local rotations, {jerk['global']:.0f} "
        f"on global ones and {jerk['clean']:.0f} without noise."
    )
    yield (
        "Equal noise is an assumption: how much a trained network errs in either form has to be "
        "measured."
    )
