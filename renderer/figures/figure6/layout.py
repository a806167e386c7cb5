"""Layout of Figure 6.

Up to two systems share plots, as in the paper; of more, each has a row of small ones, with the
reference or the first system faint behind. Tremor has a separate scale, because a path of 30 cm
hides a tremor of 2 mm.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from renderer.figures import style
from renderer.figures.figure6 import snapshots
from renderer.figures.figure6.contents import CUT_OFF_HZ, PANELS, Figure6
from renderer.figures.figure6.panels import (
    PanelRow,
    draw_coordinates,
    draw_path,
    draw_tremor,
    grid_pitch_m,
)
from renderer.figures.figure6.snapshots import AROUND_MM, KEY_MM, SnapshotStrips
from renderer.figures.style import MAX_HEIGHT_MM

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TITLE_MM, _TIME_MM, _FRAME_MM = 4.5, 7.0, 3.0
_SNAPSHOTS_MM = 62.0  # least width, for the title and the legend of marks
_COLUMN_MM = {"ac": (26.0, 11.5), "b": (28.0, 7.5), "d": (11.0, 11.5)}
"""Heights of a column figure: of each motion, and of the titles, frame numbers and times."""


def column_figure_fits_page(num_motions: int, panels: Sequence[str]) -> bool:
    """Check whether a column figure with this many motions is no taller than a page."""
    rows = [mm for letters, mm in _COLUMN_MM.items() if {*letters} & {*panels}]
    return sum(num_motions * each + fixed for each, fixed in rows) <= MAX_HEIGHT_MM


def draw_figure6(contents: Figure6) -> "Figure":
    """Return the figure without a canvas, sized in inches as on paper."""
    strips = SnapshotStrips.from_contents(contents) if "b" in contents.panels else None
    rows = list(_plan(contents, strips.aspect if strips else 1.0))
    heights = [row.height_mm for row in rows]
    is_shared = contents.is_in_one_plot
    total = min(sum(heights), MAX_HEIGHT_MM) if is_shared else sum(heights)
    figure = style.new_figure(contents.width_mm, total)
    titles = {
        "a": contents.tracked_point,
        "b": "Snapshots by frame",
        "c": f"Path ({grid_pitch_m(contents):g} m grid)",
        "d": f"Tremor above {CUT_OFF_HZ:g} Hz",
    }
    draw: dict[str, Any] = {"a": draw_coordinates, "c": draw_path, "d": draw_tremor}
    if strips:
        draw["b"] = partial(snapshots.draw_snapshots, strips=strips)
    legend_panel = next((p for p in "ac" if is_shared and p in contents.panels), "")
    shown = dict.fromkeys(panel for row in rows for panel in row.panels)
    letters = dict(zip(shown, PANELS, strict=False))  # in the order of the page
    parts = figure.subfigures(len(rows), 1, squeeze=False, height_ratios=heights)[:, 0]
    for row, part in zip(rows, parts, strict=True):
        if len(row.motion_names) == 1 and row.panels != ("d",) and not is_shared:
            style.draw_legend(part, {name: contents.styles[name] for name in row.motion_names})
        places = part.subfigures(1, len(row.panels), squeeze=False, width_ratios=row.widths_mm)[0]
        for panel, place in zip(row.panels, places, strict=True):
            if row.has_titles:
                style.write_title(place, f"{letters[panel]}  {titles[panel]}")
            if row.has_titles and panel == "b":
                snapshots.draw_mark_legend(place, contents)
            if row.motion_names and panel == legend_panel:
                place = place.subfigures()  # below the title
                style.draw_legend(place, contents.styles)
            if row.motion_names:
                draw[panel](place, contents, row)
    return figure


def _plan(contents: Figure6, aspect: float) -> Iterator[PanelRow]:
    """Yield the rows from the top; ``aspect`` is width over height of a row of snapshots."""
    names, width = contents.motion_names, contents.width_mm
    count, is_wide = len(names), contents.width_mm > 1.5 * style.COLUMN_MM

    def rows(panels: str, groups: Sequence[tuple[str, ...]], height: float, *widths: float) -> Any:
        shown = [(p, w) for p, w in zip(panels, widths, strict=True) if p in contents.panels]
        if not shown:
            return
        letters, shares = zip(*shown, strict=True)
        has_header = len(groups) > 1
        if has_header:
            yield PanelRow((), letters, _TITLE_MM, shares, True)
        for group in groups:
            above = _FRAME_MM * (group == groups[0] and "b" in letters)
            below = _TIME_MM * (group == groups[-1] and letters != ("b",))
            total = height + above + below + _TITLE_MM * (not has_header)
            yield PanelRow(group, letters, total, shares, not has_header, above, below)

    if contents.is_in_one_plot:
        strips = count * (14.0 if is_wide else 12.0)
        room = 0.6 * width if is_wide and "a" in contents.panels else width
        each = min(room / aspect, (150.0 if is_wide else 75.0) / count)
        pictures = count * (each + 1.5 * KEY_MM)
        if is_wide:
            beside = max(each * aspect + 3.0, _SNAPSHOTS_MM)
            tall = {"a": 74.0, "b": pictures - _TIME_MM, "c": 56.0, "d": strips}
            tall = {panel: mm if panel in contents.panels else 0.0 for panel, mm in tall.items()}
            high, low = max(tall["a"], tall["b"]), max(tall["c"], tall["d"])
            yield from rows("ab", [names], high, max(width - beside, 1.0), beside)
            yield from rows("cd", [names], low, 0.38 * width, 0.62 * width)
        else:
            for panel, height in zip("abcd", (56.0, pictures, 42.0, strips), strict=True):
                yield from rows(panel, [names], height, width)
        return
    alone = [(name,) for name in names]
    if is_wide:
        strips = min(count * 12.0, 50.0) if "d" in contents.panels else -_TITLE_MM - _TIME_MM
        room = MAX_HEIGHT_MM - 2 * (_TITLE_MM + _TIME_MM) - _FRAME_MM - strips
        height = min(36.0, room / count, max(0.58 * width / aspect + AROUND_MM, 28.0))
        pictures = min((height - AROUND_MM) * aspect + 1.0, 0.58 * width)
        beside = max(pictures, _SNAPSHOTS_MM)
        path = min(0.45 * (width - beside), 1.3 * height)
        yield from rows("abc", alone, height, width - beside - path, beside, path)
    else:
        (path, _), (pictures, _), (strip, _) = _COLUMN_MM.values()
        strips, each = count * strip, min(width / aspect, pictures - KEY_MM)
        yield from rows("ac", alone, path, 0.65 * width, 0.35 * width)
        yield from rows("b", [names], count * (each + KEY_MM), width)
    yield from rows("d", [names], strips, width)
