"""Where the fingertip is: the rigid tip of the open skeleton, or a vertex of a licensed body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.rendering import body_motion

if TYPE_CHECKING:
    from model.motion import Motion
    from renderer.body import Body

TIP = "right_middle"
TIP_TITLE = "Right middle fingertip"
TIP_VERTEX = 7794
"""Of SMPL-X: its output joint 73."""

TipTrack = Callable[["Motion"], np.ndarray]


@dataclass(frozen=True)
class TipSource:
    """How the tip of the figure and the diagnostics is found."""

    name: str
    """As `diagnostics.json` tells it."""
    track: TipTrack
    """Motion -> positions (T, 3) in metres."""


def choose_tip_source(body: Body, body_path: Path | None) -> TipSource:
    """The rigid tip with the open body, the tip vertex with a licensed one."""
    if body_path is None:
        return TipSource("rigid", rigid_tip)
    return TipSource(f"vertex {TIP_VERTEX}", lambda motion: vertex_tip(body, motion))


def rigid_tip(motion: Motion) -> np.ndarray:
    """The last finger joint plus its rotated offset, (T, 3) metres."""
    from model.diagnostics import track_points
    from model.skeleton import FINGERTIP_NAMES, open_body_skeleton

    tracks = track_points(motion, open_body_skeleton())
    return tracks.fingertips[:, FINGERTIP_NAMES.index(TIP)]


def vertex_tip(body: Body, motion: Motion) -> np.ndarray:
    """The tip vertex of a posed body, (T, 3) metres."""
    chunks = body.vertices(body_motion(motion))
    return np.concatenate([chunk[:, TIP_VERTEX] for chunk in chunks])
