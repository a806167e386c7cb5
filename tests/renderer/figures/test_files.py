"""Figures as files, and the styles that all of them share."""

import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from conventions.colors import SYSTEM_COLORS
from renderer.figures import style
from renderer.figures.curves import SpeechEffectRow
from renderer.figures.errors import FigureError
from renderer.figures.figure6.contents import Figure6
from renderer.figures.saved_figures import (
    _RENAMED,
    DRAW_FUNCTIONS,
    draw_saved_figure,
    save_figure_contents,
)
from renderer.figures.style import (
    FIGURE_FORMATS,
    matplotlib_settings,
    save_figure,
    series_styles,
    wrap_text,
)
from tests.renderer.figures.test_curves import MARKS, growth
from tests.renderer.figures.test_figure6 import make_inputs
from tests.renderer.figures.test_jitter import example_sheet


def small_figure() -> Any:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(2.0, 1.0), facecolor="white")
    axes = figure.add_axes((0.2, 0.3, 0.3, 0.6))
    axes.plot([0.0, 1.0, 2.0], [0.0, 3.0, 1.0], clip_on=True)
    axes.set_xlabel("time (s)")
    figure.add_axes((0.6, 0.3, 0.3, 0.6)).imshow(np.eye(4))
    return figure


def write(stem: Path, forms: Sequence[str] = FIGURE_FORMATS) -> dict[str, Path]:
    """By form."""
    paths = save_figure(small_figure, stem, "What it shows.", forms)
    return {path.suffix[1:]: path for path in paths}


def test_three_whole_files_need_no_font_and_nothing_else(tmp_path):
    files = write(tmp_path / "new" / "figure.s2")
    names = sorted(path.name for path in files["png"].parent.iterdir())
    assert names == [f"figure.s2.{ending}" for ending in ("pdf", "png", "svg", "txt")]
    with Image.open(files["png"]) as picture:
        assert picture.width == 2 * 300 and np.asarray(picture.convert("L")).std() > 10
        assert picture.info["Description"] == "What it shows."
    assert files["txt"].read_text() == "What it shows.\n"
    pdf = files["pdf"].read_bytes()
    assert pdf.startswith(b"%PDF-") and b"/FontFile2" in pdf and b"/Type3" not in pdf
    assert b"/Subtype /TrueType" in pdf or b"/CIDFontType2" in pdf
    elements = list(ElementTree.parse(files["svg"]).iter())
    tags = {element.tag.rpartition("}")[2] for element in elements}
    assert "text" not in tags and "image" in tags
    links = [v for e in elements for name, v in e.items() if name.endswith("href") and v[0] != "#"]
    assert links and all(link.startswith("data:image/") for link in links)


def test_a_failure_leaves_old_files_and_no_half_ones(tmp_path, monkeypatch):
    before = {path: path.read_bytes() for path in write(tmp_path / "figure").values()}
    from matplotlib.backends.backend_pdf import FigureCanvasPdf

    def full_disk(*args: object, **kwargs: object) -> None:
        raise OSError("No space left on device")

    monkeypatch.setattr(FigureCanvasPdf, "print_pdf", full_disk)
    with pytest.raises(OSError, match="No space"):
        write(tmp_path / "figure")
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_figures_of_several_threads_are_those_of_one(tmp_path):
    alone = [path.read_bytes() for path in write(tmp_path / "alone").values()]
    with ThreadPoolExecutor(3) as threads:
        for files in threads.map(write, [tmp_path / str(i) for i in range(3)]):
            assert [path.read_bytes() for path in files.values()] == alone
    (picture, caption) = write(tmp_path / "page", ("png",)).values()
    assert [picture.read_bytes(), caption.read_bytes()] == [alone[0], alone[-1]]


@pytest.mark.parametrize("name", DRAW_FUNCTIONS)
def test_a_form_that_is_asked_for_later_is_the_one_that_is_written_at_once(
    name: str, tmp_path: Path
) -> None:
    effect = [
        SpeechEffectRow(
            name,
            {(clip, seed): np.arange(90.0) + seed for clip in "xy" for seed in (0, 1)},
            {"arms": (0.4, 0.1)},
        )
        for name in ("a/b", "c")
    ]
    contents = {
        "figure6": Figure6(**make_inputs(3, num_snapshots=2, num_frames=80)),
        "jitter": replace(example_sheet(2), window_advance=0),
        "speech_effect": effect,
        "hearing": effect,
        "error_growth": growth(),
        "steps": MARKS,
    }[name]
    svg, *_ = save_figure(
        lambda: DRAW_FUNCTIONS[name](contents), tmp_path / "once", "So.", ("svg",)
    )
    save_figure_contents(tmp_path / "kept.npz", name, contents, "So.")
    draw_saved_figure(tmp_path / "kept.npz", tmp_path / "later.svg")
    assert (tmp_path / "later.svg").read_bytes() == svg.read_bytes()
    arrays = dict(np.load(tmp_path / "kept.npz"))
    text = arrays["contents"].tobytes()
    for old, new in _RENAMED.items():  # as earlier versions wrote it
        text = text.replace(new.encode(), old.encode())
    np.savez(tmp_path / "old.npz", **arrays | {"contents": np.frombuffer(text, np.uint8)})
    draw_saved_figure(tmp_path / "old.npz", tmp_path / "old.svg")
    assert (tmp_path / "old.svg").read_bytes() == svg.read_bytes()


def test_a_file_that_holds_no_figure_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.figure.npz"
    for told in (
        {"name": "none"},
        [],
        {"name": "steps", "caption": "", "contents": {"kind": "os"}},
    ):
        np.savez(path, contents=np.frombuffer(json.dumps(told).encode(), np.uint8))
        with pytest.raises(FigureError, match=r"x\.figure\.npz is not a saved figure"):
            draw_saved_figure(path, tmp_path / "x.svg")
    np.savez(path, contents=np.array([print], dtype=object))
    with pytest.raises(FigureError):
        draw_saved_figure(path, tmp_path / "x.svg")


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 2**32),
    st.floats(1e-3, 2.0),
    st.lists(st.tuples(st.floats(0.0, 0.999), st.floats(-60.0, 60.0)), max_size=8),
)
def test_lines_of_many_points_are_simplified_by_less_than_anyone_sees_and_keep_each_peak(
    seed: int, roughness: float, peaks: list[tuple[float, float]]
) -> None:
    from matplotlib.path import Path as Line

    rng = np.random.default_rng(seed)
    count = int(rng.integers(200, 1500))
    heights = 20.0 * np.sin(np.linspace(0.0, 9.0, count)) * rng.uniform()
    heights += np.cumsum(rng.normal(0.0, 0.02 * roughness, count))
    for place, height in peaks:
        heights[int(place * count)] += height
    points = np.column_stack([np.linspace(0.0, 450.0, count), heights])  # of a page's width, in pt
    with matplotlib_settings():
        drawn = Line(points).cleaned(simplify=True)
    kept = np.asarray(drawn.vertices)[drawn.codes != Line.STOP]
    assert len(kept) < count
    widest = style.SIMPLIFIED_PX * 72.0 / style.DPI
    assert farthest(points, kept) <= widest
    assert abs(kept[:, 1].max() - heights.max()) <= widest >= abs(kept[:, 1].min() - heights.min())


def farthest(points: np.ndarray, line: np.ndarray) -> float:
    """Of some points from a line through others, at most."""
    nearest = np.full(len(points), np.inf)
    for start, along in zip(line[:-1], np.diff(line, axis=0), strict=True):
        share = np.clip((points - start) @ along / (along @ along or 1.0), 0.0, 1.0)
        gap = points - start - share[:, None] * along
        nearest = np.minimum(nearest, np.hypot(gap[:, 0], gap[:, 1]))
    return float(nearest.max())


def test_styles_differ_without_colour():
    styles = [*series_styles((*SYSTEM_COLORS, "reference"), "reference").values()]
    assert len({style.marker for style in styles}) == len(styles)
    assert not any("linestyle" in style.line_properties for style in styles), "lines are unbroken"


def test_wrapped_text_loses_nothing():
    text = "a/" + "b" * 90 + "-c_d " + "e" * 5
    for width in (1.0, 12.0, 50.0, 1200.0):
        lines = wrap_text(text, 7.0, width)
        assert "".join(lines).replace(" ", "") == text.replace(" ", "")
