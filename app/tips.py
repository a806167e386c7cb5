"""The point that is followed: a fingertip, rigid or a vertex of a licensed body, or any joint."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.errors import RunError
from app.rendering import body_motion
from renderer.smplx_joints import TIP_VERTICES

if TYPE_CHECKING:
    from model.motion import Motion
    from renderer.body import Body

TIP = "right_middle"

TipTrack = Callable[["Motion"], np.ndarray]


@dataclass(frozen=True)
class TipSource:
    """How the point that the figure and the diagnostics follow is found."""

    name: str
    """As `diagnostics.json` tells it."""
    track: TipTrack
    """Motion -> positions (T, 3) in metres."""
    point: str = TIP
    """A fingertip or a joint of SMPL-X."""

    @property
    def title(self) -> str:
        return point_title(self.point)


def choose_tip_source(body: Body, body_path: Path | None, point: str = TIP) -> TipSource:
    """A fingertip, rigid with the open body and a vertex of a licensed one; or any joint.

    Raises:
        RunError: if there is no such point, with the points there are.
    """
    from model.skeleton import JOINT_INDEX

    if point in JOINT_INDEX:
        joint = JOINT_INDEX[point]
        if body_path is None:
            return TipSource("joint", lambda motion: open_joint(motion, joint), point)
        return TipSource("joint of the body", lambda motion: body_joint(body, motion, joint), point)
    if point not in TIP_VERTICES:
        raise RunError(
            f"There is no point {point!r} to follow; choose a fingertip ({', '.join(TIP_VERTICES)})"
            f" or a joint of SMPL-X, such as right_wrist or {TIP}3."
        )
    if body_path is None:
        return TipSource("rigid", lambda motion: rigid_tip(motion, point), point)
    vertex = TIP_VERTICES[point]
    return TipSource(f"vertex {vertex}", lambda motion: vertex_tip(body, motion, vertex), point)


def point_title(point: str) -> str:
    """A point's name for a person: ``right_middle`` is the 'Right middle fingertip'."""
    words = re.sub(r"(\d)$", r" joint \1", point).replace("_", " ").capitalize()
    if point not in TIP_VERTICES:
        return words
    return f"{words} tip" if point.endswith("thumb") else f"{words} fingertip"


def rigid_tip(motion: Motion, tip: str = TIP) -> np.ndarray:
    """The last finger joint plus its rotated offset, (T, 3) metres."""
    from model.diagnostics import track_points
    from model.skeleton import FINGERTIP_NAMES, open_body_skeleton

    tracks = track_points(motion, open_body_skeleton())
    return tracks.fingertips[:, FINGERTIP_NAMES.index(tip)]


def vertex_tip(body: Body, motion: Motion, vertex: int) -> np.ndarray:
    """A vertex of a posed body, (T, 3) metres."""
    return np.concatenate([chunk[:, vertex] for chunk in body.vertices(body_motion(motion))])


def open_joint(motion: Motion, joint: int) -> np.ndarray:
    """A joint of the open skeleton, (T, 3) metres."""
    from model.diagnostics import track_points
    from model.skeleton import open_body_skeleton

    return track_points(motion, open_body_skeleton()).joints[:, joint]


def body_joint(body: Body, motion: Motion, joint: int) -> np.ndarray:
    """A joint of a body of its own shape, (T, 3) metres."""
    return body.joint_positions(body_motion(motion))[:, joint]
