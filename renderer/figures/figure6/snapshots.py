"""Snapshots cut alike, with soft marks on joints: the larger and darker, the larger the value
there.

A mark has a dark core in a white rim, so that it is seen on a light and on a dark body, in colour
and in a greyscale print.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, UInt8

_MARGIN = 0.03  # around the content, as a share of its longer side


def crop_alike(
    snapshots: dict[str, UInt8[np.ndarray, "N H W 3"]], tolerance: int = 10
) -> dict[str, UInt8[np.ndarray, "N h w 3"]]:
    """Every picture cut to one size; the cut is at one place in all pictures of a frame.

    So bodies keep their size everywhere and their place among the systems, while one who walks
    stays in the middle from frame to frame. The size is what the largest frame needs. The
    background is what pictures show at their left and right edge, row by row: a plain wall, a
    vertical gradient and a plain floor all count as empty. Empty pictures keep their whole frame.

    Args:
        tolerance: largest difference from the background, of 255, that still counts as empty.
    """
    has_content = _content(list(snapshots.values()), tolerance)
    top, bottom = _extents(np.asarray(has_content.any(axis=2)))
    left, right = _extents(np.asarray(has_content.any(axis=1)))
    _, height, width = has_content.shape
    margin = 1 + round(_MARGIN * max(np.max(bottom - top), np.max(right - left)))
    rows = _windows(top, bottom, margin, height)
    columns = _windows(left, right, margin, width)
    return {
        name: np.stack(
            [picture[r, c] for picture, r, c in zip(pictures, rows, columns, strict=True)]
        )
        for name, pictures in snapshots.items()
    }


def _content(
    stacks: list[UInt8[np.ndarray, "N H W 3"]], tolerance: int
) -> Bool[np.ndarray, "N H W"]:
    """Where at least one system's picture of a frame differs from the background."""
    edges = np.stack([stack[:, :, [0, -1]] for stack in stacks])  # (systems, N, H, 2, 3)
    background = np.median(edges, axis=(0, 1, 3)).astype(np.int16)[None, :, None]
    has_content = np.zeros(stacks[0].shape[:3], dtype=bool)
    for stack in stacks:
        has_content |= (np.abs(stack - background) > tolerance).any(axis=-1)
    return has_content


def _extents(has_content: Bool[np.ndarray, "N L"]) -> tuple[np.ndarray, np.ndarray]:
    """First and one past the last place with content, per frame; all of it where there is none."""
    length = has_content.shape[1]
    is_empty = ~has_content.any(axis=1)
    first = np.where(is_empty, 0, has_content.argmax(axis=1))
    end = np.where(is_empty, length, length - has_content[:, ::-1].argmax(axis=1))
    return first, end


def _windows(first: np.ndarray, end: np.ndarray, margin: int, length: int) -> list[slice]:
    """Windows of one size around the content, moved where they would leave the picture."""
    size = min(length, int((end - first).max()) + 2 * margin)
    starts = np.clip((first + end - size) // 2, 0, length - size)
    return [slice(int(start), int(start) + size) for start in starts]


CORE_RGB = (74.0, 20.0, 110.0)
RADIUS = 0.022
"""Of the core of the strongest mark, as a share of the picture's height."""
_FAINTEST = 0.12
"""Share of the full scale below which nothing is drawn: every joint of a moving body has some."""
_OPACITY = 0.9
_RIM = 1.45  # radius of the rim over that of the core
_SOFTNESS = 0.25  # of a radius, over which an edge fades


@dataclass(frozen=True)
class JointMarks:
    """A value for each joint in each snapshot, and where the joint is in it."""

    pixels: Mapping[str, np.ndarray]
    """By name, (N, J, 2) pixels from the upper left corner; NaN draws nothing."""
    values: Mapping[str, np.ndarray]
    """By name, (N, J) in ``unit``; NaN draws nothing."""
    full_scale: float
    """Value of the strongest mark; larger ones look the same."""
    quantity: str = "jerk"
    unit: str = "m/s³"

    def of(self, names: Iterable[str]) -> "JointMarks":
        """The marks of some of the names."""
        names = list(names)
        return replace(
            self,
            pixels={name: self.pixels[name] for name in names},
            values={name: self.values[name] for name in names},
        )

    @property
    def caption(self) -> str:
        return (
            f"Marks: {self.quantity} of each joint around the frame, largest and darkest at"
            f" {self.full_scale:g} {self.unit} and above, none below"
            f" {_FAINTEST * self.full_scale:g} {self.unit}."
        )


def mark_joints(
    pictures: UInt8[np.ndarray, "N H W 3"],
    pixels: Float[np.ndarray, "N J 2"],
    severity: Float[np.ndarray, "N J"],
    radius: float = RADIUS,
) -> UInt8[np.ndarray, "N H W 3"]:
    """The pictures with their marks; the strongest are drawn last.

    Args:
        severity: 0 to 1; beyond 1 as 1.
        radius: of the core of the strongest mark, as a share of the picture's height.
    """
    marked = pictures.astype(np.float32)
    known = np.clip(np.nan_to_num(severity), 0.0, 1.0)
    for picture, places, strengths in zip(marked, pixels, known, strict=True):
        for joint in np.argsort(strengths):
            strength = float(strengths[joint])
            if strength >= _FAINTEST and np.isfinite(places[joint]).all():
                _mark(picture, places[joint], strength, radius * picture.shape[0])
    return np.rint(marked).astype(np.uint8)


def _mark(picture: np.ndarray, place: np.ndarray, strength: float, largest: float) -> None:
    """Blend one mark into a picture (H, W, 3) of float32, in place."""
    height, width = picture.shape[:2]
    radius = largest * (0.45 + 0.55 * strength)
    reach = int(np.ceil(_RIM * radius * (1.0 + _SOFTNESS)))
    x, y = (round(float(c)) for c in place)
    rows = slice(max(0, y - reach), min(height, y + reach + 1))
    columns = slice(max(0, x - reach), min(width, x + reach + 1))
    if rows.start >= rows.stop or columns.start >= columns.stop:
        return
    grid_y, grid_x = np.mgrid[rows, columns]
    distance = np.hypot(grid_x + 0.5 - place[0], grid_y + 0.5 - place[1])
    patch = picture[rows, columns]
    for size, colour in ((_RIM * radius, (255.0, 255.0, 255.0)), (radius, CORE_RGB)):
        inside = np.clip((size - distance) / (_SOFTNESS * radius) + 0.5, 0.0, 1.0)
        opacity = (_OPACITY * (0.25 + 0.75 * strength) * inside)[..., None]
        patch += opacity * (np.array(colour) - patch)
