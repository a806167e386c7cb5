"""Jitter sheet: where jitter sits in the body, as generated and after the filter.

Jerk by depth along the kinematic chain and of every joint, velocity spectrum of the tracked point,
the share of its jerk that each joint of its chain causes, and jerk folded on the windows of
generation, with the reference in black. NaN marks a quantity that was not measured, because a clip
is too short or nothing moved; it leaves a gap in a curve.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from conventions.joints import JOINT_NAMES
from conventions.names import FILTER_VERSIONS, REFERENCE_NAME, FilterVersion
from renderer.figures import style
from renderer.figures.errors import FigureError
from renderer.figures.style import MAX_SYSTEMS, SeriesStyle

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Curves = dict[str, tuple[np.ndarray, np.ndarray]]
"""Curves: x and y, both (N,), by motion."""

_GROUP_ENDS = ("_hip", "_collar", "index1", "middle1", "pinky1", "ring1", "thumb1")
"""Suffixes of joints that start a new line segment, as they do not continue the joint before."""


@dataclass(frozen=True)
class Jitter:
    """Jitter of one motion, as generated or filtered."""

    jerk_by_depth: Float[np.ndarray, " depths"]
    """Mean jerk (m/s³) of the joints at each number of bones from the pelvis."""
    jerk_by_joint: Float[np.ndarray, " 55"]
    """Jerk (m/s³) of each of the 55 joints."""
    spectrum: tuple[Float[np.ndarray, " bins"], Float[np.ndarray, " bins"]] | None
    """Frequencies (Hz), and the share of the tracked point's velocity power at each."""
    chain: tuple[str, ...]
    """Names of the joints from the pelvis to the tracked point."""
    jerk_drop_by_joint: Float[np.ndarray, " chain"]
    """Relative drop of the point's jerk if only that joint is smoothed; 1 is all of it."""
    jerk_by_frame_in_period: Float[np.ndarray, " frames"]
    """Mean jerk (m/s³) by frame of the window, or of the detected period; empty without either."""
    period_and_part: tuple[int, str] | None
    """Period of the jerk (frames), and the part of the body that shows it; None without one."""


@dataclass(frozen=True)
class JitterSheet:
    """Contents of one jitter sheet; raises FigureError without systems or with too many."""

    jitter: Mapping[str, Mapping[FilterVersion, Jitter]]
    """Jitter by motion and version; the reference, if there is one, comes first."""
    tracked_point: str = "tracked point"
    window_advance: int = 0
    """Frames between the starts of two windows; 0 if the windows are not known."""
    window_overlap: int = 0

    def __post_init__(self) -> None:
        num = len([name for name in self.jitter if name != REFERENCE_NAME])
        if not 1 <= num <= MAX_SYSTEMS:
            raise FigureError(
                f"The jitter sheet can show 1 to {MAX_SYSTEMS} systems besides the reference; "
                f"got {num}."
            )

    @property
    def styles(self) -> dict[str, SeriesStyle]:
        return style.series_styles(self.jitter, REFERENCE_NAME)

    @property
    def drawn_periods_and_parts(self) -> dict[str, tuple[int, str]]:
        """Detected period (frames) and body part, by motion; empty if the windows are known."""
        if self.window_advance:
            return {}
        return {
            name: each["raw"].period_and_part
            for name, each in self.jitter.items()
            if each["raw"].period_and_part
        }

    @property
    def chain(self) -> tuple[str, ...]:
        """Names of the joints from the pelvis to the tracked point."""
        return next((each["raw"].chain for each in self.jitter.values() if each["raw"].chain), ())

    def curves(self, row: str, version: FilterVersion) -> Curves:
        """Return the curves of a row, for each motion that has a finite value there."""
        curves = {name: _curve(row, versions[version]) for name, versions in self.jitter.items()}
        return {name: (x, y) for name, (x, y) in curves.items() if np.isfinite(y).any()}


def _curve(row: str, jitter: Jitter) -> tuple[np.ndarray, np.ndarray]:
    match row:
        case "depth":  # bones from the pelvis, and the mean jerk of the joints there
            y = jitter.jerk_by_depth
        case "joints":  # place in `JOINT_ORDER`, and jerk; a gap wherever a limb ends
            starts = [k for k, j in enumerate(JOINT_ORDER) if JOINT_NAMES[j].endswith(_GROUP_ENDS)]
            x = np.insert(np.arange(len(JOINT_ORDER), dtype=float), starts, np.nan)
            return x, np.insert(jitter.jerk_by_joint[list(JOINT_ORDER)], starts, np.nan)
        case "spectrum":  # frequency, and the share of the point's velocity power in percent
            x, y = jitter.spectrum or (np.zeros(0), np.zeros(0))
            return x, 100.0 * y
        case "attribution":  # place in the chain, and drop of the point's jerk in percent
            y = 100.0 * jitter.jerk_drop_by_joint
        case _:  # frame of the window, or of the detected period, and mean jerk
            y = jitter.jerk_by_frame_in_period
    return np.arange(len(y), dtype=float), y


def _limb(joint_name: str) -> tuple[int, int]:
    side, _, part = joint_name.partition("_")
    if side not in ("left", "right") or part.startswith("eye"):
        return 0, 0
    is_leg = part in ("hip", "knee", "ankle", "foot")
    return 1 if is_leg else 2, 0 if side == "left" else 1


JOINT_ORDER = tuple(sorted(range(len(JOINT_NAMES)), key=lambda j: _limb(JOINT_NAMES[j])))
"""Joint indices limb by limb: trunk and head, left leg, right leg, left arm, right arm."""


ROWS = {"depth": 40.0, "joints": 50.0, "spectrum": 40.0, "attribution": 50.0, "seams": 42.0}
"""Height of each row (mm)."""
COLUMN_TITLES: dict[FilterVersion, str] = {
    "raw": "As generated",
    "savgol": "Savitzky-Golay filter, 7 frames",
}
LIMIT_HZ = 5.0
NO_DATA = "Not measured: clip too short, or no motion."
NO_PERIOD = "The generation windows are unknown, and the jerk has no period of 2 to 240 frames."
LOG_SCALE_RATIO = 12.0
"""Ratio between systems from which an axis is logarithmic; a factor of 1.4, which matters most, is
visible on a linear one."""
_JERK = "jerk (m/s³)"
_MARKERS = 9


def draw_jitter_sheet(sheet: JitterSheet) -> "Figure":
    """Return the figure without a canvas, sized in inches as on paper."""
    figure = style.new_figure(style.PAGE_MM, 8.0 + sum(ROWS.values()))
    style.draw_legend(figure, sheet.styles)
    parts = figure.subfigures(len(ROWS), 1, squeeze=False, height_ratios=list(ROWS.values()))[:, 0]
    rows = {}
    for part, (row, (title, y_label)) in zip(parts, _titles(sheet).items(), strict=True):
        style.write_title(part, title)
        kinds = FILTER_VERSIONS[:1] if row == "joints" else FILTER_VERSIONS
        rows[row] = part.subplots(1, len(kinds), sharey=True, squeeze=False)[0]
        curves = [sheet.curves(row, kind) for kind in kinds]
        without = NO_PERIOD if row == "seams" and not sheet.window_advance else NO_DATA
        for kind, axes, drawn in zip(kinds, rows[row], curves, strict=True):
            axes.set_label(f"{row} {kind}")
            axes.grid(True, axis="y")
            _draw_curves(axes, drawn, sheet, row in ("joints", "attribution"), without)
        if any(curves):
            rows[row][0].set_ylabel(y_label)
            _scale(rows[row][0], row, curves)
    for kind, axes in zip(FILTER_VERSIONS, rows["depth"], strict=True):
        axes.set_title(COLUMN_TITLES[kind])
        axes.set_xlabel("depth (bones from the pelvis)")
        axes.xaxis.get_major_locator().set_params(integer=True)
    style.set_x_tick_names(
        rows["joints"][0], [style.short_joint_name(JOINT_NAMES[j]) for j in JOINT_ORDER], 5.5
    )
    for axes in (each for each in rows["spectrum"] if each.axison):
        axes.set_xlabel("frequency (Hz)")
        axes.axvline(LIMIT_HZ, color=style.FAINT_INK, linewidth=0.7, zorder=0.5)
        axes.annotate(
            "5 Hz", (LIMIT_HZ, 1.0), (2.0, -2.0), xycoords=("data", "axes fraction"), va="top",
            textcoords="offset points", size=style.SMALL_PT, color=style.FAINT_INK,
        )  # fmt: skip
    for axes in rows["attribution"]:
        axes.axhline(0.0, color=style.FAINT_INK, linewidth=0.5, zorder=0.5)
        style.set_x_tick_names(axes, [style.short_joint_name(name) for name in sheet.chain])
    for axes in rows["seams"]:
        if sheet.window_advance:
            every = sheet.window_advance
            axes.set_xlabel(
                f"frame in the window\n(a window starts every {every} frames; overlap shaded)"
            )
            axes.axvspan(-0.5, sheet.window_overlap - 0.5, color="#ececec", lw=0.0, zorder=0.2)
        else:
            axes.set_xlabel("frame in the detected period")
            axes.xaxis.get_major_locator().set_params(integer=True)
    return figure


def _titles(sheet: JitterSheet) -> dict[str, tuple[str, str]]:
    """Return the title and the y label of each row."""
    seams = "e  Window seams: mean jerk of all joints by frame in the generation window"
    periods = (
        "e  Periodic jerk: mean by frame in the detected period, "
        "for the body part in which it is clearest"
    )
    attribution = (
        f"d  Attribution: reduction of {sheet.tracked_point} jerk if one joint alone is filtered"
    )
    return {
        "depth": (
            "a  Mean jerk of joints by their distance from the pelvis (number of bones)",
            _JERK,
        ),
        "joints": ("b  Jerk of each joint, unfiltered", _JERK),
        "spectrum": (f"c  Velocity spectrum of the {sheet.tracked_point}", "power (%)"),
        "attribution": (attribution, "jerk reduction (%)"),
        "seams": (seams if sheet.window_advance else periods, _JERK),
    }


def _draw_curves(
    axes: "Axes", curves: Curves, sheet: JitterSheet, is_dense: bool, without: str
) -> None:
    """Draw lines in the systems' styles, with markers at every point or at a few."""
    if not curves:
        axes.text(
            0.5, 0.5, fill(without, 44), transform=axes.transAxes, ha="center", va="center",
            size=style.SMALL_PT, color=style.FAINT_INK, in_layout=False,
        )  # fmt: skip
        axes.set_axis_off()  # an empty scale would be misread
    for order, (name, (x, y)) in enumerate(curves.items()):
        every = 1 if is_dense or len(x) <= 2 * _MARKERS else max(1, len(x) // _MARKERS)
        # Markers of the curves are at different positions, so that none hides another.
        start = 0 if every == 1 else (order * every) // max(1, len(curves))
        looks = sheet.styles[name].line_properties
        if is_dense:
            looks |= {"markersize": 0.8 * style.MARKER_PT, "linewidth": 0.6}
        axes.plot(x, y, label=name, markevery=(start, every), **looks)


def _scale(axes: "Axes", row: str, curves: Sequence[Curves]) -> None:
    """Set one y scale for a row: logarithmic (0 is a gap) for spectra and very unequal jerks."""
    values = np.concatenate([y[np.isfinite(y)] for panel in curves for _, y in panel.values()])
    highest = [float(np.nanmax(y)) for panel in curves for _, y in panel.values()]
    if row == "attribution":
        room = 0.08 * float(np.ptp([*values, 0.0])) or 1.0
        axes.set_ylim(values.min(initial=0.0) - room, values.max(initial=0.0) + room)
    elif row == "spectrum" or max(highest) > LOG_SCALE_RATIO * max(min(highest), 1e-9):
        positive = values[values > 0.0]
        if positive.size:
            top = float(positive.max())
            axes.set_yscale("log", nonpositive="mask")
            axes.set_ylim(max(float(positive.min()), top / 1e5) / 1.3, 1.3 * top)
            axes.yaxis.set_major_formatter("{x:g}")
            axes.minorticks_off()
    else:
        style.set_y_from_zero_with_grid(axes, values)


def jitter_sheet_caption(sheet: JitterSheet, clip: str, last_sentence: str) -> str:
    """Return the caption: missing measurements and repeating jerk, then ``last_sentence``."""
    parts = [f"Jitter{f' of {clip}' if clip else ''}, unfiltered (left) and filtered (right)."]
    if REFERENCE_NAME in sheet.jitter:
        parts.append("The recorded reference is black; it has no generation windows.")
    measures = {"depth": "jerk by depth", "spectrum": "spectrum", "attribution": "attribution"}
    measures |= {"seams": "jerk at window seams"} if sheet.window_advance else {}
    for row, title in measures.items():
        curves = sheet.curves(row, "raw")
        lacking = [name for name in sheet.jitter if name not in curves]
        if lacking and curves:
            parts.append(
                f"Not measured: {title} of {', '.join(lacking)}; the clip is too short or nothing "
                "moves."
            )
    if sheet.window_advance == 0:
        parts += [
            f"The jerk of {name} repeats every {frames} frames, most clearly in the {part}."
            for name, (frames, part) in sheet.drawn_periods_and_parts.items()
        ]
        without = [name for name in sheet.jitter if name not in sheet.drawn_periods_and_parts]
        if without:
            parts.append(f"The jerk of {', '.join(without)} has no period of 2 to 240 frames.")
    return " ".join([*parts, last_sentence]).strip()
