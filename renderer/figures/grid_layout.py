"""Positions of nested subfigures and of grids of axes, computed from the outside in.

matplotlib's constrained layout solves one system of equations for all positions, in an order that
depends on addresses in memory; for a nested figure it sometimes finds no solution, or kiwisolver
ends the process. Here no equations are needed, because the sizes of subfigures are given.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from renderer.figures.errors import FigureError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure
    from matplotlib.transforms import Bbox

MARGIN_PT = 72.0 / 25.4
"""Empty margin around a figure (pt), a millimetre."""
X_PAD_PT, Y_PAD_PT = 2.16, 1.44
"""Padding beside, and above and below, axes, titles and legends (pt)."""


def lay_out(figure: "Figure") -> None:
    """Place the titles, legends, subfigures and axes of a new figure, once.

    Titles and legends of a (sub)figure are above its grid. Subfigures divide the room below by
    their ratios; axes divide what the largest labels of their row and column leave of it. Raises
    FigureError if nothing is left for some axes.
    """
    pixels_per_pt = figure.dpi / 72.0
    _lay_out_part(figure, figure.bbox.padded(-MARGIN_PT * pixels_per_pt), pixels_per_pt)


def _lay_out_part(part: "Figure | SubFigure", box: "Bbox", pixels_per_pt: float) -> None:
    """Place what a (sub)figure contains in a box (pixels)."""
    from matplotlib.transforms import Bbox, BboxTransformTo

    x_pad, y_pad = X_PAD_PT * pixels_per_pt, Y_PAD_PT * pixels_per_pt
    to_part = part.transSubfigure.inverted()
    for title in part.texts:
        title.set_y(1.0 - y_pad / part.bbox.height)
    legends = [each for each in part.legends if each.get_bbox_to_anchor() is part.bbox]
    heights = [each.get_window_extent().height + 2.0 * y_pad for each in (*part.texts, *legends)]
    header = max(heights, default=0.0)
    inner = Bbox.from_extents(box.x0, box.y0, box.x1, box.y1 - header)
    for subfigure in part.subfigs:
        place = subfigure.bbox_relative.transformed(BboxTransformTo(inner))
        subfigure.bbox_relative.bounds = to_part.transform_bbox(place).bounds
        _lay_out_part(subfigure, place, pixels_per_pt)
    axes = [each for each in part.axes if each.figure is part and each.get_subplotspec()]
    for _ in range(2):  # ticks change with the size of their axes
        for each, place in zip(axes, _cells(axes, inner, x_pad, y_pad), strict=True):
            each.set_position(to_part.transform_bbox(place))


def _cells(axes: "Sequence[Axes]", box: "Bbox", x_pad: float, y_pad: float) -> "list[Bbox]":
    """Return the places (pixels) of axes of one grid in a box, so that their labels are inside."""
    from matplotlib.transforms import Bbox

    specs: list[Any] = [each.get_subplotspec() for each in axes]
    if not specs:
        return []
    grid = specs[0].get_gridspec()
    # Room for labels before and after each column and row.
    columns, rows = (np.zeros((2, count)) for count in reversed(grid.get_geometry()))
    for each, spec in zip(axes, specs, strict=True):
        part, whole = each.get_figure(), each.get_tightbbox(for_layout_only=True)
        assert part is not None and whole is not None
        frame = each.get_position(original=True).transformed(part.transSubfigure)
        beside = (frame.x0 - whole.x0 + x_pad, whole.x1 - frame.x1 + x_pad)
        above = (whole.y1 - frame.y1 + y_pad, frame.y0 - whole.y0 + y_pad)
        for room, index, size in (
            (columns, spec.colspan.start, beside),
            (rows, spec.rowspan.start, above),
        ):
            room[:, index] = np.maximum(room[:, index], size)
    left, right = box.x0 + _divide(box.width, np.array(grid.get_width_ratios(), float), columns)
    top, bottom = box.y1 - _divide(box.height, np.array(grid.get_height_ratios(), float), rows)
    return [
        Bbox.from_extents(
            left[spec.colspan.start], bottom[spec.rowspan.start],
            right[spec.colspan.start], top[spec.rowspan.start],
        )
        for spec in specs
    ]  # fmt: skip


def _divide(
    length: float, ratios: Float[np.ndarray, " N"], room: Float[np.ndarray, "2 N"]
) -> Float[np.ndarray, "2 N"]:
    """Return starts and ends of columns or rows, with room around; raises FigureError if none."""
    left = length - room.sum()
    if left <= 0.0:
        raise FigureError(
            f"One side of the figure has {length:.0f} pixels, but its labels need "
            f"{room.sum():.0f}; make the figure larger."
        )
    sizes = left * ratios / ratios.sum()
    ends = np.cumsum(room.sum(axis=0) + sizes) - room[1]
    return np.stack([ends - sizes, ends])
