"""Positions of titles, legends, subfigures and axes, beside those of matplotlib's solver."""

from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from renderer.figures.errors import FigureError
from renderer.figures.grid_layout import X_PAD_PT, Y_PAD_PT, lay_out
from renderer.figures.style import MM, matplotlib_settings

SOLVER_MARGIN = (MM / 4.0, MM / 5.0, 1.0 - 2.0 * MM / 4.0, 1.0 - 2.0 * MM / 5.0)


def nested_figure(**layout: Any) -> Figure:
    """A title and a legend over two subfigures: a grid with labels of many sizes, and one axes."""
    figure = Figure((4.0, 5.0), **layout)
    figure.suptitle("Title", x=0.0, ha="left")
    upper, lower = figure.subfigures(2, 1, height_ratios=(2.0, 3.0))
    left, right = lower.subfigures(1, 2, width_ratios=(1.0, 4.0))
    grid = right.subplots(3, 2, width_ratios=(3.0, 1.0), height_ratios=(1.0, 2.0, 1.0))
    for count, axes in enumerate(grid.ravel()):
        (line,) = axes.plot([0.0, 10.0**count], label="a line")
        axes.set_ylabel("label" * (count == 1))
        axes.set_xlabel("two\nlines" * (count == 2))
    right.legend(handles=[line], loc="outside upper left")
    left.suptitle("of the left", x=0.0, ha="left")
    left.add_subplot(left.add_gridspec(3, 1, height_ratios=(1.0, 6.0, 2.0))[1]).axis("off")
    upper.subplots().imshow(np.eye(3))  # of a fixed shape
    return figure


def places(figure: Figure) -> np.ndarray:
    """Frames of all axes, then extents of titles and legends (pixels)."""
    figure.draw_without_rendering()
    parts = [figure, *figure.subfigs, *figure.subfigs[1].subfigs]
    above = [each for part in parts for each in (*part.texts, *part.legends)]
    boxes = [axes.bbox for axes in figure.axes] + [each.get_window_extent() for each in above]
    return np.array([box.extents for box in boxes])


def test_positions_are_those_of_matplotlibs_solver() -> None:
    with matplotlib_settings():
        ours = nested_figure()
        lay_out(ours)
        pads = {"w_pad": X_PAD_PT / 72.0, "h_pad": Y_PAD_PT / 72.0, "hspace": 0, "wspace": 0}
        solver = ConstrainedLayoutEngine(rect=SOLVER_MARGIN, **pads)
        assert len(places(ours)) == 11
        np.testing.assert_allclose(places(ours), places(nested_figure(layout=solver)), atol=0.5)


def test_a_figure_without_room_for_its_axes_is_refused() -> None:
    with matplotlib_settings():
        figure = Figure((0.5, 2.0))
        figure.subplots(1, 2)
        with pytest.raises(FigureError, match=r"has \d+ pixels, but its labels need \d+"):
            lay_out(figure)
