"""How measures are spread over clips: of each, the share of clips at or below a value.

Drawn from plain numbers, as those of ``app.run.many.table``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from renderer.figures import style
from renderer.figures.files import FigureError, FigureFiles, matplotlib_settings, write_figure
from renderer.figures.page import MARGIN, TITLE, Rect, begin_page, write_title

if TYPE_CHECKING:
    from matplotlib.figure import Figure


SHOWN_PERCENT = 99.0
"""Of all values of a panel: its axis ends there, so that one clip does not decide what is seen."""
_COLUMNS = 3
_LEFT, _HEIGHT, _BETWEEN, _BELOW = 0.28, 1.15, 0.2, 0.34


@dataclass(frozen=True)
class SpreadPanel:
    """One measure of all clips."""

    title: str
    """With its unit."""
    values: Mapping[str, Sequence[float]]
    """By system, one for each clip that has it."""


def distributions_figure(
    panels: Sequence[SpreadPanel], out_stem: Path, reference: str | None = None
) -> FigureFiles:
    """Write ``<out_stem>.png``, ``.svg`` and ``.pdf``; each appears whole or not at all.

    Args:
        reference: name of the recorded motion's values, drawn black.

    Raises:
        FigureError: if there is nothing to draw, a value is no number, or systems are too many.
    """
    names = _names(panels)
    if not all(any(map(len, panel.values.values())) for panel in panels) or not panels:
        raise FigureError("There is no value to draw.")
    most = len(style.SYSTEM_STYLES)
    if len([name for name in names if name != reference]) > most:
        raise FigureError(f"There are {len(names)} systems; at most {most} can be told apart.")
    if not all(np.isfinite(each).all() for panel in panels for each in panel.values.values()):
        raise FigureError("A value is no number.")
    caption = (
        "Height is the share of clips at or below a value; a curve further to the right has more of"
        f" it. Axes end where {SHOWN_PERCENT:g} % of a panel's values lie; a curve that does not"
        " reach 1 has clips beyond. Each clip as it is, never filtered."
    )
    with matplotlib_settings():
        figure = draw_distributions(panels, caption, reference)
        return write_figure(figure, out_stem, description=caption)


def draw_distributions(
    panels: Sequence[SpreadPanel], caption: str = "", reference: str | None = None
) -> "Figure":
    """The figure, without a canvas."""
    names = _names(panels)
    num_rows = -(-len(panels) // _COLUMNS)
    row_height = TITLE + 0.06 + _HEIGHT + _BELOW
    figure, top, styles = begin_page(names, reference, num_rows * row_height, caption)
    step = (style.FIGURE_WIDTH_IN - 2 * MARGIN + _BETWEEN) / _COLUMNS
    for number, panel in enumerate(panels):
        row, column = divmod(number, _COLUMNS)
        left, at = MARGIN + column * step, top + row * row_height + TITLE + 0.06
        where = Rect(left + _LEFT, at, step - _BETWEEN - _LEFT, _HEIGHT)
        axes = figure.add_axes(where.fraction_of(figure.get_figheight()), label=panel.title)
        write_title(figure, left, at - 0.06, panel.title)
        for name in names:
            if panel.values.get(name):
                x, y = _curve(panel.values[name])
                drawn: dict[str, Any] = {**styles[name].line_properties, "marker": ""}
                axes.plot(x, y, label=name, drawstyle="steps-post", **drawn)
        axes.set_xlim(*_limits(panel))
        axes.set_ylim(0.0, 1.02)
        axes.set_yticks([0.0, 0.5, 1.0], ["0", ".5", "1"] if column == 0 else [])
        axes.grid(axis="y")
        axes.set_axisbelow(True)
        axes.locator_params(axis="x", nbins=4)
    return figure


def _names(panels: Sequence[SpreadPanel]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for panel in panels for name in panel.values))


def _curve(values: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """From 0 at the least value up to 1 at the greatest."""
    ordered = np.sort(np.asarray(values, float))
    return np.r_[ordered[0], ordered], np.arange(len(ordered) + 1) / len(ordered)


def _limits(panel: SpreadPanel) -> tuple[float, float]:
    """From the least value to where most of them lie, with room on either side."""
    values = np.concatenate([np.asarray(each, float) for each in panel.values.values() if each])
    low, high = float(values.min()), float(np.percentile(values, SHOWN_PERCENT))
    room = 0.04 * (high - low) or 0.04 * abs(high) or 1.0
    return low - room, high + room
