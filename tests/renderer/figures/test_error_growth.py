"""The error-growth figure shows its numbers, whole and apart."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from renderer.figures.error_growth import Spreads, draw_error_growth, error_growth_figure
from renderer.figures.files import matplotlib_settings
from tests.renderer.figures.figure_checks import drawn_texts, overlap

POINTS = (
    *("spine1", "spine2", "spine3", "right_collar", "right_shoulder", "right_elbow"),
    *("right_wrist", "right_middle1", "right_middle2", "right_middle3", "right_middle"),
)


def growth(scale: float = 1.0) -> Spreads:
    local = scale * 0.042 * np.linspace(0.05, 1.0, len(POINTS)) ** 1.5
    world = scale * 0.013 * np.linspace(0.1, 1.0, len(POINTS)) ** 0.5
    return Spreads(POINTS, 1.02 * local, 0.99 * world, local, world)


def test_curves_are_the_numbers_in_centimetres() -> None:
    spreads = growth()
    with matplotlib_settings():
        (axes,) = draw_error_growth(spreads, "").axes
    drawn = {line.get_label(): line.get_ydata() for line in axes.get_lines()}
    assert {label: y.tolist() for label, y in drawn.items()} == {
        "local noise, measured": (100.0 * spreads.local).tolist(),
        "global noise, measured": (100.0 * spreads.world).tolist(),
        "local noise, predicted": (100.0 * spreads.predicted_local).tolist(),
        "global noise, predicted": (100.0 * spreads.predicted_world).tolist(),
    }


@pytest.mark.parametrize("scale", [0.0, 1.0, 300.0])
def test_nothing_overlaps(monkeypatch: pytest.MonkeyPatch, scale: float) -> None:
    with matplotlib_settings():
        figure = draw_error_growth(growth(scale), "Noise of 0.02 rad moves the fingertip. " * 4)
        figure.set_dpi(144)
        texts = drawn_texts(figure, monkeypatch)
        legend = figure.axes[0].get_legend().get_window_extent()
        tops = [
            figure.axes[0].transData.transform((0, line.get_ydata().max()))[1]
            for line in figure.axes[0].get_lines()
        ]
    assert max(tops) < legend.y0
    for (text_a, box_a), (text_b, box_b) in itertools.combinations(texts, 2):
        assert not overlap(box_a, box_b), f"{text_a!r} covers {text_b!r}"
    for text, box in texts:
        assert box.x0 >= 0 and box.y0 >= 0, f"{text!r} leaves the figure"
        assert box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1, f"{text!r} leaves the figure"


def test_writes_three_formats_with_the_sentence(tmp_path: Path) -> None:
    files = error_growth_figure(growth(), tmp_path / "error_growth", sentence="3.2 times as far.")
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".pdf", ".png", ".svg"]
    with Image.open(files.png) as picture:
        assert picture.info["Description"] == "3.2 times as far."
