"""Figure 6 of the GlobalDiff paper for any motions: fingertip path, snapshots and tremor.

Up to two systems share plots, as in the paper; of more, each has a row of small ones, with the
reference or the first system faint behind. Tremor has a separate scale, because a path of 30 cm
hides a tremor of 2 mm. Positions and pictures are inputs; nothing here computes them.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from scipy.signal import butter, sosfiltfilt

from conventions.names import PostFilter
from renderer.figures import style
from renderer.figures.style import (
    MAX_HEIGHT_MM,
    MAX_SYSTEMS,
    PAGE_MM,
    SMALL_PT,
    FigureError,
    SeriesStyle,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

CUT_OFF_HZ, ORDER = 5.0, 4
MIN_FRAMES = 32
"""Shortest window (frames) for tremor: about a second, so that the 5 Hz filter can separate it."""
WINDOW_FRAMES = 300
SNAPSHOT_EVERY = 50
COORDINATES = ("x", "y", "z")
PANELS = ("a", "b", "c", "d")
"""Panels: coordinates (a), snapshots (b), path in space (c), tremor (d)."""
MOST_IN_ONE_PLOT = 2
"""Largest number of systems in one plot, as in the paper; with more, each has its own row."""
ONE_SEED_CAVEAT = "One clip and one noise seed: an example, not a comparison of the systems."
MIN_MARK_STRENGTH = 0.12
"""Share of the full scale below which no mark is drawn, as every joint of a moving body has some.
"""
MIN_SPAN_M = 0.02
"""Shortest axis (m), used for a point that does not move."""
MARK_RGB = (0.29, 0.08, 0.43)
_MIN_SHARE = 0.2  # least share of the height for the flattest coordinate
_FAINT = 0.3
_KEY_MM, _TITLE_MM, _TIME_MM, _FRAME_MM = 4.0, 4.5, 7.0, 3.0
_SNAPSHOTS_MM = 36.0  # least width, for the title
_AROUND_MM = _KEY_MM + 2.0  # above and below the snapshots of one motion
_COLUMN_MM = {"ac": 26.0, "b": 28.0, "d": 11.0}  # height per motion in a column figure
_HEAD, _SIDE, _FOOT = 0.16, 0.09, 0.07
"""Room around the outermost joints, as shares of the height of all joints."""
_FILTERED: dict[PostFilter, str] = {
    "none": "Raw motion, no filter.",
    "savgol": "Filtered motion (Savitzky-Golay, 7 frames, order 2, on every curve alike).",
}


def high_pass_mm(positions: Float[np.ndarray, "T 3"], fps: float) -> Float[np.ndarray, "T 3"]:
    """Return positions (m) high-passed at 5 Hz in millimetres (zero-phase Butterworth, order 4)."""
    low = butter(ORDER, CUT_OFF_HZ, fs=fps, output="sos")
    exact = np.asarray(positions, np.float64)
    return 1000.0 * (exact - sosfiltfilt(low, exact, axis=0))


@dataclass(frozen=True)
class JointMarks:
    """Pixel positions and values of the joints in each snapshot."""

    pixels: Mapping[str, np.ndarray]
    """Pixels (N, J, 2) from the upper left corner, by motion; NaN draws nothing."""
    values: Mapping[str, np.ndarray]
    """Jerk (N, J) in m/s³, by motion; NaN draws nothing."""
    full_scale: float
    """Value of the strongest mark (m/s³); larger values look the same."""

    @property
    def caption(self) -> str:
        return (
            "Marks: jerk of each joint around the frame, largest and darkest at"
            f" {self.full_scale:g} m/s³ and above, none below"
            f" {MIN_MARK_STRENGTH * self.full_scale:g} m/s³."
        )


def fits_column(num_motions: int, panels: Sequence[str]) -> bool:
    """Check whether a column figure with this many motions is no taller than a page."""
    each_mm = sum(mm for letters, mm in _COLUMN_MM.items() if {*letters} & {*panels})
    return num_motions * each_mm + 35.0 <= MAX_HEIGHT_MM  # with titles, keys and times


def choose_snapshot_frames(num_frames: int, start_frame: int = 0) -> tuple[int, ...]:
    """Return the snapshot frames: every 50 frames from the start of the window."""
    end = min(num_frames, start_frame + WINDOW_FRAMES)
    return tuple(range(start_frame, end, SNAPSHOT_EVERY))


@dataclass(frozen=True)
class Figure6:
    """Contents of one Figure 6.

    Raises:
        FigureError: with one sentence that names the limit and the value.
    """

    trajectories: Mapping[str, np.ndarray]
    """Positions (T, 3) of the tracked point in metres, y up, from the clip's first frame, by
    motion: one to six systems and the reference. Longer ones are cut to the shortest."""
    snapshots: Mapping[str, np.ndarray]
    """Pictures (N, H, W, 3) uint8 of one camera, for at least the same names; may be empty."""
    snapshot_frames: Sequence[int]
    """Frames at which the snapshots were taken, see :func:`choose_snapshot_frames`."""
    fps: float = 30.0
    marks: JointMarks | None = None
    """Joints by which snapshots are cropped and marked; required with snapshots."""
    reference: str | None = None
    """Name of the recorded motion, drawn first and in black; None without one."""
    start_frame: int = 0
    point: str = "Right middle fingertip"
    tip_source: str = ""
    """Location of the point on the body, such as ``rigid`` or ``vertex 7794``, for the caption."""
    post_filter: PostFilter = "none"
    """Filter that was applied to all trajectories, for the caption; not applied here."""
    clip: str = ""
    caveat: str = ONE_SEED_CAVEAT
    requested_panels: Sequence[str] = PANELS
    """Requested panels; those without data are left out."""
    width_mm: float = PAGE_MM

    def __post_init__(self) -> None:
        if self.reference is not None and self.reference not in self.trajectories:
            raise FigureError(
                f"The reference {self.reference!r} has no trajectory; there are"
                f" {', '.join(map(repr, self.trajectories))}."
            )
        count = len(self.trajectories) - (self.reference is not None)
        if not 1 <= count <= MAX_SYSTEMS:
            raise FigureError(
                f"Figure 6 holds 1 to {MAX_SYSTEMS} systems beside the reference; got {count}."
            )
        for name, positions in self.trajectories.items():
            if len(positions) <= self.start_frame:
                raise FigureError(
                    f"The window starts at frame {self.start_frame}, but {name!r} has only"
                    f" {len(positions)} frames; choose an earlier start."
                )
            if not np.isfinite(self.paths[name]).all():
                bad = int(np.flatnonzero(~np.isfinite(self.paths[name]).all(axis=1))[0])
                raise FigureError(
                    f"The trajectory of {name!r} is not a number at frame {self.start_frame + bad}."
                )
        if self.snapshots and (self.marks is None or set(self.names) - set(self.snapshots)):
            raise FigureError(
                f"Snapshots, their marks and trajectories must be of the same systems; got"
                f" snapshots of {', '.join(map(repr, self.snapshots))} and trajectories of"
                f" {', '.join(map(repr, self.names))}."
            )
        if not self.panels:
            raise FigureError(
                f"Of the panels {', '.join(self.requested_panels)} none has anything to show:"
                f" snapshots (b) need pictures, and tremble (d) needs {MIN_FRAMES} frames."
            )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the motions, the reference first."""
        return tuple(sorted(self.trajectories, key=lambda name: name != self.reference))

    @cached_property
    def paths(self) -> dict[str, np.ndarray]:
        """Positions (T, 3) in metres inside the window, by motion."""
        end = self.start_frame + min(self._lengths)
        return {name: np.asarray(self.trajectories[name])[self.start_frame : end]
                for name in self.names}  # fmt: skip

    @cached_property
    def _lengths(self) -> list[int]:
        """Frames inside the window."""
        lengths = (len(each) - self.start_frame for each in self.trajectories.values())
        return [min(length, WINDOW_FRAMES) for length in lengths]

    @cached_property
    def tremble(self) -> dict[str, np.ndarray]:
        """Positions (T, 3) above 5 Hz in millimetres, by motion; empty for a short window."""
        if min(self._lengths) < MIN_FRAMES:
            return {}
        inside = slice(self.start_frame, self.start_frame + self.num_frames)
        return {
            name: high_pass_mm(self.trajectories[name], self.fps)[inside] for name in self.names
        }

    @cached_property
    def panels(self) -> tuple[str, ...]:
        """Requested panels that have data, in the order of `PANELS`."""
        has = {"b": bool(self.snapshots), "d": min(self._lengths) >= MIN_FRAMES}
        return tuple(
            letter for letter in PANELS if letter in self.requested_panels and has.get(letter, True)
        )

    @property
    def num_frames(self) -> int:
        return min(self._lengths)

    @property
    def times(self) -> np.ndarray:
        """Times of the window's frames (s)."""
        return (self.start_frame + np.arange(self.num_frames)) / self.fps

    @property
    def styles(self) -> dict[str, SeriesStyle]:
        return style.series_styles(self.names, self.reference)

    @property
    def is_in_one_plot(self) -> bool:
        """True if all curves share plots; otherwise each motion has small plots."""
        return len(self.names) - (self.reference is not None) <= MOST_IN_ONE_PLOT

    @property
    def shown_frames(self) -> tuple[int, ...]:
        """Frames of the snapshots inside the window, counted from its start."""
        if "b" not in self.panels:
            return ()
        inside = (frame - self.start_frame for frame in self.snapshot_frames)
        return tuple(frame for frame in inside if 0 <= frame < self.num_frames)

    @property
    def marker_frames(self) -> list[int]:
        """Frames of the curves' markers: those of the snapshots, or else six evenly spaced."""
        evenly = np.linspace(0, self.num_frames, 6, endpoint=False).astype(int)
        return list(self.shown_frames) or sorted({int(frame) for frame in evenly})

    @property
    def caption(self) -> str:
        last_frame = self.start_frame + self.num_frames - 1
        clip = f" of {self.clip}" if self.clip else ""
        told = {
            f"{self.point}, frames {self.start_frame} to {last_frame}{clip}"
            f" at {self.fps:g} fps; metres, y up, one scale for x, y and z.": True,
            f"One row per motion; faint in each row: {self.names[0]}.": not self.is_in_one_plot,
            "All motions are cut to the length of the shortest.":
                max(self._lengths) > min(self._lengths),
            "Grey lines and markers: the frames of the snapshots.": self.shown_frames,
            self.marks.caption if self.marks else "": "b" in self.panels,
            f"Position above {CUT_OFF_HZ:g} Hz (high-pass filtered), on one scale.": "d"
            in self.panels,
            f"Fingertip position: {self.tip_source}.": self.tip_source,
            _FILTERED[self.post_filter]: True,
            self.caveat: self.caveat,
        }  # fmt: skip
        return " ".join(sentence for sentence, is_true in told.items() if is_true)


@dataclass(frozen=True)
class PanelRow:
    """Row of adjacent panels of some motions; a row without motions holds only titles."""

    names: tuple[str, ...]
    panels: tuple[str, ...]
    height_mm: float
    widths_mm: tuple[float, ...]
    has_titles: bool
    is_first: bool
    is_last: bool
    """True if the row is the last of its panels and has the time axis; the first has frame numbers.
    """
    extra_mm: tuple[float, float] = (0.0, 0.0)
    """Height (mm) of frame numbers above and times below, which only the first and last row have.
    """


def draw_figure6(contents: Figure6) -> "Figure":
    """Return the figure without a canvas, sized in inches as on paper."""
    cells = Cells.of(contents) if "b" in contents.panels else None
    rows = list(_plan(contents, cells.aspect * cells.count if cells else 1.0))
    heights = [row.height_mm for row in rows]
    total = 2 * _KEY_MM + sum(heights)
    total = min(total, MAX_HEIGHT_MM) if contents.is_in_one_plot else total
    figure = style.new_figure(contents.width_mm, total)
    marks = _mark_samples(contents) if cells else []
    has_lines = contents.is_in_one_plot and {"a", "c"} & {*contents.panels}
    style.draw_keys(figure, contents.styles if has_lines else {}, marks)
    titles = {
        "a": contents.point,
        "b": "Snapshots by frame",
        "c": f"Path, grid {_pitch(_limits(contents, _PATH_ROOM)):g} m",
        "d": f"Position above {CUT_OFF_HZ:g} Hz (x, y, z from top)",
    }
    shown = dict.fromkeys(panel for row in rows for panel in row.panels)
    letters = dict(zip(shown, PANELS, strict=False))  # in the order of the page
    parts = figure.subfigures(len(rows), 1, squeeze=False, height_ratios=heights)[:, 0]
    for row, part in zip(rows, parts, strict=True):
        if len(row.names) == 1 and row.panels != ("d",) and not contents.is_in_one_plot:
            style.draw_keys(part, {name: contents.styles[name] for name in row.names})
        places = part.subfigures(1, len(row.panels), squeeze=False, width_ratios=row.widths_mm)[0]
        for panel, place in zip(row.panels, places, strict=True):
            if row.has_titles:
                style.write_title(place, f"{letters[panel]}  {titles[panel]}")
            if panel == "b" and row.names:
                assert cells is not None
                _snapshots(place, contents, row, cells)
            elif row.names:
                {"a": _coordinates, "c": _path, "d": _strips}[panel](place, contents, row)
    return figure


def _plan(contents: Figure6, aspect: float) -> Iterator[PanelRow]:
    """Yield the rows from the top; ``aspect`` is width over height of a row of snapshots."""
    names, width = contents.names, contents.width_mm
    count, is_wide = len(names), contents.width_mm > 1.5 * style.COLUMN_MM

    def rows(panels: str, groups: Sequence[tuple[str, ...]], height: float, *widths: float) -> Any:
        shown = [(p, w) for p, w in zip(panels, widths, strict=True) if p in contents.panels]
        if not shown:
            return
        letters, shares = zip(*shown, strict=True)
        has_header = len(groups) > 1
        if has_header:
            yield PanelRow((), letters, _TITLE_MM, shares, True, False, False)
        for group in groups:
            first, last = group == groups[0], group == groups[-1]
            above = _FRAME_MM * (first and "b" in letters)
            below = _TIME_MM * (last and letters != ("b",))
            total = height + above + below + _TITLE_MM * (not has_header)
            yield PanelRow(
                group, letters, total, shares, not has_header, first, last, (above, below)
            )

    if contents.is_in_one_plot:
        strips = count * (14.0 if is_wide else 12.0)
        room = 0.6 * width if is_wide and "a" in contents.panels else width
        each = min(room / aspect, (150.0 if is_wide else 75.0) / count)
        pictures = count * (each + 1.5 * _KEY_MM)
        if is_wide:
            beside = max(each * aspect + 3.0, _SNAPSHOTS_MM)
            tall = {"a": 70.0, "b": pictures - _TIME_MM, "c": 52.0, "d": strips}
            tall = {panel: mm if panel in contents.panels else 0.0 for panel, mm in tall.items()}
            high, low = max(tall["a"], tall["b"]), max(tall["c"], tall["d"])
            yield from rows("ab", [names], high, max(width - beside, 1.0), beside)
            yield from rows("cd", [names], low, 0.38 * width, 0.62 * width)
        else:
            for panel, height in zip("abcd", (52.0, pictures, 38.0, strips), strict=True):
                yield from rows(panel, [names], height, width)
        return
    alone = [(name,) for name in names]
    if is_wide:
        strips = min(count * 12.0, 50.0)
        room = MAX_HEIGHT_MM - 2 * _KEY_MM - 2 * (_TITLE_MM + _TIME_MM) - _FRAME_MM - strips
        height = min(36.0, room / count)
        pictures = min((height - _AROUND_MM) * aspect + 1.0, 0.55 * width)
        beside = max(pictures, _SNAPSHOTS_MM)
        path = min(0.45 * (width - beside), 1.3 * height)
        yield from rows("abc", alone, height, width - beside - path, beside, path)
    else:
        strips, each = count * _COLUMN_MM["d"], min(width / aspect, _COLUMN_MM["b"] - _KEY_MM)
        yield from rows("ac", alone, _COLUMN_MM["ac"], 0.65 * width, 0.35 * width)
        yield from rows("b", [names], count * (each + _KEY_MM), width)
    yield from rows("d", [names], strips, width)


def _curves(contents: Figure6, row: PanelRow) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield each motion of a row with its line properties, after the first motion drawn faintly."""
    first = contents.names[0]
    if first not in row.names:
        looks = contents.styles[first].line_properties
        yield first, looks | {"marker": "", "alpha": _FAINT, "zorder": 1.5, "linewidth": 0.7}
    for name in row.names:
        yield name, contents.styles[name].line_properties | {"markevery": contents.marker_frames}


def _limits(contents: Figure6, room: float, least: float = _MIN_SHARE) -> np.ndarray:
    """Return limits of x, y and z (3, 2) in metres, each at least ``least`` of their sum."""
    positions = np.concatenate(list(contents.paths.values())).astype(np.float64)
    low, high = positions.min(axis=0), positions.max(axis=0)
    spans = np.maximum(room * (high - low), MIN_SPAN_M)
    spans = np.maximum(spans, least * spans.sum())
    middle = 0.5 * (low + high)
    return np.stack([middle - spans / 2, middle + spans / 2], axis=1)


def _coordinates(part: "SubFigure", contents: Figure6, row: PanelRow) -> None:
    """Draw x, y and z against time in one scale (metres per inch)."""
    from matplotlib.ticker import MaxNLocator

    least = _MIN_SHARE if contents.is_in_one_plot else 0.3
    limits, times = _limits(contents, 1.14, least), contents.times
    spans = np.ptp(limits, axis=1)
    margin = 0.01 * (times[-1] - times[0]) or 0.5 / contents.fps
    stack = part.subplots(3, 1, sharex=True, squeeze=False, height_ratios=spans)[:, 0]
    for k, (axes, letter) in enumerate(zip(stack, COORDINATES, strict=True)):
        axes.set_label(letter)
        for frame in contents.shown_frames:
            axes.axvline(times[frame], color=style.SNAPSHOT_INK, linewidth=0.5, zorder=0.5)
        for name, looks in _curves(contents, row):
            axes.plot(times, contents.paths[name][:, k], label=name, clip_on=False, **looks)
        axes.set_xlim(times[0] - margin, times[-1] + 3 * margin)
        axes.set_ylim(*limits[k])
        axes.grid(True, axis="y")
        most = max(1, int(0.14 * row.height_mm * spans[k] / spans.sum()))
        bins = most if most > 1 else 6  # a low axis shows its outermost ticks
        ticks = MaxNLocator(bins, steps=[1, 2, 5, 10], min_n_ticks=2).tick_values(*limits[k])
        ticks = ticks[(ticks >= limits[k, 0]) & (ticks <= limits[k, 1])]
        axes.set_yticks(ticks if len(ticks) <= most + 1 else ticks[[0, -1]])
        axes.set_ylabel(f"{letter} (m)", rotation=0, ha="right", va="center")
    _write_times(stack[-1], row)
    part.align_ylabels(stack)


def _write_times(axes: "Axes", row: PanelRow) -> None:
    axes.tick_params(axis="x", labelbottom=row.is_last)
    axes.set_xlabel("time (s)" if row.is_last else "")


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


_PATH_ROOM = 1.06


def _pitch(limits: np.ndarray) -> float:
    """Return the distance (m) between grid lines on the floor and walls."""
    return style.round_below(0.5 * float(np.ptp(limits, axis=1).min()))


def _path(part: "SubFigure", contents: Figure6, row: PanelRow) -> None:
    """Draw the path in space before a floor and two walls, all three axes to one scale."""
    limits = _limits(contents, _PATH_ROOM)
    above, below = (0.0, 0.0) if contents.is_in_one_plot else row.extra_mm
    heights = [mm for mm in (above, row.height_mm - above - below, below) if mm]
    grid = part.add_gridspec(len(heights), 1, height_ratios=heights)
    axes = part.add_subplot(grid[1 if above else 0])  # one scale in all rows
    axes.set_label("path")
    axes.set_aspect("equal")
    axes.set_axis_off()
    pitch = _pitch(limits)
    corner = np.array([limits[0, 1], limits[1, 0], limits[2, 0]])  # floor and walls meet here

    def line(start: np.ndarray, along: int, **looks: Any) -> None:
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
        axes.plot(*(contents.paths[name] @ PROJECTION).T, label=name, **looks)


@dataclass(frozen=True)
class Cells:
    """Snapshots of each motion, cropped to one size around the joints.

    The crop is the same in all pictures of a frame, so bodies keep their size and their position
    relative to other systems, while a walking body stays in the middle.
    """

    rows: dict[str, np.ndarray]
    """Pictures (N, h, w, 3), by motion."""
    pixels: dict[str, np.ndarray]
    """Pixels (N, J, 2) of the joints in the cropped pictures, by motion."""

    @classmethod
    def of(cls, contents: Figure6) -> "Cells":
        assert contents.marks is not None
        pixels = np.stack([np.asarray(contents.marks.pixels[n]) for n in contents.snapshots])
        stack = next(iter(contents.snapshots.values()))
        limits = np.array(stack.shape[2:0:-1])  # width, height
        inside = np.where(np.isfinite(pixels), np.clip(pixels, 0, limits), np.nan)
        has_any = np.isfinite(inside).any(axis=(0, 2, 3))
        inside[:, ~has_any] = 0.5 * limits  # unknown position of the body
        low, high = np.nanmin(inside, axis=(0, 2)), np.nanmax(inside, axis=(0, 2))  # (N, 2)
        tall = float((high - low)[:, 1].max())
        low, high = low - tall * np.array([_SIDE, _HEAD]), high + tall * np.array([_SIDE, _FOOT])
        size = np.ceil((high - low).max(axis=0))
        size = np.where(size < 8, limits, np.minimum(size, limits)).astype(int)
        starts = np.clip(np.rint((low + high - size) / 2), 0, limits - size).astype(int)

        def cut(pictures: np.ndarray) -> np.ndarray:
            pairs = zip(pictures, starts, strict=True)
            return np.stack([p[y : y + size[1], x : x + size[0]] for p, (x, y) in pairs])

        return cls(
            {name: cut(pictures) for name, pictures in contents.snapshots.items()},
            dict(zip(contents.snapshots, pixels - starts[:, None], strict=True)),
        )

    @property
    def count(self) -> int:
        return len(next(iter(self.rows.values())))

    @property
    def gap(self) -> int:
        """Gap between two snapshots (pixels)."""
        return max(1, round(0.03 * next(iter(self.rows.values())).shape[2]))

    @property
    def aspect(self) -> float:
        """Width of one snapshot with its gap, over its height."""
        height, width = next(iter(self.rows.values())).shape[1:3]
        return (width + self.gap) / height


def _snapshots(part: "SubFigure", contents: Figure6, row: PanelRow, cells: Cells) -> None:
    """Draw one row of snapshots per motion, the first below the frame numbers."""
    assert contents.marks is not None
    height_pt = row.height_mm / len(row.names) / 25.4 * 72.0
    rows = part.subplots(len(row.names), 1, squeeze=False)[:, 0]
    for name, axes in zip(row.names, rows, strict=True):
        _, height, width, _ = cells.rows[name].shape
        step = width + cells.gap
        strip = np.full((height, step * cells.count - cells.gap, 3), 255, np.uint8)
        for k, picture in enumerate(cells.rows[name]):
            strip[:, k * step : k * step + width] = picture
        axes.imshow(strip, extent=(0, strip.shape[1], height, 0), label=name)
        if len(row.names) == 1 and not contents.is_in_one_plot:  # equal size in all rows
            tall_mm = row.height_mm - sum(row.extra_mm) - _AROUND_MM
            wide_mm = row.widths_mm[row.panels.index("b")] - 1.0
            axes.set_xlim(0, max(strip.shape[1], wide_mm / tall_mm * height))
        axes.set_label(f"snapshots of {name}")
        axes.set_anchor("NW")
        axes.spines[:].set_visible(False)
        axes.tick_params(length=0, labeltop=row.is_first and axes is rows[0], labelbottom=False)
        places = step * np.arange(cells.count)
        axes.set_xticks(places + width / 2, [str(n) for n in contents.snapshot_frames])
        axes.set_yticks([])
        if len(row.names) > 1:
            axes.set_title(style.cut_text(name, style.LABEL_PT, 0.5 * contents.width_mm))
        joints = cells.pixels[name] + np.stack([places, 0 * places], axis=1)[:, None]
        values = np.asarray(contents.marks.values[name]) / contents.marks.full_scale
        _draw_marks(axes, joints.reshape(-1, 2), values.ravel(), 0.045 * height_pt)


def _draw_marks(axes: "Axes", joints: np.ndarray, values: np.ndarray, largest_pt: float) -> None:
    """Draw dark discs with white rims, visible on any body; the strongest last, no faint ones."""
    strength = np.clip(np.nan_to_num(values), 0.0, 1.0)
    order = np.argsort(strength, kind="stable")
    shown = order[(strength[order] >= MIN_MARK_STRENGTH) & np.isfinite(joints[order]).all(axis=1)]
    opacity = _opacity(strength[shown])
    axes.scatter(
        *joints[shown].T,
        s=np.square(largest_pt * (0.45 + 0.55 * strength[shown])),
        color=[(*MARK_RGB, alpha) for alpha in opacity],
        edgecolor=[(1.0, 1.0, 1.0, alpha) for alpha in opacity],
        linewidth=0.08 * largest_pt,
        zorder=3,
    )


def _opacity(strength: Any) -> Any:
    return 0.9 * (0.25 + 0.75 * strength)


def _mark_samples(contents: Figure6) -> list[Any]:
    """Return legend handles of half and full strength."""
    from matplotlib.lines import Line2D

    marks = contents.marks
    assert marks is not None
    return [
        Line2D(
            [], [], linestyle="", marker="o", markersize=4.5 * (0.45 + 0.55 * strength),
            label=f"jerk {strength * marks.full_scale:g} m/s³",
            markerfacecolor=(*MARK_RGB, _opacity(strength)), markeredgecolor="white",
        )
        for strength in (0.5, 1.0)
    ]  # fmt: skip


def _strips(part: "SubFigure", contents: Figure6, row: PanelRow) -> None:
    """Draw one strip per motion with x above y above z in one scale, and its RMS."""
    times = contents.times
    margin = 0.01 * (times[-1] - times[0])
    sizes = np.abs(np.concatenate(list(contents.tremble.values())))
    apart = max(1.1 * float(np.percentile(sizes, 99.0)), 0.1)
    lifts = apart * np.array([1.0, 0.0, -1.0])
    lifted = {name: values + lifts for name, values in contents.tremble.items()}
    ends = [f(each) for each in lifted.values() for f in (np.min, np.max)]
    low, high = min(*ends, -1.6 * apart), max(*ends, 1.6 * apart)
    bar = style.round_below(apart)
    strips = part.subplots(len(row.names), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for name, axes in zip(row.names, strips, strict=True):
        axes.set_label(f"tremble of {name}")
        axes.plot(times, lifted[name], color=contents.styles[name].color, linewidth=0.6)
        axes.set_yticks(lifts)
        axes.tick_params(axis="y", length=0, labelleft=False)
        axes.grid(True, axis="y")
        rms = float(np.sqrt(np.square(contents.tremble[name]).sum(axis=1).mean()))
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
        _write_times(axes, replace(row, is_last=axes is strips[-1]))
    strips[0].set_xlim(times[0] - margin, times[-1] + 3 * margin)
    strips[0].set_ylim(1.04 * low, 1.04 * high)
