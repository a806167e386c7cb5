"""The error-growth experiment as a small figure: spread along the chain for local and global noise.

Marks are measured, lines are the closed form; drawn from plain numbers, as those of
``model.measures.error_growth.ErrorGrowth``.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from renderer.figures import style
from renderer.figures.files import FigureFiles, matplotlib_settings, write_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
    """Write the figure, with what the numbers say as its caption."""
    with matplotlib_settings():
        return write_figure(draw_error_growth(spreads), out_stem, sentence)


def draw_error_growth(spreads: Spreads) -> "Figure":
    """The figure, without a canvas."""
    figure = style.new_figure(style.COLUMN_MM, 70.0)
    axes = figure.subplots()
    places = np.arange(len(spreads.points))
    for form, measured, predicted, series in (
        ("local", spreads.local, spreads.predicted_local, style.SYSTEM_STYLES[0]),
        ("global", spreads.world, spreads.predicted_world, style.SYSTEM_STYLES[2]),
    ):
        looks = series.line_properties
        line: dict[str, Any] = looks | {"marker": ""}
        marks: dict[str, Any] = looks | {"linestyle": "none"}
        axes.plot(places, 100.0 * predicted, label=f"{form} noise, predicted", **line)
        axes.plot(places, 100.0 * measured, label=f"{form} noise, measured", **marks)
    style.from_zero(axes, *(np.asarray(line.get_ydata()) for line in axes.get_lines()))
    style.name_x(axes, [style.short_joint(point) for point in spreads.points])
    axes.set_ylabel("root mean square shift (cm)")
    figure.legend(loc="outside upper left", ncols=2, fontsize=style.SMALL_PT)
    return figure
