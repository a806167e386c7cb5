"""Two speeches by two noise seeds: a system's four bodies in one picture, under either speech.

Under the sound of one speech, the two bodies that were made of it should fit and the two others
should not; where a system is deaf, the bodies of one seed move alike instead.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from app.run.body_motion import body_motion
from app.run.models import get_body
from app.run.output.result_folder import ResultFolder
from app.run.videos.export import render_settings
from app.run.videos.register import in_register
from app.run.videos.videos import draw_videos
from conventions.names import file_stem

if TYPE_CHECKING:
    from model.measures.hearing import Grid
    from model.speech.audio import Speech

SHOWN_S = 20.0
SIZE_PX = 480
EACH_WAY = 2
"""Speeches and seeds that are shown."""


def draw_hearing_videos(
    grids: Mapping[str, Grid],
    speeches: Mapping[str, Speech],
    folder: ResultFolder,
    on_share: Callable[[float], None],
) -> None:
    """``SYSTEM__SPEECH.mp4`` for each system and each of the first two speeches, of which it has
    the sound.

    Args:
        grids: by system, motions by speech and seed.
        on_share: told the share of all frames done; what it raises ends the work.

    Raises:
        BodyError, GLError, VideoError: see `app.run.videos.videos.draw_videos`.
    """
    from conventions.rates import FPS
    from model.motion.motion import first_frames
    from model.speech.audio import SAMPLE_RATE, write_wav
    from renderer.video.compose import compose_videos
    from renderer.video.frames import stage_for
    from renderer.video.pool import RenderJob

    names = list(speeches)[:EACH_WAY]
    seconds = min(SHOWN_S, *(speeches[name].duration_s for name in names))
    posed = {}
    for system, grid in grids.items():
        for (speech, seed), motion in grid.items():
            if speech in names and seed < EACH_WAY:
                shown = first_frames(motion, min(motion.num_frames, round(seconds * FPS)))
                posed[system, speech, seed] = body_motion(in_register(shown))
    settings = render_settings("front", SIZE_PX, framing="knees")
    stage = stage_for(get_body(None), list(posed.values()), settings)
    drawn = folder.scratch("bodies")
    drawn.mkdir()
    files = {
        (system, speech, seed): drawn / f"{file_stem(system)}__{speech}__{seed}.mp4"
        for system, speech, seed in posed
    }
    jobs = {
        files[key].stem: RenderJob(motion, files[key], settings=settings, stage=stage)
        for key, motion in posed.items()
    }
    draw_videos(jobs, on_share, on_done=lambda name: None, should_cancel=lambda: False)
    for sounding in names:
        sound = drawn / f"{sounding}.wav"
        write_wav(sound, speeches[sounding].waveform[: round(seconds * SAMPLE_RATE)])
        for system in grids:
            own = {key: path for key, path in files.items() if key[0] == system}
            labels = [f"{speech}, seed {seed}" for _, speech, seed in own]
            out = folder.path(f"{file_stem(system)}__{sounding}.mp4")
            compose_videos(list(own.values()), labels, out, sound)
