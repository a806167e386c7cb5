"""The sheet that shows where the jitter sits: every measure as generated, and behind the filter.

Jerk by depth along the kinematic chain and of every joint, the velocity spectrum of the followed
point, how much of its jerk each joint of its chain carries, and jerk folded on the windows of
generation; each as generated and behind one and the same filter, with the recorded reference in
black.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from conventions.joints import JOINT_NAMES
from conventions.names import REFERENCE_NAME, VERSIONS, Version
from renderer.figures import style
from renderer.figures.files import FigureFiles, matplotlib_settings, write_figure
from renderer.figures.jitter_series import JOINT_ORDER, Curves, JitterSheet
from renderer.figures.page import (
    CAPTION_GAP,
    MARGIN,
    SMALL_LINE,
    TITLE,
    TITLE_GAP,
    Key,
    Rect,
    caption_lines,
    draw_key,
    place_legend,
    short_name,
    write,
    write_caption,
    write_title,
)
from renderer.figures.style import FIGURE_WIDTH_IN

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMN_HEADS = 0.16
AXIS_LABELS = 0.54  # left of a panel: its label and its numbers
TICK_LABELS = 0.14
X_LABEL = 0.15
NAMES_BELOW = {"joints": 0.47, "attribution": 0.55}  # names of joints that stand upright
GAP = 0.12  # between panels side by side, and below the labels of a row
MAX_HEIGHT = 9.15  # it goes on a page
PLOT_HEIGHT = 1.05

ROWS = ("depth", "joints", "spectrum", "attribution", "seams")


@dataclass(frozen=True)
class SheetLayout:
    """Places of the parts of the jitter sheet."""

    height: float
    legend: tuple[Key, ...]
    heads_top: float
    panels: dict[str, tuple[Rect, ...]]
    """Raw and filtered side by side; one wide panel for the joints."""
    caption_top: float


def plan_sheet(names: tuple[str, ...], num_caption_lines: int) -> SheetLayout:
    """Place legend, rows of panels and caption below each other; panels shrink to fit a page."""
    legend, legend_bottom = place_legend(names)
    caption_height = CAPTION_GAP + num_caption_lines * SMALL_LINE + MARGIN
    heads_top = legend_bottom + 0.08
    labels = sum(_labels_below(row) + TITLE for row in ROWS) + (len(ROWS) - 1) * GAP
    free = MAX_HEIGHT - heads_top - COLUMN_HEADS - labels - caption_height
    plot_height = min(PLOT_HEIGHT, free / len(ROWS))

    wide = FIGURE_WIDTH_IN - MARGIN - AXIS_LABELS - MARGIN
    half = (wide - GAP) / 2.0
    left = MARGIN + AXIS_LABELS
    top = heads_top + COLUMN_HEADS
    panels = {}
    for row in ROWS:
        top += TITLE
        if row == "joints":
            panels[row] = (Rect(left, top, wide, plot_height),)
        else:
            lefts = (left, left + half + GAP)
            panels[row] = tuple(Rect(each, top, half, plot_height) for each in lefts)
        top += plot_height + _labels_below(row) + GAP
    body_bottom = top - GAP
    return SheetLayout(
        height=body_bottom + caption_height,
        legend=legend,
        heads_top=heads_top,
        panels=panels,
        caption_top=body_bottom + CAPTION_GAP,
    )


def _labels_below(row: str) -> float:
    return NAMES_BELOW.get(row, TICK_LABELS + X_LABEL)


FOLDED = "frame of the period found"
HEADS: dict[Version, str] = {"raw": "As generated", "savgol": "Savitzky-Golay filter, 7 frames"}
LIMIT_HZ = 5.0
NO_DATA = "Not measured: too short, or nothing moved."
NO_PERIOD = "No windows are known, and no period of 2 to 240 frames was found in the jerk."
_JERK = "jerk (m/s³)"
_DECADES = 3.3
"""Values lower than this below the highest are drawn at the lower edge of a logarithmic axis."""
_FEW_DECADES = 60.0
"""An axis of a smaller ratio of its ends has numbers between the powers of ten."""
_MARKERS = 9
_SHADE = "#ececec"


def draw_sheet(sheet: JitterSheet, caption: str) -> "Figure":
    """The figure, without a canvas; its size in inches is its size on paper."""
    from matplotlib.figure import Figure

    lines = caption_lines(caption)
    layout = plan_sheet(tuple(sheet.jitter), len(lines))
    figure = Figure(figsize=(style.FIGURE_WIDTH_IN, layout.height), facecolor="white")
    for key in layout.legend:
        draw_key(figure, key, sheet.styles[key.name])
    for kind, rect in zip(VERSIONS, layout.panels["depth"], strict=True):
        write(figure, rect.left, layout.heads_top, HEADS[kind], size=style.LABEL_PT, va="top")

    _draw_depth(figure, layout, sheet)
    _draw_joints(figure, layout, sheet)
    _draw_spectrum(figure, layout, sheet)
    _draw_attribution(figure, layout, sheet)
    _draw_seams(figure, layout, sheet)
    write_caption(figure, lines, layout.caption_top)
    return figure


def _draw_depth(figure: "Figure", layout: SheetLayout, sheet: JitterSheet) -> None:
    from matplotlib.ticker import MaxNLocator

    axes = _row(
        *(figure, layout, sheet, "depth", sheet.by_depth),
        title="a  Jerk by depth: mean of the joints so many bones from the pelvis",
        y_label=_JERK,
    )
    for each in axes:
        each.set_xlabel("bones from the pelvis", size=style.LABEL_PT, labelpad=1.0)
        each.xaxis.set_major_locator(MaxNLocator(integer=True))
    _share_log(axes, [sheet.by_depth(kind) for kind in VERSIONS])


def _draw_joints(figure: "Figure", layout: SheetLayout, sheet: JitterSheet) -> None:
    (axes,) = _row(
        *(figure, layout, sheet, "joints", sheet.by_joint),
        title="b  Jerk of each joint, as generated",
        y_label=_JERK,
        is_dense=True,
    )
    names = [short_name(JOINT_NAMES[joint]) for joint in JOINT_ORDER]
    _name_x(axes, names, size=5.2)
    _share_log([axes], [sheet.by_joint("raw")])


def _draw_spectrum(figure: "Figure", layout: SheetLayout, sheet: JitterSheet) -> None:
    axes = _row(
        *(figure, layout, sheet, "spectrum", sheet.spectrum),
        title=f"c  Velocity spectrum: {sheet.point}",
        y_label="power (%)",
    )
    for each in axes:
        each.set_xlabel("frequency (Hz)", size=style.LABEL_PT, labelpad=1.0)
        each.axvline(LIMIT_HZ, color=style.FAINT_INK, linewidth=0.7, zorder=0.5)
        each.annotate(
            *("5 Hz", (LIMIT_HZ, 1.0)),
            xycoords=("data", "axes fraction"),
            xytext=(2.0, -2.0),
            textcoords="offset points",
            **{"size": style.SMALL_PT, "color": style.FAINT_INK, "va": "top"},
        )
    _share_log(axes, [sheet.spectrum(kind) for kind in VERSIONS], decades=5.0)


def _draw_attribution(figure: "Figure", layout: SheetLayout, sheet: JitterSheet) -> None:
    axes = _row(
        *(figure, layout, sheet, "attribution", sheet.attribution),
        title=f"d  Attribution: drop of jerk when one joint is smoothed, {sheet.point}",
        y_label="drop (%)",
        is_dense=True,
    )
    for each in axes:
        each.axhline(0.0, color=style.FAINT_INK, linewidth=0.5, zorder=0.5)
        _name_x(each, [short_name(name) for name in sheet.chain], size=style.SMALL_PT)
    _share_linear(axes, [sheet.attribution(kind) for kind in VERSIONS])


def _draw_seams(figure: "Figure", layout: SheetLayout, sheet: JitterSheet) -> None:
    is_known = sheet.window_advance > 0
    axes = _row(
        *(figure, layout, sheet, "seams", sheet.by_phase),
        title="e  Seams: mean jerk of all joints, folded on the windows"
        if is_known
        else "e  Periods: mean jerk of the body part that repeats, folded on the period found",
        y_label=_JERK,
        without=NO_DATA if is_known else NO_PERIOD,
    )
    label = f"frame of the window, one every {sheet.window_advance}; shaded: shared by two"
    for each in axes:
        each.set_xlabel(label if is_known else FOLDED, size=style.LABEL_PT, labelpad=1.0)
        if is_known:
            each.axvspan(-0.5, sheet.window_overlap - 0.5, color=_SHADE, linewidth=0.0, zorder=0.2)
        elif sheet.periods:
            each.set_xticks(_few_frames(max(frames for frames, _ in sheet.periods.values())))
    _share_linear(axes, [sheet.by_phase(kind) for kind in VERSIONS], from_zero=True)


def _few_frames(period: int) -> list[int]:
    """Frames of a period to put numbers at, at most about eight."""
    return list(range(0, period, -(-period // 8)))


def _row(
    figure: "Figure",
    layout: SheetLayout,
    sheet: JitterSheet,
    row: str,
    curves_of: Callable[[Version], Curves],
    *,
    title: str,
    y_label: str,
    is_dense: bool = False,
    without: str = NO_DATA,
) -> list["Axes"]:
    """The panels of one measure; only the left one has numbers along y.

    Args:
        without: what a panel says that has no curves.
    """
    rects = layout.panels[row]
    write_title(figure, MARGIN, rects[0].top - TITLE_GAP, title)
    drawn = []
    for kind, rect in zip(VERSIONS, rects, strict=False):
        axes = figure.add_axes(rect.fraction_of(layout.height), label=f"{row} {kind}")
        _draw_curves(axes, curves_of(kind), sheet, is_dense, without)
        axes.grid(axis="y")
        axes.set_axisbelow(True)
        if rect is not rects[0]:
            axes.tick_params(axis="y", labelleft=False)
        drawn.append(axes)
    if any(curves_of(kind) for kind in VERSIONS):
        _write_y_label(figure, rects[0], y_label)
    return drawn


def _draw_curves(
    axes: "Axes", curves: Curves, sheet: JitterSheet, is_dense: bool, without: str
) -> None:
    """Lines in the systems' styles, with their markers at every point or at a few."""
    if not curves:
        axes.text(
            *(0.5, 0.5, fill(without, 44)),
            transform=axes.transAxes,
            **{"size": style.SMALL_PT, "color": style.FAINT_INK, "ha": "center", "va": "center"},
        )
        axes.set_axis_off()  # a scale of nothing would say something
        return
    for order, (name, (x, y)) in enumerate(curves.items()):
        every = 1 if is_dense or len(x) <= 2 * _MARKERS else max(1, len(x) // _MARKERS)
        # Markers of the curves stand at different places, so that none hides another.
        start = 0 if every == 1 else (order * every) // max(1, len(curves))
        properties = sheet.styles[name].line_properties
        if is_dense:
            properties |= {"markersize": 0.8 * style.MARKER_PT, "linewidth": 0.6}
        axes.plot(x, y, label=name, markevery=(start, every), **properties)


def _share_log(axes: Sequence["Axes"], curves: Sequence[Curves], decades: float = _DECADES) -> None:
    """One logarithmic scale for the panels of a row; what lies below it stays at its edge, and what
    is 0, which has no place on it, is a gap."""
    from matplotlib.ticker import FuncFormatter, LogLocator

    values = _all_values(curves)
    values = values[values > 0.0]
    if not values.size:
        _share_linear(axes, curves, from_zero=True)
        return
    top = float(values.max())
    bottom = max(float(values.min()), top / 10.0**decades)
    low, high = bottom / 1.3, top * 1.3
    steps = (1.0, 2.0, 5.0) if high / low < _FEW_DECADES else (1.0,)
    for each in axes:
        each.set_yscale("log")
        each.set_ylim(low, high)
        for line in each.get_lines():
            if line.get_label() and not str(line.get_label()).startswith("_"):
                y = np.asarray(line.get_ydata(), dtype=float)
                line.set_ydata(np.where(y > 0.0, np.maximum(y, low), np.nan))
        each.yaxis.set_major_locator(LogLocator(subs=steps))
        each.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        each.minorticks_off()


def _share_linear(
    axes: Sequence["Axes"], curves: Sequence[Curves], from_zero: bool = False
) -> None:
    """One linear scale for the panels of a row."""
    values = _all_values(curves)
    high = float(values.max(initial=0.0))
    low = 0.0 if from_zero else float(values.min(initial=0.0))
    margin = 0.08 * (high - low) or 1.0
    for each in axes:
        each.set_ylim(low if from_zero else low - margin, high + margin)


def _all_values(curves: Sequence[Curves]) -> np.ndarray:
    """Every finite value of the panels of a row."""
    parts = [y[np.isfinite(y)] for panel in curves for _, y in panel.values()]
    return np.concatenate(parts) if parts else np.zeros(0)


def _name_x(axes: "Axes", names: Sequence[str], size: float) -> None:
    axes.set_xticks(range(len(names)), names, rotation=90, size=size)
    axes.tick_params(axis="x", pad=1.0)
    axes.set_xlim(-0.6, max(len(names), 1) - 0.4)


def _write_y_label(figure: "Figure", rect: Rect, text: str) -> None:
    write(
        *(figure, MARGIN + 0.06, rect.top + 0.5 * rect.height, text),
        rotation=90,
        size=style.LABEL_PT,
        ha="center",
        va="center",
    )


def jitter_sheet(
    sheet: JitterSheet, out_stem: Path, *, clip: str = "", sentence: str = ""
) -> FigureFiles:
    """Write ``<out_stem>.png``, ``.svg`` and ``.pdf``; each appears whole or not at all.

    Args:
        sheet: the numbers; what they lack is told in the caption.
        out_stem: path without an extension; its folder is made.
        clip: name of the clip, for the caption.
        sentence: what the numbers say, at the end of the caption.
    """
    caption = _caption(sheet, clip, sentence)
    with matplotlib_settings():
        return write_figure(draw_sheet(sheet, caption), out_stem, description=caption)


def _caption(sheet: JitterSheet, clip: str, sentence: str) -> str:
    parts = [f"Jitter{f' of {clip}' if clip else ''}, left as generated, right after the filter."]
    if REFERENCE_NAME in sheet.jitter:
        parts.append("Black: the recorded reference, which has no windows and so no seams.")
    measures = {
        "jerk by depth": sheet.by_depth("raw"),
        "spectrum": sheet.spectrum("raw"),
        "attribution": sheet.attribution("raw"),
    }
    if sheet.window_advance:
        measures["seams"] = sheet.by_phase("raw")
    for title, curves in measures.items():
        lacking = [name for name in sheet.jitter if name not in curves]
        if lacking and curves:
            parts.append(f"No {title} of {', '.join(lacking)}: too short, or nothing moved.")
    if sheet.window_advance == 0:
        parts += [
            f"The {part} of {name} jerk anew every {frames} frames."
            for name, (frames, part) in sheet.periods.items()
        ]
        without = [name for name in sheet.jitter if name not in sheet.periods]
        if without:
            parts.append(f"No period of 2 to 240 frames in {', '.join(without)}.")
    return " ".join([*parts, sentence]).strip()
