"""Figures as files, and the styles that all of them share."""

import itertools
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from renderer.figures.style import (
    REFERENCE_STYLE,
    SYSTEM_STYLES,
    FigureFiles,
    wrap_text,
    written,
)


def small_figure() -> Any:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(2.0, 1.0), facecolor="white")
    axes = figure.add_axes((0.2, 0.3, 0.3, 0.6))
    axes.plot([0.0, 1.0, 2.0], [0.0, 3.0, 1.0], clip_on=True)
    axes.set_xlabel("time (s)")
    figure.add_axes((0.6, 0.3, 0.3, 0.6)).imshow(np.eye(4))
    return figure


def write(stem: Path) -> FigureFiles:
    return written(small_figure, stem, "What it shows.")


def test_three_whole_files_need_no_font_and_nothing_else(tmp_path):
    files = write(tmp_path / "new" / "figure.s2")
    names = sorted(path.name for path in files.png.parent.iterdir())
    assert names == [f"figure.s2.{ending}" for ending in ("pdf", "png", "svg", "txt")]
    with Image.open(files.png) as picture:
        assert picture.width == 2 * 300 and np.asarray(picture.convert("L")).std() > 10
        assert picture.info["Description"] == "What it shows."
    assert files.txt.read_text() == "What it shows.\n"
    pdf = files.pdf.read_bytes()
    assert pdf.startswith(b"%PDF-") and b"/FontFile2" in pdf and b"/Type3" not in pdf
    assert b"/Subtype /TrueType" in pdf or b"/CIDFontType2" in pdf
    elements = list(ElementTree.parse(files.svg).iter())
    tags = {element.tag.rpartition("}")[2] for element in elements}
    assert "text" not in tags and "image" in tags
    links = [v for e in elements for name, v in e.items() if name.endswith("href") and v[0] != "#"]
    assert links and all(link.startswith("data:image/") for link in links)


def test_a_failure_leaves_old_files_and_no_half_ones(tmp_path, monkeypatch):
    before = {path: path.read_bytes() for path in write(tmp_path / "figure")}
    from matplotlib.backends.backend_pdf import FigureCanvasPdf

    def full_disk(*args: object, **kwargs: object) -> None:
        raise OSError("No space left on device")

    monkeypatch.setattr(FigureCanvasPdf, "print_pdf", full_disk)
    with pytest.raises(OSError, match="No space"):
        write(tmp_path / "figure")
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_figures_of_several_threads_are_those_of_one(tmp_path):
    alone = [path.read_bytes() for path in write(tmp_path / "alone")]
    with ThreadPoolExecutor(3) as threads:
        for files in threads.map(write, [tmp_path / str(i) for i in range(3)]):
            assert [path.read_bytes() for path in files] == alone


def test_styles_differ_without_colour():
    styles = [REFERENCE_STYLE, *SYSTEM_STYLES]
    assert len({style.marker for style in styles}) == len(styles)
    swatches = [Image.new("RGB", (1, 1), style.color) for style in styles[:3]]
    greys = sorted(int(np.asarray(swatch.convert("L"))[0, 0]) for swatch in swatches)
    assert min(b - a for a, b in itertools.pairwise(greys)) > 35
    assert not any("linestyle" in style.line_properties for style in styles), "lines are unbroken"


def test_wrapped_text_loses_nothing():
    text = "a/" + "b" * 90 + "-c_d " + "e" * 5
    for width in (1.0, 12.0, 50.0, 1200.0):
        lines = wrap_text(text, 7.0, width)
        assert "".join(lines).replace(" ", "") == text.replace(" ", "")
