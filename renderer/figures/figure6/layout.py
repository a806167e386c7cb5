"""Where each part of Figure 6 goes: plain arithmetic in inches, before anything is drawn."""

from dataclasses import dataclass

from renderer.figures.page import (
    CAPTION_GAP,
    LINE,
    MARGIN,
    SMALL_LINE,
    SWATCH,
    SWATCH_GAP,
    TITLE,
    Key,
    Rect,
    place_legend,
    wrap_name,
)
from renderer.figures.style import FIGURE_WIDTH_IN

FRAME_NUMBERS = 0.085  # the line of frame numbers above the snapshots
GUTTER = 0.22
AXIS_LABELS = 0.25  # left of the coordinate axes: letter, ticks and gaps, without the numbers
TIME_LABELS = 0.33  # below the lowest coordinate axis
COORDINATE_GAP = 0.09
CELL_GAP = 0.03
ROW_GAP = 0.07

HEADER_GAP = 0.02

MIN_STRIP, MAX_STRIP, STRIP_GAP = 0.16, 0.42, 0.03  # one motion's tremble
BODY_GAP = 0.06  # above the title of the strips

MIN_BODY = 3.6
MIN_BODY_WITH_PATH = 4.4
MAX_HEIGHT = 9.0  # of the whole figure: it goes on a page
MIN_CELL_HEIGHT = 0.5
MAX_ROWS_ABOVE_PATH = 4.0
MIN_PATH = 1.8  # height of the 3-D path
MAX_SNAPSHOTS_WIDTH = 3.65
MIN_SNAPSHOTS_WIDTH = 2.5
MAX_CELL_HEIGHT = 1.7


@dataclass(frozen=True)
class Layout:
    """Places of the parts of Figure 6."""

    height: float
    legend: tuple[Key, ...]
    coordinates: Rect
    """The three stacked coordinate axes together, without their labels."""
    path: Rect
    cells: tuple[tuple[Rect, ...], ...]
    """One row of snapshots per system."""
    row_keys: tuple[Key, ...]
    strips: tuple[Rect, ...]
    """One for the tremble of each motion, below everything else; may be empty."""
    caption_top: float


def plan_layout(
    names: tuple[str, ...],
    num_snapshots: int,
    aspect: float,
    caption_lines: int,
    number_width: float,
    num_strips: int = 0,
) -> Layout:
    """Place the parts of Figure 6 without overlap.

    The 3-D path stands below the snapshots when these leave room, else below the coordinates.

    Args:
        names: one per curve, and per row of snapshots.
        num_snapshots: pictures in a row; 0 when there are none.
        aspect: width of a snapshot over its height.
        number_width: inches of the widest number at the coordinate axes.
        num_strips: of tremble.
    """
    strips_height = num_strips * (MIN_STRIP + STRIP_GAP)
    if num_strips:
        strips_height += BODY_GAP + TITLE + TIME_LABELS
    caption_height = CAPTION_GAP + caption_lines * SMALL_LINE + MARGIN
    legend, legend_bottom = place_legend(names)
    body_top = legend_bottom + 0.06 + TITLE

    header_width = MIN_SNAPSHOTS_WIDTH - SWATCH - SWATCH_GAP
    headers = [wrap_name(name, header_width) for name in names] if num_snapshots else []
    without_pictures = FRAME_NUMBERS + sum(
        len(lines) * LINE + HEADER_GAP + ROW_GAP for lines in headers
    )
    gaps = (num_snapshots - 1) * CELL_GAP
    if headers:
        cell_height = min(
            (MAX_SNAPSHOTS_WIDTH - gaps) / num_snapshots / aspect,
            max(
                (MAX_HEIGHT - body_top - strips_height - caption_height - without_pictures)
                / len(headers),
                MIN_CELL_HEIGHT,
            ),
            MAX_CELL_HEIGHT,
        )
        rows_height = without_pictures + len(headers) * cell_height
        right_width = max(num_snapshots * cell_height * aspect + gaps, MIN_SNAPSHOTS_WIDTH)
        path_top = body_top + rows_height + TITLE
    else:
        cell_height, rows_height, right_width = 0.0, 0.0, MAX_SNAPSHOTS_WIDTH
        path_top = body_top

    right_left = FIGURE_WIDTH_IN - MARGIN - right_width
    left_width = right_left - GUTTER - MARGIN
    if rows_height <= MAX_ROWS_ABOVE_PATH:
        body_bottom = max(body_top + MIN_BODY, path_top + MIN_PATH)
        path = Rect(right_left, path_top, right_width, body_bottom - path_top)
        coordinates_bottom = body_bottom - TIME_LABELS
    else:
        body_bottom = body_top + max(MIN_BODY_WITH_PATH, rows_height)
        path_height = 0.36 * (body_bottom - body_top)
        path = Rect(MARGIN, body_bottom - path_height, left_width, path_height)
        coordinates_bottom = path.top - TITLE - TIME_LABELS
    labels = AXIS_LABELS + number_width
    coordinates = Rect(
        MARGIN + labels, body_top, left_width - labels, coordinates_bottom - body_top
    )

    row_keys, cells = [], []
    top = body_top + FRAME_NUMBERS
    for name, lines in zip(names, headers, strict=False):
        row_keys.append(Key(name, lines, Rect(right_left, top, right_width, len(lines) * LINE)))
        top += len(lines) * LINE + HEADER_GAP
        width = cell_height * aspect
        lefts = [right_left + i * (width + CELL_GAP) for i in range(num_snapshots)]
        cells.append(tuple(Rect(left, top, width, cell_height) for left in lefts))
        top += cell_height + ROW_GAP

    room = MAX_HEIGHT - body_bottom - strips_height - caption_height
    growth = min(max(room / max(num_strips, 1), 0.0), MAX_STRIP - MIN_STRIP)
    strip = MIN_STRIP + growth
    strips_height += num_strips * growth
    strips_top = body_bottom + BODY_GAP + TITLE
    strips_width = FIGURE_WIDTH_IN - 2 * MARGIN - labels
    strips = tuple(
        Rect(MARGIN + labels, strips_top + i * (strip + STRIP_GAP), strips_width, strip)
        for i in range(num_strips)
    )

    return Layout(
        height=body_bottom + strips_height + caption_height,
        legend=legend,
        coordinates=coordinates,
        path=path,
        cells=tuple(cells),
        row_keys=tuple(row_keys),
        strips=strips,
        caption_top=body_bottom + strips_height + CAPTION_GAP,
    )
