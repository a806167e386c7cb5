"""How measures are spread over clips: of each, the share of clips at or below a value.

Drawn from plain numbers, as those of ``app.run.many.table``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from renderer.figures import style
from renderer.figures.files import FigureError, FigureFiles, matplotlib_settings, write_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


SHOWN_PERCENT = 99.0
"""Of all values of a panel: its axis ends there, so that one clip does not decide what is seen."""
_COLUMNS = 3
_CAPTION = (
    "Height is the share of clips at or below a value; a curve further to the right has more of"
    f" it. Axes end where {SHOWN_PERCENT:g} % of a panel's values lie; a curve that does not"
    " reach 1 has clips beyond. Each clip as it is, never filtered."
)


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
    """Write the figure with its caption.

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
    with matplotlib_settings():
        return write_figure(draw_distributions(panels, reference), out_stem, _CAPTION)


def draw_distributions(panels: Sequence[SpreadPanel], reference: str | None = None) -> "Figure":
    """The figure, without a canvas."""
    styles = style.styles_of(_names(panels), reference)
    num_rows = -(-len(panels) // _COLUMNS)
    figure = style.new_figure(style.PAGE_MM, 10.0 + 42.0 * num_rows)
    style.draw_keys(figure, styles)
    grid = figure.subplots(num_rows, _COLUMNS, sharey=True, squeeze=False).ravel()
    for number, (panel, axes) in enumerate(zip(panels, grid, strict=False)):
        axes.set_label(panel.title)
        axes.set_title(panel.title, size=style.TITLE_PT, weight="bold")
        for name, series in styles.items():
            if panel.values.get(name):
                x, y = _curve(panel.values[name])
                looks = series.line_properties | {"marker": ""}
                axes.plot(x, y, label=name, drawstyle="steps-post", **looks)
        axes.set_xlim(*_limits(panel))
        axes.grid(True, axis="y")
        axes.locator_params(axis="x", nbins=4)
        if number % _COLUMNS == 0:
            axes.set_ylabel("share of clips")
    grid[0].set_ylim(0.0, 1.02)
    grid[0].set_yticks([0.0, 0.5, 1.0])
    for axes in grid[len(panels) :]:
        axes.remove()
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
