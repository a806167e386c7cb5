"""The paper's argument on a body, apart from any training: equal noise on local and on global
rotations of one motion, two bodies in lock-step."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from app.errors import RunError
from app.run.followed_point import TIP, choose_tip_source
from app.run.models import get_body
from app.run.output.result_folder import ResultFolder
from app.run.output.run_folder import RunRecord
from app.run.output.telling import share_teller
from app.run.requests.display import Display
from app.run.requests.request import Ask, OnEvent, ShouldCancel
from app.run.run_writer import RunWriter
from app.run.videos.videos import VideoOptions, draw_videos, jobs_of
from model.speech.transcript import NOTHING_SAID

if TYPE_CHECKING:
    from model.measures.error_growth import ErrorGrowth
    from model.motion.motion import Motion

NAMES: tuple[str, str] = ("local rotations", "global rotations")
"""Of the two bodies: where the noise is."""
NOISE_RAD = (0.005, 0.1)
"""Least and most noise that may be asked for."""
_DRAWN = 0.85
"""Share of the work that is done when both bodies are drawn."""


@dataclass(frozen=True, kw_only=True)
class MechanismAsk:
    """Equal noise on one motion."""

    ask: Ask
    """Of one motion, to an mp4."""
    noise_rad: float = 0.02
    """Deviation of the random turns about each axis."""
    played: Path | None = None
    """Where both motions are left as a run, for a player."""


def show_mechanism(
    asked: MechanismAsk,
    on_event: OnEvent = lambda event: None,
    should_cancel: ShouldCancel = lambda: False,
) -> tuple[Path | None, tuple[str, ...]]:
    """Move two bodies, measure what the noise does, and draw them beside each other.

    Returns:
        The video, where one was asked for, and what the bodies show in sentences.

    Raises:
        CancelledRun: when ``should_cancel`` said so.
        RunError, MotionError, BodyError, GLError, VideoError: each with one sentence.
    """
    from model.formats.read import read_any_motion
    from model.measures.error_growth import measure_error_growth
    from model.motion.altered import noisy_motions
    from model.motion.kinematics import open_body_skeleton
    from model.motion.tracks import moving_chain

    _check(asked)
    ask = asked.ask
    (motion,) = ask.motions
    if not moving_chain(ask.joint):
        raise RunError(f"No rotation moves the {ask.joint}; follow a joint further from it.")
    ask.told.check([motion])
    found = read_any_motion(motion, ask.told, ask.body)
    growth = measure_error_growth(
        found.motion, open_body_skeleton(), ask.joint, asked.noise_rad, seed=ask.seed
    )
    on_local, on_global = noisy_motions(found.motion, asked.noise_rad, ask.seed)
    noisy: dict[str, Motion] = dict(zip(NAMES, (on_local, on_global), strict=True))
    if asked.played is not None:
        _play(asked, asked.played, noisy, growth, on_event)
    if ask.has_video:
        on_share = share_teller("video", on_event, should_cancel)
        _draw(ask, asked.noise_rad, found.motion, noisy, on_share)
    sentences = (*found.notes, *_told(growth, asked.noise_rad))
    return ask.out if ask.has_video else None, sentences


def _play(
    asked: MechanismAsk,
    out: Path,
    noisy: Mapping[str, Motion],
    growth: ErrorGrowth,
    on_event: OnEvent,
) -> None:
    """Both bodies, then how far points along the chain are moved, as a figure."""
    from pandas import DataFrame

    from model.measures.error_growth import growth_sentence
    from renderer.figures.curves import error_growth_figure

    ask = asked.ask
    tip = choose_tip_source(get_body(ask.body), ask.body, TIP)
    record = RunRecord(kind="given", point=TIP)
    with ResultFolder(out, is_kept=True) as folder, RunWriter(folder, record, on_event) as run:
        run.timeline(run.show(noisy, None, tip), NOTHING_SAID)
        spreads = DataFrame(
            {
                "point": growth.points,
                "local": growth.local_spread_m,
                "global": growth.global_spread_m,
                "predicted_local": growth.predicted_local_spread_m,
                "predicted_global": growth.predicted_global_spread_m,
            }
        )
        stem = folder.path("error_growth.png").with_suffix("")
        files = error_growth_figure(spreads, stem, growth_sentence(growth, asked.noise_rad))
        run.files("figure", [folder.path(path.name) for path in files])
        run.finish("")


def _draw(
    ask: Ask,
    noise_rad: float,
    clean: Motion,
    noisy: Mapping[str, Motion],
    on_progress: Callable[[float], None],
) -> None:
    from renderer.video.compose import compose_videos

    body = get_body(ask.body)
    tip = choose_tip_source(body, ask.body, ask.joint)
    options = VideoOptions(Display(has_trail=True), ask.size, "knees", ("hands",))
    with tempfile.TemporaryDirectory() as folder:
        jobs = jobs_of(
            *(noisy, options, body, ask.body, tip),
            lambda name, _: Path(folder, f"{list(noisy).index(name)}.mp4"),
            staged=[clean],  # the noise moves no camera
        )
        draw_videos(jobs, lambda part: on_progress(_DRAWN * part))
        compose_videos(
            [Path(folder, f"{number}.mp4") for number in range(len(jobs))],
            [f"{noise_rad:g} rad of noise on {name}" for name in noisy],
            ask.out,
            ask.speech,
            on_progress=lambda part: on_progress(_DRAWN + (1.0 - _DRAWN) * part),
        )


def _check(asked: MechanismAsk) -> None:
    ask, (least, most) = asked.ask, NOISE_RAD
    if not least <= asked.noise_rad <= most:
        raise RunError(f"Noise must be {least:g} to {most:g} rad; got {asked.noise_rad:g}.")
    if len(ask.motions) != 1:
        raise RunError(f"One motion is shown; got {len(ask.motions)}.")
    if ask.seed < 0:
        raise RunError(f"The seed must not be negative; got {ask.seed}.")
    if ask.out.suffix.lower() != ".mp4":
        raise RunError(f"{ask.out.name} must end in .mp4.")
    if not ask.out.parent.is_dir():
        raise RunError(f"The folder {ask.out.parent} does not exist; create it first.")


def _told(growth: ErrorGrowth, noise_rad: float) -> list[str]:
    """What the experiment shows, and what it does not."""
    from model.measures.error_growth import growth_sentence

    jerk = growth.jerk_m_s3
    return [
        growth_sentence(growth, noise_rad),
        f"Its jerk is {jerk['local']:.0f} m/s³ with noise on local rotations, {jerk['global']:.0f} "
        f"on global ones and {jerk['clean']:.0f} without noise.",
        "Equal noise is an assumption: how much a trained network errs in either form has to be "
        "measured.",
    ]
