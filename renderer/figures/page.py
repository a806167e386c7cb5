"""The page that figures share: margins, lines of type and the legend, in inches."""

from dataclasses import dataclass

from renderer.figures.style import FIGURE_WIDTH_IN, LABEL_PT, text_width_in, wrap_text

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
    widest = max(text_width_in(line, LABEL_PT) for lines in wrapped for line in lines)
    key_width = SWATCH + SWATCH_GAP + widest
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


def wrap_name(name: str, width: float) -> tuple[str, ...]:
    """A name on as many lines as it needs, broken at its own separators where it can be."""
    return tuple(wrap_text(name, LABEL_PT, width, breaks_after=NAME_BREAKS))
