"""The page that figures share: margins, type and keys at places in inches."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from renderer.figures import style
from renderer.figures.style import FIGURE_WIDTH_IN, LABEL_PT, text_width_in, wrap_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MARGIN = 0.08
LINE = 0.135  # one line of label type with its leading
SMALL_LINE = 0.115
TITLE = 0.19
TITLE_GAP = 0.06
CAPTION_GAP = 0.1
SWATCH = 0.36  # line sample in front of a system's name
SWATCH_GAP = 0.06
KEY_GAP = 0.25
NAME_BREAKS = "/-_. "


@dataclass(frozen=True)
class Rect:
    """A rectangle in inches; ``top`` counts downwards from the top of the figure."""

    left: float
    top: float
    width: float
    height: float

    @property
    def bottom(self) -> float:
        return self.top + self.height

    @property
    def right(self) -> float:
        return self.left + self.width

    def fraction_of(self, figure_height: float) -> tuple[float, float, float, float]:
        """(left, bottom, width, height) as fractions of the figure, bottom counted upwards."""
        return (
            self.left / FIGURE_WIDTH_IN,
            1.0 - self.bottom / figure_height,
            self.width / FIGURE_WIDTH_IN,
            self.height / figure_height,
        )


@dataclass(frozen=True)
class Key:
    """A line sample with the name of its system."""

    name: str
    lines: tuple[str, ...]
    rect: Rect


def place_legend(names: tuple[str, ...]) -> tuple[tuple[Key, ...], float]:
    """Keys in equal columns across the figure, as many as fit; and where they end."""
    usable = FIGURE_WIDTH_IN - 2 * MARGIN
    wrapped = [wrap_name(name, usable - SWATCH - SWATCH_GAP) for name in names]
    widths = [text_width_in(line, LABEL_PT) for lines in wrapped for line in lines]
    key_width = SWATCH + SWATCH_GAP + max(widths, default=0.0)
    columns = max(1, min(len(names), int((usable + KEY_GAP) / (key_width + KEY_GAP))))
    keys, top = [], MARGIN
    for start in range(0, len(names), columns):
        row = wrapped[start : start + columns]
        height = max(len(lines) for lines in row) * LINE
        for column, lines in enumerate(row):
            left = MARGIN + column * (key_width + KEY_GAP)
            keys.append(Key(names[start + column], lines, Rect(left, top, key_width, height)))
        top += height
    return tuple(keys), top


def begin_page(
    names: tuple[str, ...], reference: str | None, body_height: float, caption: str
) -> tuple["Figure", float, dict[str, style.SeriesStyle]]:
    """A figure of one body, with the keys of ``names`` above and its caption below: where the body
    begins, and how each name is drawn."""
    from matplotlib.figure import Figure

    styles = style.styles_of(names, reference)
    keys, top = place_legend(names)
    lines = caption_lines(caption)
    caption_top = top + body_height + CAPTION_GAP
    height = caption_top + len(lines) * SMALL_LINE + MARGIN
    figure = Figure(figsize=(FIGURE_WIDTH_IN, height), facecolor="white")
    for key in keys:
        draw_key(figure, key, styles[key.name])
    write_caption(figure, lines, caption_top)
    return figure, top, styles


def wrap_name(name: str, width: float) -> tuple[str, ...]:
    """A name on as many lines as it needs, broken at its own separators where it can be."""
    return tuple(wrap_text(name, LABEL_PT, width, breaks_after=NAME_BREAKS))


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
