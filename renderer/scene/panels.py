"""Close-ups beside a picture: which there are, where they stand, and what is drawn in them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from conventions.joints import FINGERS, JOINT_NAMES
from renderer.body.body import Body

CLOSE_UP_VIEWS: dict[str, tuple[str, ...]] = {
    "face": ("face",),
    "hands": ("right_hand", "left_hand"),
}
"""Views of each close-up from the left to the right: from the front, the right hand is left."""

_DRAWN = {
    "face": ("head", "jaw", "eye", "neck", "spine3", "collar", "shoulder"),
    **{
        f"{side}_hand": tuple(f"{side}_{part}" for part in ("shoulder", "elbow", "wrist", *FINGERS))
        for side in ("left", "right")
    },
}
"""Joints, by parts of their names, whose flesh is drawn: a hand alone is hidden by nothing, and
takes a tenth of the time of a body."""


@dataclass(frozen=True)
class Panel:
    """A rectangle of a picture, in pixels from its upper left corner, and the view shown in it."""

    view: str
    left: int
    top: int
    width: int
    height: int

    @property
    def aspect(self) -> float:
        return self.width / self.height

    @property
    def box(self) -> tuple[slice, slice]:
        """Its rows and columns."""
        return (
            slice(self.top, self.top + self.height),
            slice(self.left, self.left + self.width),
        )


def lay_out(view: str, width: int, height: int, close_ups: Sequence[str]) -> tuple[Panel, ...]:
    """The body, then the close-ups: the face stands above it, the hands below.

    Args:
        width, height: of the body's panel; each close-up adds half a width to the height.

    Raises:
        ValueError: if there is no such close-up.
    """
    unknown = [name for name in close_ups if name not in CLOSE_UP_VIEWS]
    if unknown:
        raise ValueError(
            f"There is no close-up {unknown[0]!r}; choose some of {', '.join(CLOSE_UP_VIEWS)}."
        )
    tall = width // 2 - width // 2 % 2
    above = tall if "face" in close_ups else 0
    panels = [Panel(view, 0, above, width, height)]
    if "face" in close_ups:
        panels.append(Panel("face", 0, 0, width, tall))
    if "hands" in close_ups:
        right, left = CLOSE_UP_VIEWS["hands"]
        top = above + height
        panels.append(Panel(right, 0, top, width // 2, tall))
        panels.append(Panel(left, width // 2, top, width - width // 2, tall))
    return tuple(panels)


@dataclass(frozen=True)
class Cutout:
    """Part of a mesh."""

    vertices: Int[np.ndarray, " N"]
    """Their numbers in the whole mesh."""
    faces: Int[np.ndarray, "F 3"]
    """Among ``vertices``."""


def drawn_joints(view: str) -> list[int]:
    """Joints whose flesh a close-up shows."""
    parts = _DRAWN[view]
    return [j for j, name in enumerate(JOINT_NAMES) if any(part in name for part in parts)]


def cut_out(body: Body, view: str) -> Cutout:
    """The part of a body that a close-up shows."""
    is_kept = np.isin(body.main_joints, drawn_joints(view))
    faces = body.faces[is_kept[body.faces].all(axis=1)]
    vertices = np.unique(faces)
    place = np.zeros(body.num_vertices, np.int32)
    place[vertices] = np.arange(len(vertices), dtype=np.int32)
    return Cutout(vertices, place[faces])
