"""Text and keys at places in inches, counted from the upper left corner of a figure."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from renderer.figures import style
from renderer.figures.page import LINE, MARGIN, SMALL_LINE, SWATCH, SWATCH_GAP, Key

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write(figure: "Figure", left: float, top: float, text: str, **properties: Any) -> None:
    """Text with its anchor at a place."""
    x, y = left / figure.get_figwidth(), 1.0 - top / figure.get_figheight()
    figure.text(x, y, text, **properties)


def write_title(figure: "Figure", left: float, bottom: float, text: str) -> None:
    """The bold letter and name of a panel."""
    write(figure, left, bottom, text, size=style.TITLE_PT, weight="bold", va="bottom")


def caption_lines(caption: str) -> list[str]:
    """The caption on as many lines as it needs."""
    return style.wrap_text(caption, style.SMALL_PT, style.FIGURE_WIDTH_IN - 2 * MARGIN)


def write_caption(figure: "Figure", lines: Sequence[str], top: float) -> None:
    for i, line in enumerate(lines):
        place = (MARGIN, top + i * SMALL_LINE)
        write(figure, *place, line, size=style.SMALL_PT, color=style.FAINT_INK, va="top")


def draw_key(figure: "Figure", key: Key, series: style.SeriesStyle) -> None:
    """Line sample and name, the sample level with the name's first line."""
    from matplotlib.lines import Line2D

    left, middle = key.rect.left, key.rect.top + 0.5 * LINE
    x = np.array([left, left + 0.5 * SWATCH, left + SWATCH]) / figure.get_figwidth()
    figure.add_artist(
        Line2D(
            x,
            np.full(3, 1.0 - middle / figure.get_figheight()),
            transform=figure.transFigure,
            markevery=[1],
            **series.line_properties,
        )
    )
    for i, line in enumerate(key.lines):
        write(
            figure,
            left + SWATCH + SWATCH_GAP,
            middle + i * LINE,
            line,
            size=style.LABEL_PT,
            va="center_baseline",
        )


def short_name(joint: str) -> str:
    """``left_middle2`` as 'L middle 2'."""
    words = joint.replace("left_", "L ").replace("right_", "R ").replace("_", " ")
    return f"{words[:-1]} {words[-1]}" if words[-1:].isdigit() else words
