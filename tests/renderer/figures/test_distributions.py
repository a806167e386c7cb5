"""The spread of measures over clips: each curve is the share of clips at or below a value."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.stats import ecdf

from renderer.figures.distributions import (
    SpreadPanel,
    distributions_figure,
    draw_distributions,
)
from renderer.figures.files import FigureError, matplotlib_settings

RNG = np.random.default_rng(3)
PANELS = [
    SpreadPanel(
        f"Measure {number} (m)",
        {name: RNG.normal(k, 1.0, 40).tolist() for k, name in enumerate(("a", "b", "reference"))},
    )
    for number in range(4)
]


def test_curves_are_the_empirical_distributions():
    with matplotlib_settings():
        figure = draw_distributions(PANELS, "A caption.", "reference")
    assert len(figure.axes) == len(PANELS)
    for panel, axes in zip(PANELS, figure.axes, strict=True):
        for line in axes.lines:
            assert line.get_drawstyle() == "steps-post"
            x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
            wanted = ecdf(panel.values[str(line.get_label())]).cdf
            assert (x[0], y[0]) == (wanted.quantiles[0], 0.0)
            np.testing.assert_allclose(x[1:], wanted.quantiles)
            np.testing.assert_allclose(y[1:], wanted.probabilities)


def test_one_clip_far_off_does_not_decide_the_axis():
    values = [*np.linspace(1.0, 2.0, 199), 1000.0]
    with matplotlib_settings():
        (axes,) = draw_distributions([SpreadPanel("One", {"a": values})]).axes
    assert axes.get_xlim()[1] < 2.2


def test_equal_values_have_an_axis():
    with matplotlib_settings():
        (axes,) = draw_distributions([SpreadPanel("One", {"a": [0.0] * 5})]).axes
    low, high = axes.get_xlim()
    assert low < 0.0 < high


def test_files_are_written_whole(tmp_path: Path):
    files = distributions_figure(PANELS, tmp_path / "distributions", "reference")
    assert [path.suffix for path in files] == [".png", ".svg", ".pdf"]
    assert Image.open(tmp_path / "distributions.png").width == 2016


@pytest.mark.parametrize(
    ("panels", "says"),
    [
        ([], "no value"),
        ([SpreadPanel("One", {"a": []})], "no value"),
        ([SpreadPanel("One", {"a": [1.0, float("nan")]})], "no number"),
        ([SpreadPanel("One", {str(k): [1.0] for k in range(40)})], "told apart"),
    ],
)
def test_what_cannot_be_drawn_is_told(panels: list[SpreadPanel], says: str, tmp_path: Path):
    with pytest.raises(FigureError, match=says):
        distributions_figure(panels, tmp_path / "x")
    assert not list(tmp_path.iterdir())
