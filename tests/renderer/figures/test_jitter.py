"""The jitter sheet: what it shows is what the numbers say, and nothing covers anything else."""

import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from conventions.joints import JOINT_INDEX
from conventions.names import VERSIONS, Version
from renderer.figures.files import FigureError, matplotlib_settings
from renderer.figures.jitter import NO_DATA, NO_PERIOD, ROWS, draw_sheet, jitter_sheet
from renderer.figures.jitter_series import Jitter, JitterSheet
from renderer.figures.style import FIGURE_WIDTH_IN
from tests.renderer.figures.figure_checks import drawn_texts, overlap
from tests.renderer.figures.jitter_example import NAMES, example_sheet, with_numbers


@pytest.fixture
def settings() -> Iterator[None]:
    with matplotlib_settings():
        yield


def panels_of(figure: Any) -> dict[str, Any]:
    return {axes.get_label(): axes for axes in figure.axes}


def lines_of(axes: Any) -> dict[str, Any]:
    return {line.get_label(): line for line in axes.get_lines() if line.get_label()[0] != "_"}


def test_writes_three_formats_with_fonts_and_the_sentence(tmp_path: Path) -> None:
    sentence = "On this clip a has 1.6 times the jerk of b."
    files = jitter_sheet(
        example_sheet(), tmp_path / "new" / "jitter", clip="2_scott_0_1_1", sentence=sentence
    )
    assert sorted(path.name for path in files.png.parent.iterdir()) == [
        "jitter.pdf",
        "jitter.png",
        "jitter.svg",
    ]
    pdf = files.pdf.read_bytes()
    assert b"/FontFile2" in pdf and b"/Type3" not in pdf
    with Image.open(files.png) as picture:
        assert picture.width == 2016
        description = picture.info["Description"]
    assert "2_scott_0_1_1" in description and description.endswith(sentence)
    assert "Black: the recorded reference" in description
    assert "No " not in description


@pytest.mark.parametrize("kind", ["raw", "savgol"])
def test_curves_are_the_numbers(settings: None, kind: Version) -> None:
    sheet = example_sheet(3)
    panels = panels_of(draw_sheet(sheet, ""))
    for name, versions in sheet.jitter.items():
        measured = versions[kind]
        curves = {row: lines_of(panels[f"{row} {kind}"])[name] for row in ROWS if row != "joints"}
        np.testing.assert_allclose(curves["depth"].get_ydata(), measured.by_depth)
        np.testing.assert_allclose(curves["seams"].get_ydata(), measured.by_phase)
        np.testing.assert_allclose(curves["attribution"].get_ydata(), 100 * measured.chain_drop)
        assert measured.spectrum is not None
        np.testing.assert_allclose(curves["spectrum"].get_xdata(), measured.spectrum[0])


def test_every_joint_has_its_own_value_over_its_own_name(settings: None) -> None:
    sheet = with_numbers(example_sheet(1), NAMES[0], "raw", by_joint=100.0 + np.arange(55))
    axes = panels_of(draw_sheet(sheet, ""))["joints raw"]
    line = lines_of(axes)[NAMES[0]]
    value_at = dict(zip(line.get_xdata(), line.get_ydata(), strict=True))
    place = {label.get_text(): x for x, label in enumerate(axes.get_xticklabels())}

    assert len(place) == 55
    for shown, joint in [
        ("pelvis", "pelvis"),
        ("L thumb 3", "left_thumb3"),
        ("R middle 1", "right_middle1"),
        ("L eye", "left_eye"),
        ("R foot", "right_foot"),
    ]:
        assert value_at[place[shown]] == 100.0 + JOINT_INDEX[joint]
    assert sum(np.isnan(y) for y in line.get_ydata()) == 14  # hips, collars and ten fingers


def test_the_shared_frames_are_shaded_and_5_hz_is_marked(settings: None) -> None:
    sheet = replace(example_sheet(1), window_overlap=6)
    panels = panels_of(draw_sheet(sheet, ""))
    (shade,) = panels["seams raw"].patches
    assert (shade.get_x(), shade.get_width()) == (-0.5, 6.0)
    marks = [line.get_xdata() for line in panels["spectrum raw"].get_lines()]
    assert any(list(mark) == [5.0, 5.0] for mark in marks)


def test_raw_and_filtered_panels_have_one_scale(settings: None) -> None:
    panels = panels_of(draw_sheet(example_sheet(6), ""))
    for row in ROWS:
        if row != "joints":
            assert panels[f"{row} raw"].get_ylim() == panels[f"{row} savgol"].get_ylim()


def test_zero_jerk_is_a_gap_on_a_logarithmic_axis(settings: None) -> None:
    sheet = example_sheet(1, has_reference=False)
    jerk = sheet.jitter[NAMES[0]]["raw"].by_depth.copy()
    jerk[3] = 0.0
    sheet = with_numbers(sheet, NAMES[0], "raw", by_depth=jerk)
    axes = panels_of(draw_sheet(sheet, ""))["depth raw"]
    drawn = np.asarray(lines_of(axes)[NAMES[0]].get_ydata(), dtype=float)
    assert np.flatnonzero(np.isnan(drawn)).tolist() == [3]
    low, high = axes.get_ylim()
    assert 0.0 < low < high < 1e5


def test_periods_found_are_folded_and_named(settings: None) -> None:
    sheet = replace(example_sheet(2, has_reference=False), window_advance=0, window_overlap=0)
    for kind in VERSIONS:
        sheet = with_numbers(sheet, NAMES[0], kind, by_phase=np.zeros(0))
        phase = np.array([3.0, 1.0, 2.0, 1.0])
        sheet = with_numbers(sheet, NAMES[1], kind, by_phase=phase, period=(4, "legs"))
    axes = panels_of(draw_sheet(sheet, ""))["seams raw"]
    assert axes.get_xlabel() == "frame of the period found"
    assert list(lines_of(axes)) == [NAMES[1]]
    assert not axes.patches  # no frames are shared that one knows of
    for kind in VERSIONS:
        sheet = with_numbers(sheet, NAMES[1], kind, by_phase=np.zeros(0), period=None)
    axes = panels_of(draw_sheet(sheet, ""))["seams raw"]
    assert " ".join(axes.texts[0].get_text().split()) == NO_PERIOD


# ---------------------------------------------------------------------------- legibility


def check_legible(sheet: JitterSheet, monkeypatch: pytest.MonkeyPatch, words: int = 60) -> None:
    figure = draw_sheet(sheet, "word " * words)
    figure.set_dpi(144)
    texts = drawn_texts(figure, monkeypatch)
    written = "".join(text for text, _ in texts).replace(" ", "")
    assert all(name.replace(" ", "") in written for name in sheet.jitter)

    for (text_a, box_a), (text_b, box_b) in itertools.combinations(texts, 2):
        assert not overlap(box_a, box_b), f"{text_a!r} covers {text_b!r}"
    boxes = {axes.get_label(): axes.get_window_extent() for axes in figure.axes}
    assert len(boxes) == 9
    for (label_a, a), (label_b, b) in itertools.combinations(boxes.items(), 2):
        assert not overlap(a, b), f"{label_a} covers {label_b}"
    for text, box in texts:
        assert box.x0 >= 0 and box.y0 >= 0, f"{text!r} leaves the figure"
        assert box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1, f"{text!r} leaves the figure"
        if text not in ("5 Hz", NO_DATA):
            for label, panel in boxes.items():
                assert not overlap(box, panel), f"{text!r} covers {label}"
    assert min(box.height for box in boxes.values()) > 70  # pixels of 1/144 inch
    assert figure.get_figwidth() == FIGURE_WIDTH_IN
    assert figure.get_figheight() < 9.2  # a page


@pytest.mark.parametrize(("num_systems", "has_reference"), [(1, False), (2, True), (6, True)])
def test_nothing_overlaps(
    settings: None, monkeypatch: pytest.MonkeyPatch, num_systems: int, has_reference: bool
) -> None:
    check_legible(example_sheet(num_systems, has_reference), monkeypatch)


def test_long_and_odd_names_stay_whole_and_apart(
    settings: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = (
        "globaldiff/skeleton.s2",
        "a_folder_with_a_long_name/2_scott_0_103_103_of_the_second_run_with_everything_in_it.s12",
        "$x^2$_{nothing}\\frac",
        "x" * 130,
        "éàü",
        "b",
    )
    check_legible(example_sheet(6, names=names), monkeypatch, words=150)


@pytest.mark.parametrize("factor", [0.0, 1e-4, 1e3])
def test_numbers_of_any_size_fit(
    settings: None, monkeypatch: pytest.MonkeyPatch, factor: float
) -> None:
    sheet = example_sheet(2)
    for name, kind in itertools.product(list(sheet.jitter), VERSIONS):
        jitter = sheet.jitter[name][kind]
        jerk = {key: factor * getattr(jitter, key) for key in ("by_joint", "by_depth", "by_phase")}
        drop = -min(factor, 3.0) * jitter.chain_drop
        sheet = with_numbers(sheet, name, kind, chain_drop=drop, **jerk)
    check_legible(sheet, monkeypatch)


# ---------------------------------------------------------------------------- what is missing


def test_missing_numbers_leave_a_stated_gap(
    settings: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    nothing = Jitter(
        by_depth=np.full(11, np.nan),
        by_joint=np.full(55, np.nan),
        spectrum=None,
        chain=("pelvis",),
        chain_drop=np.full(1, np.nan),
        by_phase=np.zeros(0),
        period=None,
    )
    sheet = JitterSheet({NAMES[0]: {"raw": nothing, "savgol": nothing}}, window_advance=52)
    check_legible(sheet, monkeypatch)
    figure = draw_sheet(sheet, "")
    said = [[t.get_text() for t in axes.texts if t.get_text() == NO_DATA] for axes in figure.axes]
    assert said == [[NO_DATA]] * 9


def test_the_caption_names_who_lacks_what(tmp_path: Path) -> None:
    sheet = with_numbers(example_sheet(2), NAMES[1], "raw", spectrum=None)
    files = jitter_sheet(sheet, tmp_path / "jitter")
    with Image.open(files.png) as picture:
        description = picture.info["Description"]
    assert f"No spectrum of {NAMES[1]}: too short, or nothing moved." in description
    assert description.count("No ") == 1


def test_more_systems_than_fit_are_refused() -> None:
    jitter = example_sheet(6).jitter
    with pytest.raises(FigureError, match="1 to 6 systems; got 7"):
        JitterSheet({**jitter, "seventh": jitter[NAMES[0]]})
    with pytest.raises(FigureError, match="got 0"):
        JitterSheet({"reference": jitter["reference"]})
