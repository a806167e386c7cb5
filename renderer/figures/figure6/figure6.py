"""Figure 6 of the GlobalDiff paper for any motions: a fingertip's path beside snapshots.

Left, the trajectory of one point, one axis per coordinate, and its path in space; right, one row of
snapshots per system, all from the same camera. Nothing here knows where the positions or the
pictures come from.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from conventions.names import PostFilter
from renderer.figures.figure6.draw import draw_figure6
from renderer.figures.figure6.marks import JointMarks
from renderer.figures.figure6.spec import (
    ONE_SEED_CAVEAT,
    WINDOW_FRAMES,
    check_figure6,
    choose_snapshot_frames,
)
from renderer.figures.files import FigureFiles, matplotlib_settings, write_figure

__all__ = ["WINDOW_FRAMES", "JointMarks", "choose_snapshot_frames", "figure6"]


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
