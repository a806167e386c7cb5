"""Figure 6 of the GlobalDiff paper for any motions: a fingertip's path beside snapshots.

Left, the trajectory of one point, one axis per coordinate, and its path in space; right, one row of
snapshots per system, all from the same camera. Written as PNG, SVG and PDF. Nothing here knows
where the positions or the pictures come from.

matplotlib is imported at the first figure, and without pyplot: no windows, no global list of
figures. Figures are made one at a time, because matplotlib's settings belong to the process. The
same input gives the same bytes: no dates, a fixed salt for the names inside the SVG.
"""

import os
import threading
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from renderer.figures.figure6.draw import draw_figure6
from renderer.figures.figure6.marks import JointMarks
from renderer.figures.figure6.spec import (
    MAX_SNAPSHOTS,
    MAX_SYSTEMS,
    ONE_SEED_CAVEAT,
    SNAPSHOT_EVERY,
    WINDOW_FRAMES,
    FigureError,
    PostFilter,
    check_figure6,
    choose_snapshot_frames,
)
from renderer.figures.style import PNG_DPI, RC_PARAMS, VECTOR_DPI

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "MAX_SNAPSHOTS",
    "MAX_SYSTEMS",
    "ONE_SEED_CAVEAT",
    "SNAPSHOT_EVERY",
    "WINDOW_FRAMES",
    "FigureError",
    "FigureFiles",
    "JointMarks",
    "choose_snapshot_frames",
    "figure6",
    "matplotlib_settings",
    "write_figure",
]

_MATPLOTLIB_LOCK = threading.RLock()


class FigureFiles(NamedTuple):
    """Where a figure was written."""

    png: Path
    svg: Path
    pdf: Path


def figure6(
    trajectories: Mapping[str, np.ndarray],
    snapshots: Mapping[str, np.ndarray],
    snapshot_frames: Sequence[int],
    fps: float,
    out_stem: Path,
    *,
    reference: str | None = None,
    start_frame: int = 0,
    window_frames: int = WINDOW_FRAMES,
    point: str = "Right middle fingertip",
    tip_source: str = "",
    post_filter: PostFilter = "none",
    clip: str = "",
    caveat: str = ONE_SEED_CAVEAT,
    marks: JointMarks | None = None,
) -> FigureFiles:
    """Write ``<out_stem>.png``, ``.svg`` and ``.pdf``; each appears whole or not at all.

    Args:
        trajectories: name to positions (T, 3) of the point in metres, y up, from the clip's first
            frame. One to six systems, and the reference. Motions of different length are cut to
            the shortest, and the caption says so.
        snapshots: name to pictures (N, H, W, 3) uint8 of one camera, for the same names; empty
            for a figure without pictures. Margins that are empty in all of them are cut off.
        snapshot_frames: the N frames of the clip at which the snapshots were taken, at most 7;
            see :func:`choose_snapshot_frames`.
        fps: frames per second of the trajectories.
        out_stem: path without an extension; its folder is made.
        reference: which of the names is recorded motion; drawn first and in black.
        start_frame: first frame of the window.
        window_frames: longest window; a shorter clip gives a shorter one.
        point: what the trajectories are of, for the title.
        tip_source: where the point sits on the body, such as ``rigid`` or ``vertex 7794``.
        post_filter: the filter that all trajectories have been through; only named here.
        clip: name of the clip, for the caption.
        caveat: last sentence of the caption.
        marks: values at the joints of the snapshots, of the same names; see
            :func:`renderer.video.projection.projected_joints` for where the joints are.

    Raises:
        FigureError: what was given cannot be drawn; one sentence says why.
    """
    contents = check_figure6(
        trajectories,
        snapshots,
        snapshot_frames,
        fps,
        reference=reference,
        start_frame=start_frame,
        window_frames=window_frames,
        point=point,
        tip_source=tip_source,
        post_filter=post_filter,
        clip=clip,
        caveat=caveat,
        marks=marks,
    )
    with matplotlib_settings():
        return write_figure(draw_figure6(contents), out_stem, description=contents.caption)


@contextmanager
def matplotlib_settings() -> Iterator[None]:
    """matplotlib with its defaults and the figures' settings, for one thread at a time."""
    from matplotlib import style

    with _MATPLOTLIB_LOCK, style.context(["default", RC_PARAMS]):
        yield


def write_figure(figure: "Figure", out_stem: Path, description: str) -> FigureFiles:
    """Write a figure in all three formats, without dates; call under ``matplotlib_settings``."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_pdf import FigureCanvasPdf
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    out_stem = Path(out_stem)
    out_stem.parent.mkdir(parents=True, exist_ok=True)
    files = FigureFiles(*(out_stem.with_name(f"{out_stem.name}.{e}") for e in FigureFiles._fields))
    unfinished = FigureFiles(*(_temporary_name(path) for path in files))
    try:
        FigureCanvasAgg(figure).print_figure(
            unfinished.png, dpi=PNG_DPI, metadata={"Description": description}
        )
        FigureCanvasSVG(figure).print_figure(
            unfinished.svg, dpi=VECTOR_DPI, metadata={"Date": None, "Description": description}
        )
        FigureCanvasPdf(figure).print_figure(
            unfinished.pdf, dpi=VECTOR_DPI, metadata={"CreationDate": None, "Subject": description}
        )
        for source, target in zip(unfinished, files, strict=True):
            os.replace(source, target)
    finally:
        for path in unfinished:
            path.unlink(missing_ok=True)
    return files


def _temporary_name(path: Path) -> Path:
    """A free name in the same folder that keeps the extension."""
    return path.with_name(f".{path.stem}.{uuid.uuid4().hex}{path.suffix}")
