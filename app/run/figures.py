"""The figures of a run, from motions and their numbers: Figure 6, jitter sheet, error growth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.errors import RunError
from app.findings.sentences import sentences_of
from app.run.followed_point import TipSource
from app.run.output.result_folder import ResultFolder
from app.run.videos.comparison import Snapshots
from conventions.names import REFERENCE_NAME, PostFilter

if TYPE_CHECKING:
    from model.diagnostics import Diagnostics
    from model.motion.motion import Motion


def check_start(start_frame: int, num_frames: int) -> None:
    """Refuse a start of Figure 6 behind the end of the shortest motion, before anything is made.

    Raises:
        RunError: naming the last frame.
    """
    if not 0 <= start_frame < num_frames:
        raise RunError(f"Figure 6 must start at frame 0 to {num_frames - 1}; got {start_frame}.")


def draw_figure6(
    motions: Mapping[str, Motion],
    snapshots: Snapshots,
    tip: TipSource,
    folder: ResultFolder,
    start_frame: int,
    *,
    is_generated: bool,
    post_filter: PostFilter = "none",
    clip: str = "",
    on_piece: Callable[[], None] = lambda: None,
) -> list[Path]:
    """Trajectories of the followed point, with poses where there are any, in all three formats.

    Args:
        motions: as they are shown; the recorded one as `REFERENCE_NAME`.
        is_generated: whether the caption tells that each system was drawn with one seed.
        post_filter: what they have been through.
        clip: name of the speech.
        on_piece: called at least once for each motion; what it raises ends the work.
    """
    from renderer.figures.figure6.figure6 import ONE_SEED_CAVEAT, WINDOW_FRAMES, figure6

    end = start_frame + WINDOW_FRAMES
    files = figure6(
        {name: tip.track(motion, end, on_piece) for name, motion in motions.items()},
        {name: found for name, found in snapshots.pictures.items() if name in motions},
        snapshots.frames,
        30.0,
        folder.path("figure6.png").with_suffix(""),
        reference=REFERENCE_NAME if REFERENCE_NAME in motions else None,
        start_frame=start_frame,
        point=tip.title,
        tip_source=tip.name,
        post_filter=post_filter,
        clip=clip,
        caveat=ONE_SEED_CAVEAT if is_generated else "",
        marks=snapshots.marks.of(motions) if snapshots.marks else None,
    )
    return [folder.path(path.name) for path in files]


def draw_jitter(
    diagnostics: Diagnostics,
    tip: TipSource,
    folder: ResultFolder,
    names: Sequence[str],
    clip: str = "",
) -> list[Path]:
    """The jitter sheet of some systems, with what its numbers say, in all three formats."""
    from renderer.figures.jitter import jitter_sheet

    sentences = sentences_of(diagnostics)
    files = jitter_sheet(
        diagnostics.as_json(),
        folder.path("jitter.png").with_suffix(""),
        names=names,
        point=tip.title.lower(),
        clip=clip,
        sentence=f"{sentences['trajectory']} {sentences['depth']}",
    )
    return [folder.path(path.name) for path in files]


def draw_error_growth(
    growth: Mapping[str, Any], names: Sequence[str], folder: ResultFolder
) -> list[Path]:
    """The experiment on the recorded motion, or on the first where there is none.

    Args:
        growth: the content of ``error_growth.json``.
        names: of the motions in it.
    """
    from renderer.figures.error_growth import error_growth_figure

    name = REFERENCE_NAME if REFERENCE_NAME in names else names[0]
    measured = growth["motions"][name]
    files = error_growth_figure(
        measured,
        folder.path("error_growth.png").with_suffix(""),
        sentence=f"{name}: {measured['sentence']}",
    )
    return [folder.path(path.name) for path in files]
