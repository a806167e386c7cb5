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

if TYPE_CHECKING:
    from matplotlib.figure import Figure


PANELS = (
    ("tip_jerk_m_s3", "a  Fingertip jerk (m/s\N{SUPERSCRIPT THREE})"),
    ("distance_cm", "b  From the result of most steps (cm)"),
)
REAL_TIME_MS = 1000.0 / FPS
_CAPTION = (
    "Each mark is one motion of the same speech, with its number of steps beside it; time is by"
    " the clock of this machine, one motion at a time, features of the speech included."
    " Samplers that draw noise in every step (the GAN's, few-step consistency) end elsewhere"
    " with every number of steps. One clip and one noise seed."
)


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
    """Write the figure with its caption.

    Args:
        points: those of one system by rising steps.

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
    with matplotlib_settings():
        return write_figure(draw_step_curve(points), out_stem, _CAPTION)


def draw_step_curve(points: Sequence[Mark]) -> "Figure":
    """The figure, without a canvas."""
    styles = style.styles_of(dict.fromkeys(point.system for point in points), None)
    figure = style.new_figure(style.PAGE_MM, 75.0)
    style.draw_keys(figure, styles)
    times = [point.ms_per_frame for point in points]
    for axes, (quantity, title) in zip(figure.subplots(1, 2), PANELS, strict=True):
        axes.set_label(quantity)
        axes.set_title(title, size=style.TITLE_PT, weight="bold")
        for name, series in styles.items():
            own = [point for point in points if point.system == name]
            x = [point.ms_per_frame for point in own]
            y = [getattr(point, quantity) for point in own]
            axes.plot(x, y, label=name, **series.line_properties)
            for point, at_x, at_y in zip(own, x, y, strict=True):
                axes.annotate(
                    str(point.steps), (at_x, at_y), xytext=(2.5, 2.5), textcoords="offset points",
                    size=style.SMALL_PT, color=series.color,
                )  # fmt: skip
        axes.set_xscale("log")
        axes.set_xlim(min(times) / 1.3, max(times) * 1.5)
        style.from_zero(axes, [getattr(point, quantity) for point in points])
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlabel("milliseconds a frame")
        if axes.get_xlim()[1] > REAL_TIME_MS:
            axes.axvline(REAL_TIME_MS, color=style.FAINT_INK, linewidth=0.5)
            axes.annotate(
                "real time", (REAL_TIME_MS, 1.0), xycoords=("data", "axes fraction"), va="top",
                ha="right", size=style.SMALL_PT, rotation=90, color=style.FAINT_INK,
            )  # fmt: skip
    return figure
