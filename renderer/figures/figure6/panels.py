"""Panels of Figure 6 with curves: coordinates (a), path in space (c) and tremor (d)."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from renderer.figures import style
from renderer.figures.figure6.contents import Figure6
from renderer.figures.style import SMALL_PT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure

COORDINATES = ("x", "y", "z")
MIN_SPAN_M = 0.02
"""Shortest axis (m), used for a point that does not move."""
_MIN_SHARE = 0.2  # least share of the height for the flattest coordinate
_FAINT = 0.3
_PATH_ROOM = 1.06
_LIFT = 1.2
"""Distance of x, y and z in a strip of tremor, as a share of the end of its scale."""


@dataclass(frozen=True)
class PanelRow:
    """Row of adjacent panels of some motions; a row without motions holds only titles."""

    motion_names: tuple[str, ...]
    panels: tuple[str, ...]
    height_mm: float
    widths_mm: tuple[float, ...]
    has_titles: bool
    frame_number_height_mm: float = 0.0
    """Height (mm) of the frame numbers, which only the first row of snapshots has."""
    time_axis_height_mm: float = 0.0
    """Height (mm) of the time axis, which only the last row of its panels has."""


def _curves(contents: Figure6, row: PanelRow) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield each motion of a row with its line properties, after the first motion drawn faintly."""
    first = contents.motion_names[0]
    if first not in row.motion_names:
        looks = contents.styles[first].line_properties
        yield first, looks | {"marker": "", "alpha": _FAINT, "zorder": 1.5, "linewidth": 0.7}
    for name in row.motion_names:
        yield name, contents.styles[name].line_properties | {"markevery": contents.marker_frames}


def _limits(contents: Figure6, room: float, least: float = _MIN_SHARE) -> np.ndarray:
    """Return limits of x, y and z (3, 2) in metres, each at least ``least`` of their sum."""
    positions = np.concatenate(list(contents.window_trajectories.values())).astype(np.float64)
    low, high = positions.min(axis=0), positions.max(axis=0)
    spans = np.maximum(room * (high - low), MIN_SPAN_M)
    spans = np.maximum(spans, least * spans.sum())
    middle = 0.5 * (low + high)
    return np.stack([middle - spans / 2, middle + spans / 2], axis=1)


def draw_coordinates(part: "SubFigure", contents: Figure6, row: PanelRow) -> None:
    """Draw x, y and z against time in one scale (metres per inch)."""
    from matplotlib.ticker import MaxNLocator

    least = _MIN_SHARE if contents.is_in_one_plot else 0.3
    limits, times = _limits(contents, 1.14, least), contents.times
    spans = np.ptp(limits, axis=1)
    margin = 0.01 * (times[-1] - times[0]) or 0.5 / contents.fps
    stack = part.subplots(3, 1, sharex=True, squeeze=False, height_ratios=spans)[:, 0]
    for k, (axes, letter) in enumerate(zip(stack, COORDINATES, strict=True)):
        axes.set_label(letter)
        for frame in contents.window_snapshot_frames:
            axes.axvline(times[frame], color=style.SNAPSHOT_INK, linewidth=0.5, zorder=0.5)
        for name, looks in _curves(contents, row):
            axes.plot(
                times, contents.window_trajectories[name][:, k], label=name, clip_on=False, **looks
            )
        axes.set_xlim(times[0] - margin, times[-1] + 3 * margin)
        axes.set_ylim(*limits[k])
        axes.grid(True, axis="y")
        most = max(1, int(0.14 * row.height_mm * spans[k] / spans.sum()))
        bins = most if most > 1 else 6  # a low axis shows its outermost ticks
        ticks = MaxNLocator(bins, steps=[1, 2, 5, 10], min_n_ticks=2).tick_values(*limits[k])
        ticks = ticks[(ticks >= limits[k, 0]) & (ticks <= limits[k, 1])]
        axes.set_yticks(ticks if len(ticks) <= most + 1 else ticks[[0, -1]])
        axes.set_ylabel(f"{letter} (m)", rotation=0, ha="right", va="center")
    _write_times(stack[-1], row.time_axis_height_mm > 0)
    part.align_ylabels(stack)


def _write_times(axes: "Axes", has_times: bool) -> None:
    axes.tick_params(axis="x", labelbottom=has_times)
    axes.set_xlabel("time (s)" if has_times else "")


_ELEVATION, _AZIMUTH = np.radians(20.0), np.radians(36.0)
_TO_CAMERA = np.array(
    [
        -np.sin(_AZIMUTH) * np.cos(_ELEVATION),
        np.sin(_ELEVATION),
        np.cos(_AZIMUTH) * np.cos(_ELEVATION),
    ]
)  # from the front, above the body's right hand
_ACROSS = np.array([np.cos(_AZIMUTH), 0.0, np.sin(_AZIMUTH)])
PROJECTION = np.stack([_ACROSS, np.cross(_TO_CAMERA, _ACROSS)], axis=1)
"""Projection (3, 2) of x, y and z to paper, without perspective."""


def grid_pitch_m(contents: Figure6) -> float:
    """Return the distance (m) between grid lines on the floor and walls of the path."""
    return style.round_down_to_1_2_5(
        0.5 * float(np.ptp(_limits(contents, _PATH_ROOM), axis=1).min())
    )


def draw_path(part: "SubFigure", contents: Figure6, row: PanelRow) -> None:
    """Draw the path in space before a floor and two walls, all three axes to one scale."""
    limits = _limits(contents, _PATH_ROOM)
    above, below = (
        (0.0, 0.0)
        if contents.is_in_one_plot
        else (row.frame_number_height_mm, row.time_axis_height_mm)
    )
    heights = [above or 1e-3, row.height_mm - above - below, below or 1e-3]
    axes = part.add_subplot(part.add_gridspec(3, 1, height_ratios=heights)[1])  # one scale in all
    axes.set_label("path")
    axes.set_aspect("equal")
    axes.set_axis_off()
    pitch = grid_pitch_m(contents)
    corner = np.array([limits[0, 1], limits[1, 0], limits[2, 0]])  # floor and walls meet here

    def line(start: Float[np.ndarray, " 3"], along: int, **looks: Any) -> None:
        ends = np.stack([start, start])
        ends[:, along] = limits[along]
        axes.plot(*(ends @ PROJECTION).T, solid_capstyle="round", **looks)

    ticks = [np.arange(np.ceil(low / pitch), high / pitch) * pitch + 0.0 for low, high in limits]
    for axis, along in product(range(3), range(3)):
        for tick in [*ticks[axis], *limits[axis]] if axis != along else ():
            start = corner.copy()
            start[axis] = tick
            line(start, along, color=style.GRID_INK, linewidth=0.4, zorder=0.5)
    front, back = limits[[0, 1, 2], [0, 0, 1]], limits[:, 0]  # the outermost edges
    away = (4.0, -6.0), (-4.0, 0.0), (-4.0, -5.0)
    for axis, (start, offset) in enumerate(zip((front, back, front), away, strict=True)):
        line(start, axis, color=style.INK, linewidth=0.5, zorder=0.6)
        middle = np.where(np.arange(3) == axis, limits.mean(axis=1), start)
        axes.annotate(
            COORDINATES[axis], tuple(middle @ PROJECTION), offset, textcoords="offset points",
            size=SMALL_PT, ha="center", va="center", annotation_clip=False,
        )  # fmt: skip
    for name, looks in _curves(contents, row):
        axes.plot(*(contents.window_trajectories[name] @ PROJECTION).T, label=name, **looks)


def draw_tremor(part: "SubFigure", contents: Figure6, row: PanelRow) -> None:
    """Draw one strip per motion with x above y above z in one scale, and its RMS.

    The coordinates differ in lightness. Peaks beyond the scale are cut and marked by triangles.
    """
    times, scale = contents.times, contents.tremor_scale_mm
    margin = 0.01 * (times[-1] - times[0])
    lifts = _LIFT * scale * np.array([1.0, 0.0, -1.0])
    bar = style.round_down_to_1_2_5(2.0 * scale)
    strips = part.subplots(len(row.motion_names), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for name, axes in zip(row.motion_names, strips, strict=True):
        axes.set_label(f"tremor of {name}")
        axes.set_yticks(lifts, COORDINATES)
        axes.tick_params(axis="y", length=0, pad=1.0)
        axes.spines["left"].set_visible(False)
        axes.grid(True, axis="y")
        shades = style.shades(contents.styles[name].color)
        for values, lift, ink in zip(contents.tremor_mm[name].T, lifts, shades, strict=True):
            axes.plot(times, np.clip(values, -scale, scale) + lift, color=ink, linewidth=0.6)
            for sign, marker in ((1, "^"), (-1, "v")):
                peaks = _peaks(sign * values, scale)
                y = np.full(len(peaks), lift + 1.08 * sign * scale)
                axes.scatter(
                    times[peaks], y, 4.0, color=ink, marker=marker, linewidth=0.0, zorder=3
                )
        rms = float(np.sqrt(np.square(contents.tremor_mm[name]).sum(axis=1).mean()))
        lines = style.wrap_text(name, SMALL_PT, 0.2 * contents.width_mm)
        more = "\N{HORIZONTAL ELLIPSIS}" if len(lines) > 2 else ""
        label = "\n".join(lines[:2]) + f"{more}\n{rms:.1f} mm rms"
        axes.set_ylabel(label, size=SMALL_PT, rotation=0, ha="right", va="center", labelpad=4.0)
        end = times[-1] + 4 * margin
        looks = {"color": style.INK, "solid_capstyle": "butt", "clip_on": False}
        axes.plot([end, end], [-bar / 2, bar / 2], linewidth=1.2, **looks)
        axes.annotate(
            f"{bar:g} mm", (end, 0.0), (3.0, 0.0), textcoords="offset points", va="center",
            size=SMALL_PT, annotation_clip=False,
        )  # fmt: skip
        _write_times(axes, axes is strips[-1])
    strips[0].set_xlim(times[0] - margin, times[-1] + 3 * margin)
    strips[0].set_ylim(-(_LIFT + 1.2) * scale, (_LIFT + 1.2) * scale)


def _peaks(values: Float[np.ndarray, " T"], limit: float) -> list[int]:
    """Return the highest frame of each run of values beyond a limit."""
    runs = np.flatnonzero(np.diff(np.concatenate([[False], values > limit, [False]]).astype(int)))
    return [int(a + values[a:b].argmax()) for a, b in zip(runs[::2], runs[1::2], strict=True)]
