"""The figures of one kind of panel: distributions, steps against time, error along the chain."""

import subprocess
import sys

import numpy as np
import pytest
from pandas import DataFrame
from scipy.stats import ecdf

from renderer.figures.curves import (
    STEP_PANELS,
    draw_cumulative_distributions,
    draw_noise_shift_along_chain,
    draw_speed_quality_tradeoff,
)
from renderer.figures.errors import FigureError
from renderer.figures.style import matplotlib_settings, save_figure
from tests.helpers import ROOT
from tests.renderer.figures.figure_checks import check_apart, drawn_texts

RNG = np.random.default_rng(3)
SYSTEMS = ("a", "b", "reference")
SPREADS = DataFrame(
    [
        (f"Measure {number} (m)", name, value)
        for number in range(4)
        for k, name in enumerate(SYSTEMS)
        for value in RNG.normal(k, 1.0, 40)
    ],
    columns=["measure", "system", "value"],
)
MARKS = DataFrame(
    [
        ("gan/5", 1, 0.5, 150.0, 9.0),
        ("gan/5", 25, 3.0, 130.0, 0.0),
        ("workbench/priorflow", 1, 1.0, 90.0, 4.0),
        ("workbench/priorflow", 8, 6.0, 105.0, 1.0),
        ("workbench/priorflow", 25, 17.0, 108.0, 0.0),
    ],
    columns=["system", "steps", "ms_per_frame", "tip_jerk_m_s3", "distance_cm"],
)
POINTS = (
    *("spine1", "spine2", "spine3", "right_collar", "right_shoulder", "right_elbow"),
    *("right_wrist", "right_middle1", "right_middle2", "right_middle3", "right_middle"),
)


def growth(scale: float = 1.0) -> DataFrame:
    local = scale * 0.042 * np.linspace(0.05, 1.0, len(POINTS)) ** 1.5
    world = scale * 0.013 * np.linspace(0.1, 1.0, len(POINTS)) ** 0.5
    measured = {"point": POINTS, "local": 1.02 * local, "global": 0.99 * world}
    return DataFrame(measured | {"predicted_local": local, "predicted_global": world})


def spread(*values: float) -> DataFrame:
    return DataFrame({"measure": "One", "system": "a", "value": values})


def test_curves_are_the_empirical_distributions():
    with matplotlib_settings():
        figure = draw_cumulative_distributions(SPREADS, SYSTEMS, "reference")
    panels = dict(list(SPREADS.groupby("measure")))
    assert {axes.get_label() for axes in figure.axes} == panels.keys()
    for axes in figure.axes:
        panel = panels[axes.get_label()]
        for line in axes.lines:
            assert line.get_drawstyle() == "steps-post"
            x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
            wanted = ecdf(panel["value"][panel["system"] == line.get_label()]).cdf
            assert (x[0], y[0]) == (wanted.quantiles[0], 0.0)
            np.testing.assert_allclose(x[1:], wanted.quantiles)
            np.testing.assert_allclose(y[1:], wanted.probabilities)


def test_neither_one_clip_far_off_nor_equal_values_spoil_the_axis():
    with matplotlib_settings():
        (far,) = draw_cumulative_distributions(
            spread(*np.linspace(1.0, 2.0, 199), 1000.0), ["a"]
        ).axes
        (equal,) = draw_cumulative_distributions(spread(*[0.0] * 5), ["a"]).axes
    assert far.get_xlim()[1] < 2.2
    low, high = equal.get_xlim()
    assert low < 0.0 < high


def test_every_step_is_where_its_numbers_are():
    with matplotlib_settings():
        figure = draw_speed_quality_tradeoff(MARKS)
        slow = draw_speed_quality_tradeoff(MARKS.assign(ms_per_frame=10 * MARKS["ms_per_frame"]))
    for axes in figure.axes:
        drawn = {
            (line.get_label(), float(x), float(y))
            for line in axes.lines
            for x, y in np.column_stack([line.get_xdata(), line.get_ydata()])
        }
        wanted = MARKS[["system", "ms_per_frame", axes.get_label()]]
        assert drawn == set(wanted.itertuples(index=False, name=None))
        assert [text.get_text() for text in axes.texts] == ["1", "25", "1", "8", "25"]
        assert axes.get_xscale() == "log" and axes.get_ylim()[0] == 0.0
        told = [text.get_text() for text in axes.get_xticklabels(which="both")]
        assert {"0.5", "1", "2", "5", "10", "20"} <= {*told} and "$" not in "".join(told)
    assert [axes.get_label() for axes in figure.axes] == list(STEP_PANELS)
    for axes in slow.axes:
        assert "real time" in [text.get_text() for text in axes.texts]


def test_errors_along_the_chain_are_the_numbers_in_centimetres():
    spreads = growth()
    with matplotlib_settings():
        (axes,) = draw_noise_shift_along_chain(spreads).axes
    drawn = {line.get_label(): line.get_ydata() for line in axes.get_lines()}
    assert {label: y.tolist() for label, y in drawn.items()} == {
        "local noise, measured": (100.0 * spreads["local"]).tolist(),
        "global noise, measured": (100.0 * spreads["global"]).tolist(),
        "local noise, predicted": (100.0 * spreads["predicted_local"]).tolist(),
        "global noise, predicted": (100.0 * spreads["predicted_global"]).tolist(),
    }


@pytest.mark.parametrize("scale", [0.0, 300.0])
def test_nothing_overlaps(monkeypatch, scale):
    with matplotlib_settings():
        figure = draw_noise_shift_along_chain(growth(scale))
        texts = drawn_texts(figure, monkeypatch)
    (axes,) = figure.axes
    assert all(np.max(line.get_ydata()) < axes.get_ylim()[1] for line in axes.get_lines())
    check_apart(figure, texts, {"plot": axes.get_window_extent()})


@pytest.mark.slow
def test_the_same_bytes_come_from_a_process_that_loads_no_pyplot(tmp_path):
    program = (
        "import sys; from pathlib import Path\n"
        "import renderer.figures.figure6.layout, renderer.figures.jitter\n"
        "from renderer.figures.curves import draw_noise_shift_along_chain\n"
        "from renderer.figures.style import save_figure\n"
        "assert 'matplotlib' not in sys.modules\n"
        "from tests.renderer.figures.test_curves import growth\n"
        "save_figure(lambda: draw_noise_shift_along_chain(growth()), Path(sys.argv[1]), 'So.')\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
        "import matplotlib; assert matplotlib.rcParams['pdf.fonttype'] == 3\n"
    )
    subprocess.run([sys.executable, "-c", program, str(tmp_path / "b")], check=True, cwd=ROOT)
    for path in save_figure(lambda: draw_noise_shift_along_chain(growth()), tmp_path / "a", "So."):
        assert path.read_bytes() == (tmp_path / f"b{path.suffix}").read_bytes(), path.suffix


def test_what_cannot_be_drawn_is_told():
    for values, systems, says in (
        (spread(), "a", "no value"),
        (spread(1.0, float("nan")), "a", "not a finite number"),
        (spread(1.0), "abcdefgh", "at most 6 systems"),
    ):
        with pytest.raises(FigureError, match=says):
            draw_cumulative_distributions(values, systems)
    for points, says in (
        (MARKS[:0], "no point"),
        (MARKS.assign(ms_per_frame=0.0), "gan/5 with 1 sampling steps"),
        (MARKS.assign(distance_cm=float("nan")), "gan/5 with 1 sampling steps"),
    ):
        with pytest.raises(FigureError, match=says):
            draw_speed_quality_tradeoff(points)
