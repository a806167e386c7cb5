"""The plot of quality against time: each point where its numbers are, and its steps beside it."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from renderer.figures.files import FigureError, matplotlib_settings
from renderer.figures.step_curve import PANELS, Mark, draw_step_curve, step_curve_figure

POINTS = [
    Mark("gan/5", 1, 0.5, 150.0, 9.0),
    Mark("gan/5", 25, 3.0, 130.0, 0.0),
    Mark("workbench/priorflow", 1, 1.0, 90.0, 4.0),
    Mark("workbench/priorflow", 8, 6.0, 105.0, 1.0),
    Mark("workbench/priorflow", 25, 17.0, 108.0, 0.0),
]


def test_every_point_is_where_its_numbers_are() -> None:
    with matplotlib_settings():
        figure = draw_step_curve(POINTS, "A caption.")
    panels = {axes.get_label(): axes for axes in figure.axes}
    for quantity, _ in PANELS:
        axes = panels[quantity]
        drawn = {
            (line.get_label(), float(x), float(y))
            for line in axes.lines
            for x, y in np.column_stack([line.get_xdata(), line.get_ydata()])
        }
        assert drawn == {(p.system, p.ms_per_frame, getattr(p, quantity)) for p in POINTS}
        assert [text.get_text() for text in axes.texts] == ["1", "25", "1", "8", "25"]
        assert axes.get_xscale() == "log" and axes.get_ylim()[0] == 0.0


def test_a_slow_system_sees_the_line_of_real_time() -> None:
    with matplotlib_settings():
        figure = draw_step_curve([*POINTS, Mark("slow", 50, 60.0, 100.0, 0.0)])
    for axes in figure.axes:
        assert "real time" in [text.get_text() for text in axes.texts]


def test_files_are_written_whole(tmp_path: Path) -> None:
    files = step_curve_figure(POINTS, tmp_path / "steps")
    assert [path.name for path in files] == ["steps.png", "steps.svg", "steps.pdf"]
    assert Image.open(tmp_path / "steps.png").width == 2016


@pytest.mark.parametrize(
    ("points", "says"),
    [
        ([], "no point"),
        ([Mark("a", 2, 0.0, 1.0, 1.0)], "a with 2 steps"),
        ([Mark("a", 2, 1.0, float("nan"), 1.0)], "a with 2 steps"),
    ],
)
def test_what_cannot_be_drawn_is_refused(points: list[Mark], says: str, tmp_path: Path) -> None:
    with pytest.raises(FigureError, match=says):
        step_curve_figure(points, tmp_path / "steps")
    assert list(tmp_path.iterdir()) == []
