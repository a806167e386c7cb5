"""The sheet that shows where the jitter sits: every measure as generated, and behind the filter.

Jerk by depth along the kinematic chain and of every joint, the velocity spectrum of the followed
point, how much of its jerk each joint of its chain carries, and jerk folded on the windows of
generation, with the recorded reference in black. What was not measured, because a clip is too short
or nothing moved, is NaN and a gap; a motion of which nothing was measured has no curve.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from conventions.joints import JOINT_NAMES
from conventions.names import REFERENCE_NAME, VERSIONS, Version
from renderer.figures import style
from renderer.figures.files import FigureError, FigureFiles, matplotlib_settings, write_figure
from renderer.figures.style import MAX_SYSTEMS, SeriesStyle, styles_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Curves = dict[str, tuple[np.ndarray, np.ndarray]]
"""Name to x and y, both (N,)."""

_GROUP_ENDS = ("_hip", "_collar", "index1", "middle1", "pinky1", "ring1", "thumb1")
"""A line through the joints begins anew at these: they do not follow on the joint before."""


@dataclass(frozen=True)
class Jitter:
    """Of one motion, as generated or filtered."""

    by_depth: Float[np.ndarray, " depths"]
    """Mean jerk of the joints so many bones from the pelvis, m/s^3."""
    by_joint: Float[np.ndarray, " 55"]
    """Jerk of each of the 55 joints, m/s^3."""
    spectrum: tuple[Float[np.ndarray, " bins"], Float[np.ndarray, " bins"]] | None
    """Frequencies in Hz, and the share of the followed point's velocity power at each."""
    chain: tuple[str, ...]
    """The joints from the pelvis to the followed point."""
    chain_drop: Float[np.ndarray, " chain"]
    """Of the point's jerk when that joint alone is smoothed; 1 is all of it."""
    by_phase: Float[np.ndarray, " frames"]
    """Mean jerk in m/s^3 for each frame of the window, or of the period found; empty without."""
    period: tuple[int, str] | None
    """Frames after which jerk comes again, and the part of the body that shows it."""


@dataclass(frozen=True)
class JitterSheet:
    """What one sheet shows.

    Raises:
        FigureError: if there are no systems or too many.
    """

    jitter: Mapping[str, Mapping[Version, Jitter]]
    """By name; the reference comes first where there is one."""
    point: str = "followed point"
    window_advance: int = 0
    """0 where windows are not known."""
    window_overlap: int = 0

    def __post_init__(self) -> None:
        num = len([name for name in self.jitter if name != REFERENCE_NAME])
        if not 1 <= num <= MAX_SYSTEMS:
            raise FigureError(f"The jitter sheet holds 1 to {MAX_SYSTEMS} systems; got {num}.")

    @property
    def styles(self) -> dict[str, SeriesStyle]:
        return styles_of(self.jitter, REFERENCE_NAME)

    def by_depth(self, kind: Version) -> Curves:
        """Bones from the pelvis, and the mean jerk of the joints there in m/s^3."""
        return _curves({name: each.by_depth for name, each in self._of(kind).items()})

    def by_phase(self, kind: Version) -> Curves:
        """Frame of the window, or of the period found, and mean jerk in m/s^3."""
        return _curves({name: each.by_phase for name, each in self._of(kind).items()})

    @property
    def periods(self) -> dict[str, tuple[int, str]]:
        """Where no windows are known: by name the period found, in frames, and the part of the
        body that shows it."""
        if self.window_advance:
            return {}
        return {name: each.period for name, each in self._of("raw").items() if each.period}

    def by_joint(self, kind: Version) -> Curves:
        """Place in `JOINT_ORDER`, and jerk in m/s^3; a gap of NaN wherever a limb ends."""
        places = np.arange(len(JOINT_ORDER), dtype=float)
        starts = [k for k, j in enumerate(JOINT_ORDER) if JOINT_NAMES[j].endswith(_GROUP_ENDS)]
        x = np.insert(places, starts, np.nan)
        return _with_numbers(
            {
                name: (x, np.insert(each.by_joint[list(JOINT_ORDER)], starts, np.nan))
                for name, each in self._of(kind).items()
            }
        )

    def spectrum(self, kind: Version) -> Curves:
        """Frequency in Hz, and share of the point's velocity power in each bin in percent."""
        spectra = {name: each.spectrum for name, each in self._of(kind).items()}
        return _with_numbers(
            {name: (found[0], 100.0 * found[1]) for name, found in spectra.items() if found}
        )

    def attribution(self, kind: Version) -> Curves:
        """Place in :attr:`chain`, and relative drop of the point's jerk in percent."""
        found = self._of(kind).items()
        return _curves({name: 100.0 * each.chain_drop for name, each in found})

    @property
    def chain(self) -> tuple[str, ...]:
        """The joints from the pelvis to the followed point."""
        return next((each.chain for each in self._of("raw").values() if each.chain), ())

    def _of(self, kind: Version) -> dict[str, Jitter]:
        return {name: versions[kind] for name, versions in self.jitter.items()}


def _curves(values: Mapping[str, np.ndarray]) -> Curves:
    return _with_numbers({name: (np.arange(len(y), dtype=float), y) for name, y in values.items()})


def _with_numbers(curves: Curves) -> Curves:
    return {name: (x, y) for name, (x, y) in curves.items() if np.isfinite(y).any()}


def _limb(joint_name: str) -> tuple[int, int]:
    side, _, part = joint_name.partition("_")
    if side not in ("left", "right") or part.startswith("eye"):
        return 0, 0
    is_leg = part in ("hip", "knee", "ankle", "foot")
    return 1 if is_leg else 2, 0 if side == "left" else 1


JOINT_ORDER = tuple(sorted(range(len(JOINT_NAMES)), key=lambda j: _limb(JOINT_NAMES[j])))
"""The joints limb by limb: trunk and head, left leg, right leg, left arm, right arm."""


ROWS = {"depth": 40.0, "joints": 50.0, "spectrum": 40.0, "attribution": 50.0, "seams": 42.0}
"""By name the height in millimetres."""
FOLDED = "frame of the period found"
HEADS: dict[Version, str] = {"raw": "As generated", "savgol": "Savitzky-Golay filter, 7 frames"}
LIMIT_HZ = 5.0
NO_DATA = "Not measured: too short, or nothing moved."
NO_PERIOD = "No windows are known, and no period of 2 to 240 frames was found in the jerk."
LOG_FROM = 12.0
"""So many times another system's values make an axis logarithmic: a factor of 1.4, which is the
message, is seen on a linear one."""
_JERK = "jerk (m/s³)"
_MARKERS = 9
_SHADE = "#ececec"


def jitter_sheet(
    sheet: JitterSheet, out_stem: Path, *, clip: str = "", sentence: str = ""
) -> FigureFiles:
    """Write the sheet, with what it lacks and says as its caption.

    Args:
        clip: its name.
        sentence: what the numbers say, at the end of the caption.
    """
    with matplotlib_settings():
        return write_figure(draw_sheet(sheet), out_stem, _caption(sheet, clip, sentence))


def draw_sheet(sheet: JitterSheet) -> "Figure":
    """The figure, without a canvas; its size in inches is its size on paper."""
    figure = style.new_figure(style.PAGE_MM, 8.0 + sum(ROWS.values()))
    style.draw_keys(figure, sheet.styles)
    parts = figure.subfigures(len(ROWS), 1, squeeze=False, height_ratios=list(ROWS.values()))[:, 0]
    rows = {}
    for part, (row, title, y_label, curves_of, without) in zip(parts, _rows(sheet), strict=True):
        style.write_title(part, title)
        kinds = VERSIONS[:1] if row == "joints" else VERSIONS
        rows[row] = part.subplots(1, len(kinds), sharey=True, squeeze=False)[0]
        curves = [curves_of(kind) for kind in kinds]
        for kind, axes, drawn in zip(kinds, rows[row], curves, strict=True):
            axes.set_label(f"{row} {kind}")
            axes.grid(True, axis="y")
            _draw_curves(axes, drawn, sheet, row in ("joints", "attribution"), without)
        if any(curves):
            rows[row][0].set_ylabel(y_label)
            _scale(rows[row][0], row, curves)
    for kind, axes in zip(VERSIONS, rows["depth"], strict=True):
        axes.set_title(HEADS[kind])
        axes.set_xlabel("bones from the pelvis")
        axes.xaxis.get_major_locator().set_params(integer=True)
    style.name_x(rows["joints"][0], [style.short_joint(JOINT_NAMES[j]) for j in JOINT_ORDER], 5.5)
    for axes in (each for each in rows["spectrum"] if each.axison):
        axes.set_xlabel("frequency (Hz)")
        axes.axvline(LIMIT_HZ, color=style.FAINT_INK, linewidth=0.7, zorder=0.5)
        axes.annotate(
            "5 Hz", (LIMIT_HZ, 1.0), (2.0, -2.0), xycoords=("data", "axes fraction"), va="top",
            textcoords="offset points", size=style.SMALL_PT, color=style.FAINT_INK,
        )  # fmt: skip
    for axes in rows["attribution"]:
        axes.axhline(0.0, color=style.FAINT_INK, linewidth=0.5, zorder=0.5)
        style.name_x(axes, [style.short_joint(name) for name in sheet.chain])
    for axes in rows["seams"]:
        if sheet.window_advance:
            every = sheet.window_advance
            axes.set_xlabel(f"frame of the window, one every {every}; shaded: shared by two")
            axes.axvspan(-0.5, sheet.window_overlap - 0.5, color=_SHADE, linewidth=0.0, zorder=0.2)
        else:
            axes.set_xlabel(FOLDED)
            axes.xaxis.get_major_locator().set_params(integer=True)
    return figure


def _rows(
    sheet: JitterSheet,
) -> list[tuple[str, str, str, Callable[[Version], Curves], str]]:
    """Of each measure its name, title, label along y, curves, and what a panel without any says."""
    is_known = sheet.window_advance > 0
    depth = "a  Jerk by depth: mean of the joints so many bones from the pelvis"
    attribution = f"d  Attribution: drop of jerk when one joint is smoothed, {sheet.point}"
    seams = "e  Seams: mean jerk of all joints, folded on the windows"
    periods = "e  Periods: mean jerk of the body part that repeats, folded on the period found"
    return [
        ("depth", depth, _JERK, sheet.by_depth, NO_DATA),
        ("joints", "b  Jerk of each joint, as generated", _JERK, sheet.by_joint, NO_DATA),
        ("spectrum", f"c  Velocity spectrum: {sheet.point}", "power (%)", sheet.spectrum, NO_DATA),
        ("attribution", attribution, "drop (%)", sheet.attribution, NO_DATA),
        ("seams", seams if is_known else periods, _JERK, sheet.by_phase,
         NO_DATA if is_known else NO_PERIOD),
    ]  # fmt: skip


def _draw_curves(
    axes: "Axes", curves: Curves, sheet: JitterSheet, is_dense: bool, without: str
) -> None:
    """Lines in the systems' styles, with their markers at every point or at a few."""
    if not curves:
        axes.text(
            0.5, 0.5, fill(without, 44), transform=axes.transAxes, ha="center", va="center",
            size=style.SMALL_PT, color=style.FAINT_INK, in_layout=False,
        )  # fmt: skip
        axes.set_axis_off()  # a scale of nothing would say something
    for order, (name, (x, y)) in enumerate(curves.items()):
        every = 1 if is_dense or len(x) <= 2 * _MARKERS else max(1, len(x) // _MARKERS)
        # Markers of the curves stand at different places, so that none hides another.
        start = 0 if every == 1 else (order * every) // max(1, len(curves))
        looks = sheet.styles[name].line_properties
        if is_dense:
            looks |= {"markersize": 0.8 * style.MARKER_PT, "linewidth": 0.6}
        axes.plot(x, y, label=name, markevery=(start, every), **looks)


def _scale(axes: "Axes", row: str, curves: Sequence[Curves]) -> None:
    """One scale for the panels of a row: logarithmic for a spectrum and for jerks that are far
    apart, where what is 0 has no place and is a gap."""
    values = np.concatenate([y[np.isfinite(y)] for panel in curves for _, y in panel.values()])
    highest = [float(np.nanmax(y)) for panel in curves for _, y in panel.values()]
    if row == "attribution":
        room = 0.08 * float(np.ptp([*values, 0.0])) or 1.0
        axes.set_ylim(values.min(initial=0.0) - room, values.max(initial=0.0) + room)
    elif row == "spectrum" or max(highest) > LOG_FROM * max(min(highest), 1e-9):
        positive = values[values > 0.0]
        if positive.size:
            top = float(positive.max())
            axes.set_yscale("log", nonpositive="mask")
            axes.set_ylim(max(float(positive.min()), top / 1e5) / 1.3, 1.3 * top)
            axes.yaxis.set_major_formatter("{x:g}")
            axes.minorticks_off()
    else:
        style.from_zero(axes, values)


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
