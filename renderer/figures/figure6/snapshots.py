"""Snapshots of Figure 6 (panel b), cropped around the joints, with marks for their jerk."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, UInt8

from renderer.figures import style
from renderer.figures.figure6.contents import MIN_MARK_STRENGTH, Figure6
from renderer.figures.figure6.panels import PanelRow

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure

MARK_RGB, MARK_PT = (0.29, 0.08, 0.43), 2.6
"""Colour and largest diameter of a mark, small enough to leave the hand in sight."""
KEY_MM = 4.0
AROUND_MM = KEY_MM + 2.0
"""Height (mm) above and below the snapshots of one motion."""
_HEAD, _SIDE, _FOOT = 0.16, 0.09, 0.07
"""Room around the outermost joints, as shares of the height of all joints."""


@dataclass(frozen=True)
class SnapshotStrips:
    """Snapshots of each motion in a strip, cropped to one size around the joints.

    The crop is the same in all pictures of a frame, so bodies keep their size and their position
    relative to other systems, while a walking body stays in the middle.
    """

    pictures: dict[str, np.ndarray]
    """Strips (h, W, 3) uint8, by motion."""
    joint_pixels: dict[str, np.ndarray]
    """Pixels (N, J, 2) of the joints in the strip, by motion; NaN outside of their snapshot."""
    snapshot_width_px: int
    """Width of a snapshot (pixels)."""
    spacing_px: int
    """Distance between the left edges of two snapshots (pixels)."""

    @classmethod
    def from_contents(cls, contents: Figure6) -> "SnapshotStrips":
        marks, stacks = contents.marks, contents.snapshots
        assert marks is not None
        pixels = np.stack([np.asarray(marks.pixels[name]) for name in stacks])
        limits = np.array(next(iter(stacks.values())).shape[2:0:-1])  # width, height
        inside = np.where(np.isfinite(pixels), np.clip(pixels, 0, limits), np.nan)
        inside[:, ~np.isfinite(inside).any(axis=(0, 2, 3))] = 0.5 * limits  # unknown position
        tall = (np.nanmax(inside[..., 1], axis=2) - np.nanmin(inside[..., 1], axis=2)).max()
        inside = inside if marks.crop_joints is None else inside[:, :, list(marks.crop_joints)]
        low = np.nanmin(inside, axis=(0, 2)) - tall * np.array([_SIDE, _HEAD])  # (N, 2)
        high = np.nanmax(inside, axis=(0, 2)) + tall * np.array([_SIDE, _FOOT])
        size = np.ceil((high - low).max(axis=0))
        size = np.where(size < 8, limits, np.minimum(size, limits)).astype(int)
        starts = np.clip(np.rint((low + high - size) / 2), 0, limits - size).astype(int)
        width, height = map(int, size)
        gap = max(1, round(0.03 * width))
        pixels = pixels - starts[:, None]
        pixels[~((pixels >= 0) & (pixels <= size)).all(axis=-1)] = np.nan
        pixels[..., 0] += (width + gap) * np.arange(len(starts))[:, None]

        def joined(stack: UInt8[np.ndarray, "N H W C"]) -> np.ndarray:
            cut = [
                p[y : y + height, x : x + width] for p, (x, y) in zip(stack, starts, strict=True)
            ]
            white = ((0, 0), (0, gap), (0, 0))
            return np.hstack([np.pad(p, white, constant_values=255) for p in cut])[:, :-gap]

        pictures = {name: joined(np.asarray(stack)) for name, stack in stacks.items()}
        return cls(pictures, dict(zip(stacks, pixels, strict=True)), width, width + gap)

    @property
    def aspect(self) -> float:
        """Width of a strip over its height."""
        height, width, _ = next(iter(self.pictures.values())).shape
        return width / height


def draw_snapshots(
    part: "SubFigure", contents: Figure6, row: PanelRow, strips: SnapshotStrips
) -> None:
    """Draw one row of snapshots per motion, the first below the frame numbers."""
    assert contents.marks is not None
    height_mm = row.height_mm - row.frame_number_height_mm - row.time_axis_height_mm - AROUND_MM
    all_axes = part.subplots(len(row.motion_names), 1, squeeze=False)[:, 0]
    for name, axes in zip(row.motion_names, all_axes, strict=True):
        height, width, _ = strips.pictures[name].shape
        axes.imshow(strips.pictures[name], extent=(0, width, height, 0), label=name)
        if len(row.motion_names) == 1 and not contents.is_in_one_plot:  # equal size in all rows
            wide_mm = row.widths_mm[row.panels.index("b")] - 1.0
            axes.set_xlim(0, max(width, wide_mm / height_mm * height))
        axes.set_label(f"snapshots of {name}")
        axes.set_anchor("NW")
        axes.spines[:].set_visible(False)
        is_first = row.frame_number_height_mm > 0 and axes is all_axes[0]
        axes.tick_params(length=0, labeltop=is_first, labelbottom=False)
        middles = (
            strips.spacing_px * np.arange(len(contents.snapshot_frames))
            + strips.snapshot_width_px / 2
        )
        axes.set_xticks(middles, [str(number) for number in contents.snapshot_frames])
        axes.set_yticks([])
        if len(row.motion_names) > 1:
            axes.set_title(style.truncate_text(name, style.LABEL_PT, 0.5 * contents.width_mm))
        values = np.asarray(contents.marks.joint_jerk[name]) / contents.marks.full_scale
        _draw_marks(axes, strips.joint_pixels[name].reshape(-1, 2), values.ravel())


def _draw_marks(
    axes: "Axes", joints: Float[np.ndarray, "J 2"], values: Float[np.ndarray, " J"]
) -> None:
    """Draw dark discs with white rims, visible on any body; the strongest last, no faint ones."""
    strength = np.clip(np.nan_to_num(values), 0.0, 1.0)
    order = np.argsort(strength, kind="stable")
    shown = order[(strength[order] >= MIN_MARK_STRENGTH) & np.isfinite(joints[order]).all(axis=1)]
    opacity = _opacity(strength[shown])
    axes.scatter(
        *joints[shown].T,
        s=np.square(_size_pt(strength[shown])),
        color=[(*MARK_RGB, alpha) for alpha in opacity],
        edgecolor=[(1.0, 1.0, 1.0, alpha) for alpha in opacity],
        linewidth=0.08 * MARK_PT,
        zorder=3,
    )


def _size_pt(strength: Any) -> Any:
    return MARK_PT * (0.45 + 0.55 * strength)


def _opacity(strength: Any) -> Any:
    return 0.9 * (0.25 + 0.75 * strength)


def draw_mark_legend(part: "SubFigure", contents: Figure6) -> None:
    """Draw samples of half and full strength at the right of the panel's title."""
    from matplotlib.lines import Line2D

    assert contents.marks is not None
    handles = [
        Line2D(
            [], [], linestyle="", marker="o", markersize=_size_pt(strength),
            label=f"{strength * contents.marks.full_scale:g}{unit}",
            markerfacecolor=(*MARK_RGB, _opacity(strength)), markeredgecolor="white",
            markeredgewidth=0.08 * MARK_PT,
        )
        for strength, unit in ((0.5, ""), (1.0, " m/s³ jerk"))
    ]  # fmt: skip
    part.legend(
        handles=handles, loc="upper right", bbox_to_anchor=(0.97, 1.0), ncols=2, columnspacing=0.8,
        borderaxespad=0.2,
    )  # fmt: skip
