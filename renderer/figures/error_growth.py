"""The error-growth experiment as a small figure: spread along the chain for local and global noise.

Marks are measured, lines are the closed form; drawn from plain numbers, as those of
``model.measures.error_growth.ErrorGrowth``.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from renderer.figures import style
from renderer.figures.files import FigureError, FigureFiles, matplotlib_settings, write_figure
from renderer.figures.page import MARGIN, SMALL_LINE, Rect, short_name, write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["error_growth_figure"]

WIDTH_IN = 3.4
"""One column of a two-column page."""
_PLOT = Rect(0.48, 0.12, WIDTH_IN - 0.48 - MARGIN, 1.7)
_NAMES_BELOW = 0.72
_HEADROOM = 1.45  # the legend stands above the curves
_FORMS = (("local", style.SYSTEM_STYLES[0]), ("global", style.SYSTEM_STYLES[2]))


def error_growth_figure(
    growth: Mapping[str, Any], out_stem: Path, *, sentence: str = ""
) -> FigureFiles:
    """Write ``<out_stem>.png``, ``.svg`` and ``.pdf``; each appears whole or not at all.

    Args:
        growth: ``points``, P names along the chain, and P numbers in metres each under
            ``local_spread_m``, ``global_spread_m``, ``predicted_local_spread_m`` and
            ``predicted_global_spread_m``.
        out_stem: path without an extension; its folder is made.
        sentence: what the numbers say, below the plot.

    Raises:
        FigureError: if a list is missing, or differs from ``points`` in length.
    """
    curves = _curves(growth)
    with matplotlib_settings():
        return write_figure(
            draw_error_growth(tuple(growth["points"]), curves, sentence), out_stem, sentence
        )


def _curves(growth: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """The four lists in centimetres."""
    count = len(growth.get("points") or ())
    curves = {}
    for form, _ in _FORMS:
        for key in (f"{form}_spread_m", f"predicted_{form}_spread_m"):
            curves[key] = 100.0 * np.array(growth.get(key), dtype=float)
            if not count or curves[key].shape != (count,):
                raise FigureError(
                    f"`{key}` must have one number for each of the {count} points; its shape is"
                    f" {curves[key].shape}."
                )
    return curves


def draw_error_growth(
    points: tuple[str, ...], curves: Mapping[str, np.ndarray], sentence: str
) -> "Figure":
    """The figure, without a canvas.

    Args:
        curves: as :func:`error_growth_figure`, in centimetres.
    """
    from matplotlib.figure import Figure

    lines = style.wrap_text(sentence, style.SMALL_PT, WIDTH_IN - 2 * MARGIN) if sentence else []
    height = _PLOT.bottom + _NAMES_BELOW + len(lines) * SMALL_LINE + MARGIN
    figure = Figure(figsize=(WIDTH_IN, height), facecolor="white")
    left, bottom = _PLOT.left / WIDTH_IN, 1.0 - _PLOT.bottom / height
    axes = figure.add_axes((left, bottom, _PLOT.width / WIDTH_IN, _PLOT.height / height))
    places = np.arange(len(points))
    for form, series in _FORMS:
        looks = series.line_properties
        line = {key: looks[key] for key in ("color", "linestyle", "linewidth", "gapcolor")}
        axes.plot(
            places, curves[f"predicted_{form}_spread_m"], label=f"{form} noise, predicted", **line
        )
        marks = looks | {"linestyle": "none", "gapcolor": None}
        axes.plot(places, curves[f"{form}_spread_m"], label=f"{form} noise, measured", **marks)
    highest = max(float(np.nanmax(curve, initial=0.0)) for curve in curves.values())
    axes.set_ylim(0.0, _HEADROOM * highest or 1.0)
    axes.set_xlim(-0.6, len(points) - 0.4)
    axes.grid(axis="y")
    axes.set_axisbelow(True)
    axes.set_xticks(places, [short_name(point) for point in points], rotation=90)
    axes.set_ylabel("root mean square shift (cm)", size=style.LABEL_PT, labelpad=2.0)
    axes.legend(loc="upper left", ncols=2, frameon=False, fontsize=style.SMALL_PT)
    for i, text in enumerate(lines):
        top = _PLOT.bottom + _NAMES_BELOW + i * SMALL_LINE
        write(figure, MARGIN, top, text, size=style.SMALL_PT, color=style.FAINT_INK, va="top")
    return figure
