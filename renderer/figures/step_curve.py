"""Quality against time as a small figure: a curve for each system, a mark for each number of steps.

Drawn from plain numbers, as those of ``app.run.experiments.step_curve.StepPoint``.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from conventions.rates import FPS
from renderer.figures import style
from renderer.figures.files import FigureError, FigureFiles, matplotlib_settings, write_figure
from renderer.figures.page import MARGIN, TITLE, Rect, begin_page, write_title

if TYPE_CHECKING:
    from matplotlib.figure import Figure


PANELS = (
    ("tip_jerk_m_s3", "a  Fingertip jerk (m/s\N{SUPERSCRIPT THREE})"),
    ("distance_cm", "b  From the result of most steps (cm)"),
)
REAL_TIME_MS = 1000.0 / FPS
_LEFT, _HEIGHT, _BETWEEN, _TIMES = 0.38, 2.1, 0.45, 0.36


@dataclass(frozen=True)
class Mark:
    """One system with one number of steps."""

    system: str
    steps: int
    ms_per_frame: float
    tip_jerk_m_s3: float
    distance_cm: float
    """Of its joints to where the most steps bring them."""


def step_curve_figure(points: Sequence[Mark], out_stem: Path) -> FigureFiles:
    """Write ``<out_stem>.png``, ``.svg`` and ``.pdf``; each appears whole or not at all.

    Args:
        points: those of one system by rising steps.
        out_stem: path without an extension; its folder is made.

    Raises:
        FigureError: if there is no point, or one with a number that cannot be drawn.
    """
    if not points:
        raise FigureError("There is no point to draw.")
    for point in points:
        numbers = [point.ms_per_frame, point.tip_jerk_m_s3, point.distance_cm]
        if not np.isfinite(numbers).all() or point.ms_per_frame <= 0:
            raise FigureError(
                f"{point.system} with {point.steps} steps has a number that cannot be drawn."
            )
    caption = (
        "Each mark is one motion of the same speech, with its number of steps beside it; time is by"
        " the clock of this machine, one motion at a time, features of the speech included."
        " Samplers that draw noise in every step (the GAN's, few-step consistency) end elsewhere"
        " with every number of steps. One clip and one noise seed."
    )
    with matplotlib_settings():
        return write_figure(draw_step_curve(points, caption), out_stem, description=caption)


def draw_step_curve(points: Sequence[Mark], caption: str = "") -> "Figure":
    """The figure, without a canvas."""
    names = tuple(dict.fromkeys(point.system for point in points))
    above = 0.06 + TITLE
    figure, top, styles = begin_page(names, None, above + _HEIGHT + _TIMES, caption)
    top += above
    height = figure.get_figheight()
    width = (style.FIGURE_WIDTH_IN - 2 * MARGIN - 2 * _LEFT - _BETWEEN) / 2
    times = [point.ms_per_frame for point in points]
    for number, (quantity, title) in enumerate(PANELS):
        left = MARGIN + _LEFT + number * (width + _LEFT + _BETWEEN)
        axes = figure.add_axes(Rect(left, top, width, _HEIGHT).fraction_of(height), label=quantity)
        write_title(figure, left - _LEFT, top - 0.06, title)
        for name in names:
            own = [point for point in points if point.system == name]
            x = [point.ms_per_frame for point in own]
            y = [getattr(point, quantity) for point in own]
            axes.plot(x, y, label=name, **styles[name].line_properties)
            for point, at_x, at_y in zip(own, x, y, strict=True):
                axes.annotate(
                    str(point.steps), (at_x, at_y), xytext=(2.5, 2.5),
                    textcoords="offset points", size=style.SMALL_PT - 1, color=styles[name].color,
                )  # fmt: skip
        axes.set_xscale("log")
        axes.set_xlim(min(times) / 1.3, max(times) * 1.5)
        highest = max(getattr(point, quantity) for point in points)
        axes.set_ylim(0.0, 1.12 * highest or 1.0)
        axes.grid(axis="y")
        axes.set_axisbelow(True)
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlabel("milliseconds a frame", size=style.LABEL_PT, labelpad=2.0)
        if axes.get_xlim()[1] > REAL_TIME_MS:
            axes.axvline(REAL_TIME_MS, color=style.FAINT_INK, linewidth=0.5)
            axes.annotate(
                "real time", (REAL_TIME_MS, highest), size=style.SMALL_PT, rotation=90, va="top",
                ha="right", color=style.FAINT_INK,
            )  # fmt: skip
    return figure
