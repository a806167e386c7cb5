"""The error-growth experiment as a small figure: spread along the chain for local and global noise.

Marks are measured, lines are the closed form; drawn from plain numbers, as those of
``model.measures.error_growth.ErrorGrowth``.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from renderer.figures import style
from renderer.figures.files import FigureFiles, matplotlib_settings, write_figure
from renderer.figures.page import MARGIN, SMALL_LINE, Rect, short_name, write

if TYPE_CHECKING:
    from matplotlib.figure import Figure


WIDTH_IN = 3.4
"""One column of a two-column page."""
_PLOT = Rect(0.48, 0.12, WIDTH_IN - 0.48 - MARGIN, 1.7)
_NAMES_BELOW = 0.72
_HEADROOM = 1.45  # the legend stands above the curves


@dataclass(frozen=True)
class Spreads:
    """How far points along the chain move by noise, in metres: measured, and predicted."""

    points: tuple[str, ...]
    local: Float[np.ndarray, " points"]
    """With noise on the local rotations."""
    world: Float[np.ndarray, " points"]
    """With noise on the global rotations."""
    predicted_local: Float[np.ndarray, " points"]
    predicted_world: Float[np.ndarray, " points"]


def error_growth_figure(spreads: Spreads, out_stem: Path, *, sentence: str = "") -> FigureFiles:
    """Write ``<out_stem>.png``, ``.svg`` and ``.pdf``; each appears whole or not at all.

    Args:
        out_stem: path without an extension; its folder is made.
        sentence: what the numbers say, below the plot.
    """
    with matplotlib_settings():
        return write_figure(draw_error_growth(spreads, sentence), out_stem, sentence)


def draw_error_growth(spreads: Spreads, sentence: str) -> "Figure":
    """The figure, without a canvas."""
    from matplotlib.figure import Figure

    lines = style.wrap_text(sentence, style.SMALL_PT, WIDTH_IN - 2 * MARGIN) if sentence else []
    height = _PLOT.bottom + _NAMES_BELOW + len(lines) * SMALL_LINE + MARGIN
    figure = Figure(figsize=(WIDTH_IN, height), facecolor="white")
    left, bottom = _PLOT.left / WIDTH_IN, 1.0 - _PLOT.bottom / height
    axes = figure.add_axes((left, bottom, _PLOT.width / WIDTH_IN, _PLOT.height / height))
    places = np.arange(len(spreads.points))
    highest = 0.0
    for form, measured, predicted, series in (
        ("local", spreads.local, spreads.predicted_local, style.SYSTEM_STYLES[0]),
        ("global", spreads.world, spreads.predicted_world, style.SYSTEM_STYLES[2]),
    ):
        looks = series.line_properties
        line = {key: looks[key] for key in ("color", "linestyle", "linewidth", "gapcolor")}
        axes.plot(places, 100.0 * predicted, label=f"{form} noise, predicted", **line)
        marks = looks | {"linestyle": "none", "gapcolor": None}
        axes.plot(places, 100.0 * measured, label=f"{form} noise, measured", **marks)
        highest = np.nanmax([*(100.0 * measured), *(100.0 * predicted)], initial=highest)
    axes.set_ylim(0.0, _HEADROOM * highest or 1.0)
    axes.set_xlim(-0.6, len(spreads.points) - 0.4)
    axes.grid(axis="y")
    axes.set_axisbelow(True)
    axes.set_xticks(places, [short_name(point) for point in spreads.points], rotation=90)
    axes.set_ylabel("root mean square shift (cm)", size=style.LABEL_PT, labelpad=2.0)
    axes.legend(loc="upper left", ncols=2, frameon=False, fontsize=style.SMALL_PT)
    for i, text in enumerate(lines):
        top = _PLOT.bottom + _NAMES_BELOW + i * SMALL_LINE
        write(figure, MARGIN, top, text, size=style.SMALL_PT, color=style.FAINT_INK, va="top")
    return figure
