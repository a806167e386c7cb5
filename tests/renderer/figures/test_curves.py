"""The figures of one kind of panel: distributions, steps against time, error along the chain."""

import subprocess
import sys

import numpy as np
import pytest
from PIL import Image
from scipy.stats import ecdf

from renderer.figures.distributions import SpreadPanel, distributions_figure, draw_distributions
from renderer.figures.error_growth import Spreads, draw_error_growth, error_growth_figure
from renderer.figures.files import FigureError, matplotlib_settings
from renderer.figures.step_curve import PANELS, Mark, draw_step_curve, step_curve_figure
from tests.helpers import ROOT
from tests.renderer.figures.figure_checks import check_apart, drawn_texts

RNG = np.random.default_rng(3)
SPREADS = [
    SpreadPanel(
        f"Measure {number} (m)",
        {name: RNG.normal(k, 1.0, 40).tolist() for k, name in enumerate(("a", "b", "reference"))},
    )
    for number in range(4)
]
MARKS = [
    Mark("gan/5", 1, 0.5, 150.0, 9.0),
    Mark("gan/5", 25, 3.0, 130.0, 0.0),
    Mark("workbench/priorflow", 1, 1.0, 90.0, 4.0),
    Mark("workbench/priorflow", 8, 6.0, 105.0, 1.0),
    Mark("workbench/priorflow", 25, 17.0, 108.0, 0.0),
]
POINTS = (
    *("spine1", "spine2", "spine3", "right_collar", "right_shoulder", "right_elbow"),
    *("right_wrist", "right_middle1", "right_middle2", "right_middle3", "right_middle"),
)


def growth(scale: float = 1.0) -> Spreads:
    local = scale * 0.042 * np.linspace(0.05, 1.0, len(POINTS)) ** 1.5
    world = scale * 0.013 * np.linspace(0.1, 1.0, len(POINTS)) ** 0.5
    return Spreads(POINTS, 1.02 * local, 0.99 * world, local, world)


def test_curves_are_the_empirical_distributions():
    with matplotlib_settings():
        figure = draw_distributions(SPREADS, "reference")
    assert len(figure.axes) == len(SPREADS)
    for panel, axes in zip(SPREADS, figure.axes, strict=True):
        for line in axes.lines:
            assert line.get_drawstyle() == "steps-post"
            x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
            wanted = ecdf(panel.values[str(line.get_label())]).cdf
            assert (x[0], y[0]) == (wanted.quantiles[0], 0.0)
            np.testing.assert_allclose(x[1:], wanted.quantiles)
            np.testing.assert_allclose(y[1:], wanted.probabilities)


def test_neither_one_clip_far_off_nor_equal_values_spoil_the_axis():
    values = [*np.linspace(1.0, 2.0, 199), 1000.0]
    with matplotlib_settings():
        (far,) = draw_distributions([SpreadPanel("One", {"a": values})]).axes
        (equal,) = draw_distributions([SpreadPanel("One", {"a": [0.0] * 5})]).axes
    assert far.get_xlim()[1] < 2.2
    low, high = equal.get_xlim()
    assert low < 0.0 < high


def test_every_step_is_where_its_numbers_are():
    with matplotlib_settings():
        figure = draw_step_curve(MARKS)
        slow = draw_step_curve([*MARKS, Mark("slow", 50, 60.0, 100.0, 0.0)])
    panels = {axes.get_label(): axes for axes in figure.axes}
    for quantity, _ in PANELS:
        axes = panels[quantity]
        drawn = {
            (line.get_label(), float(x), float(y))
            for line in axes.lines
            for x, y in np.column_stack([line.get_xdata(), line.get_ydata()])
        }
        assert drawn == {(p.system, p.ms_per_frame, getattr(p, quantity)) for p in MARKS}
        assert [text.get_text() for text in axes.texts] == ["1", "25", "1", "8", "25"]
        assert axes.get_xscale() == "log" and axes.get_ylim()[0] == 0.0
    for axes in slow.axes:
        assert "real time" in [text.get_text() for text in axes.texts]


def test_errors_along_the_chain_are_the_numbers_in_centimetres():
    spreads = growth()
    with matplotlib_settings():
        (axes,) = draw_error_growth(spreads).axes
    drawn = {line.get_label(): line.get_ydata() for line in axes.get_lines()}
    assert {label: y.tolist() for label, y in drawn.items()} == {
        "local noise, measured": (100.0 * spreads.local).tolist(),
        "global noise, measured": (100.0 * spreads.world).tolist(),
        "local noise, predicted": (100.0 * spreads.predicted_local).tolist(),
        "global noise, predicted": (100.0 * spreads.predicted_world).tolist(),
    }


@pytest.mark.parametrize("scale", [0.0, 300.0])
def test_nothing_overlaps(monkeypatch, scale):
    with matplotlib_settings():
        figure = draw_error_growth(growth(scale))
        texts = drawn_texts(figure, monkeypatch)
    (axes,) = figure.axes
    assert all(np.max(line.get_ydata()) < axes.get_ylim()[1] for line in axes.get_lines())
    check_apart(figure, texts, {"plot": axes.get_window_extent()})


def test_the_same_bytes_come_from_a_process_that_loads_no_pyplot(tmp_path):
    program = (
        "import sys; from pathlib import Path; import numpy as np\n"
        "import renderer.figures.figure6.figure6, renderer.figures.jitter\n"
        "from renderer.figures.error_growth import Spreads, error_growth_figure\n"
        "assert 'matplotlib' not in sys.modules\n"
        "spreads = Spreads(('a', 'b'), *np.ones((4, 2)))\n"
        "error_growth_figure(spreads, Path(sys.argv[1]), sentence='So.')\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
        "import matplotlib; assert matplotlib.rcParams['pdf.fonttype'] == 3\n"
    )
    subprocess.run([sys.executable, "-c", program, str(tmp_path / "b")], check=True, cwd=ROOT)
    spreads = Spreads(("a", "b"), *np.ones((4, 2)))
    for path in error_growth_figure(spreads, tmp_path / "a", sentence="So."):
        assert path.read_bytes() == (tmp_path / f"b{path.suffix}").read_bytes(), path.suffix
    step_curve_figure(MARKS, tmp_path / "steps")
    for name, words in (("a", "So."), ("steps", "number of steps beside it")):
        with Image.open(tmp_path / f"{name}.png") as picture:
            assert words in picture.info["Description"]


def test_what_cannot_be_drawn_is_told(tmp_path):
    for panels, says in (
        ([], "no value"),
        ([SpreadPanel("One", {"a": []})], "no value"),
        ([SpreadPanel("One", {"a": [1.0, float("nan")]})], "no number"),
        ([SpreadPanel("One", {str(k): [1.0] for k in range(40)})], "told apart"),
    ):
        with pytest.raises(FigureError, match=says):
            distributions_figure(panels, tmp_path / "x")
    for points, says in (
        ([], "no point"),
        ([Mark("a", 2, 0.0, 1.0, 1.0)], "a with 2 steps"),
        ([Mark("a", 2, 1.0, float("nan"), 1.0)], "a with 2 steps"),
    ):
        with pytest.raises(FigureError, match=says):
            step_curve_figure(points, tmp_path / "x")
    assert list(tmp_path.iterdir()) == []
