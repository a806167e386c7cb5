"""Where each panel of the jitter sheet goes, in inches, before anything is drawn."""

from dataclasses import dataclass

from renderer.figures.page import (
    CAPTION_GAP,
    MARGIN,
    SMALL_LINE,
    TITLE,
    Key,
    Rect,
    place_legend,
)
from renderer.figures.style import FIGURE_WIDTH_IN

COLUMN_HEADS = 0.16
AXIS_LABELS = 0.54  # left of a panel: its label and its numbers
TICK_LABELS = 0.14
X_LABEL = 0.15
NAMES_BELOW = {"joints": 0.47, "attribution": 0.55}  # names of joints that stand upright
GAP = 0.12  # between panels side by side, and below the labels of a row
MAX_HEIGHT = 9.15  # it goes on a page
PLOT_HEIGHT = 1.05

ROWS = ("depth", "joints", "spectrum", "attribution", "seams")


@dataclass(frozen=True)
class SheetLayout:
    """Places of the parts of the jitter sheet."""

    height: float
    legend: tuple[Key, ...]
    heads_top: float
    panels: dict[str, tuple[Rect, ...]]
    """Raw and filtered side by side; one wide panel for the joints."""
    caption_top: float


def plan_sheet(names: tuple[str, ...], num_caption_lines: int) -> SheetLayout:
    """Place legend, rows of panels and caption below each other; panels shrink to fit a page."""
    legend, legend_bottom = place_legend(names)
    caption_height = CAPTION_GAP + num_caption_lines * SMALL_LINE + MARGIN
    heads_top = legend_bottom + 0.08
    labels = sum(_labels_below(row) + TITLE for row in ROWS) + (len(ROWS) - 1) * GAP
    free = MAX_HEIGHT - heads_top - COLUMN_HEADS - labels - caption_height
    plot_height = min(PLOT_HEIGHT, free / len(ROWS))

    wide = FIGURE_WIDTH_IN - MARGIN - AXIS_LABELS - MARGIN
    half = (wide - GAP) / 2.0
    left = MARGIN + AXIS_LABELS
    top = heads_top + COLUMN_HEADS
    panels = {}
    for row in ROWS:
        top += TITLE
        if row == "joints":
            panels[row] = (Rect(left, top, wide, plot_height),)
        else:
            lefts = (left, left + half + GAP)
            panels[row] = tuple(Rect(each, top, half, plot_height) for each in lefts)
        top += plot_height + _labels_below(row) + GAP
    body_bottom = top - GAP
    return SheetLayout(
        height=body_bottom + caption_height,
        legend=legend,
        heads_top=heads_top,
        panels=panels,
        caption_top=body_bottom + CAPTION_GAP,
    )


def _labels_below(row: str) -> float:
    return NAMES_BELOW.get(row, TICK_LABELS + X_LABEL)
