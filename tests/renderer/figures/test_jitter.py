"""The jitter sheet: what it shows is what the numbers say, and nothing covers anything else."""

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from conventions.joints import JOINT_INDEX
from renderer.figures.files import FigureError, matplotlib_settings
from renderer.figures.jitter import NO_DATA, NO_PERIOD, ROWS, draw_sheet, jitter_sheet
from renderer.figures.jitter_series import read_sheet
from renderer.figures.style import FIGURE_WIDTH_IN
from tests.renderer.figures.figure_checks import drawn_texts, overlap
from tests.renderer.figures.jitter_example import NAMES, example_diagnostics


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
        example_diagnostics(), tmp_path / "new" / "jitter", clip="2_scott_0_1_1", sentence=sentence
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
def test_curves_are_the_numbers(settings: None, kind: str) -> None:
    numbers = example_diagnostics(3)
    panels = panels_of(draw_sheet(read_sheet(numbers), ""))
    motions = {"reference": numbers["reference"], **numbers["systems"]}

    for name, measures in motions.items():
        measured = measures[kind]
        curves = {row: lines_of(panels[f"{row} {kind}"])[name] for row in ROWS if row != "joints"}
        np.testing.assert_allclose(curves["depth"].get_ydata(), measured["jerk_by_depth_m_s3"])
        phase = measured["jerk_by_window_phase_m_s3"]
        np.testing.assert_allclose(curves["seams"].get_ydata(), phase)
        share = 100 * np.array(measured["tip_jerk_attribution"]["share"])
        np.testing.assert_allclose(curves["attribution"].get_ydata(), share)
        frequency = measured["tip_spectrum"]["frequency_hz"]
        np.testing.assert_allclose(curves["spectrum"].get_xdata(), frequency)


def test_every_joint_has_its_own_value_over_its_own_name(settings: None) -> None:
    numbers = example_diagnostics(1)
    for joint in range(55):
        numbers["systems"][NAMES[0]]["raw"]["joint_jerk_m_s3"][joint] = 100.0 + joint
    axes = panels_of(draw_sheet(read_sheet(numbers), ""))["joints raw"]
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
    numbers = {**example_diagnostics(1), "window_overlap_frames": 6}
    panels = panels_of(draw_sheet(read_sheet(numbers), ""))
    (shade,) = panels["seams raw"].patches
    assert (shade.get_x(), shade.get_width()) == (-0.5, 6.0)
    marks = [line.get_xdata() for line in panels["spectrum raw"].get_lines()]
    assert any(list(mark) == [5.0, 5.0] for mark in marks)


def test_raw_and_filtered_panels_have_one_scale(settings: None) -> None:
    panels = panels_of(draw_sheet(read_sheet(example_diagnostics(6)), ""))
    for row in ROWS:
        if row != "joints":
            assert panels[f"{row} raw"].get_ylim() == panels[f"{row} savgol"].get_ylim()


def test_zero_jerk_is_a_gap_on_a_logarithmic_axis(settings: None) -> None:
    numbers = example_diagnostics(1, has_reference=False)
    numbers["systems"][NAMES[0]]["raw"]["jerk_by_depth_m_s3"][3] = 0.0
    axes = panels_of(draw_sheet(read_sheet(numbers), ""))["depth raw"]
    drawn = np.asarray(lines_of(axes)[NAMES[0]].get_ydata(), dtype=float)
    assert np.flatnonzero(np.isnan(drawn)).tolist() == [3]
    low, high = axes.get_ylim()
    assert 0.0 < low < high < 1e5


def test_periods_found_are_folded_and_named(settings: None) -> None:
    numbers = example_diagnostics(2, has_reference=False)
    numbers |= {"window_advance_frames": None, "window_overlap_frames": None}
    for index, name in enumerate(NAMES[:2]):
        for kind in ("raw", "savgol"):
            numbers["systems"][name][kind] |= {
                "jerk_by_window_phase_m_s3": [3.0, 1.0, 2.0, 1.0] if index else [],
                "period": {"frames": 4, "part": "legs"} if index else None,
            }
    axes = panels_of(draw_sheet(read_sheet(numbers), ""))["seams raw"]
    assert axes.get_xlabel() == "frame of the period found"
    assert list(lines_of(axes)) == [NAMES[1]]
    assert not axes.patches  # no frames are shared that one knows of
    for kind in ("raw", "savgol"):
        numbers["systems"][NAMES[1]][kind] |= {"jerk_by_window_phase_m_s3": [], "period": None}
    axes = panels_of(draw_sheet(read_sheet(numbers), ""))["seams raw"]
    assert " ".join(axes.texts[0].get_text().split()) == NO_PERIOD


# ---------------------------------------------------------------------------- legibility


def check_legible(
    numbers: dict[str, Any], monkeypatch: pytest.MonkeyPatch, words: int = 60
) -> None:
    sheet = read_sheet(numbers)
    figure = draw_sheet(sheet, "word " * words)
    figure.set_dpi(144)
    texts = drawn_texts(figure, monkeypatch)
    written = "".join(text for text, _ in texts).replace(" ", "")
    assert all(name.replace(" ", "") in written for name in sheet.measures)

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
    check_legible(example_diagnostics(num_systems, has_reference), monkeypatch)


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
    check_legible(example_diagnostics(6, names=names), monkeypatch, words=150)


@pytest.mark.parametrize("factor", [0.0, 1e-4, 1e3])
def test_numbers_of_any_size_fit(
    settings: None, monkeypatch: pytest.MonkeyPatch, factor: float
) -> None:
    numbers = example_diagnostics(2)
    for motion in [*numbers["systems"].values(), numbers["reference"]]:
        for measures in motion.values():
            for name in ("joint_jerk_m_s3", "jerk_by_depth_m_s3", "jerk_by_window_phase_m_s3"):
                measures[name] = [factor * value for value in measures[name]]
            shares = measures["tip_jerk_attribution"]["share"]
            measures["tip_jerk_attribution"]["share"] = [-min(factor, 3.0) * s for s in shares]
    check_legible(numbers, monkeypatch)


# ---------------------------------------------------------------------------- what is missing


def test_missing_numbers_leave_a_stated_gap(
    settings: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    numbers = example_diagnostics(1, has_reference=False)
    short = {
        "jerk_by_depth_m_s3": [None] * 11,
        "joint_jerk_m_s3": [None] * 55,
        "jerk_by_window_phase_m_s3": None,
        "tip_spectrum": None,
        "tip_jerk_attribution": {"joints": ["pelvis"], "share": [None]},
    }
    numbers["systems"] = {NAMES[0]: {"raw": short, "savgol": {}}}
    check_legible(numbers, monkeypatch)
    figure = draw_sheet(read_sheet(numbers), "")
    assert [[text.get_text() for text in axes.texts if text.get_text() == NO_DATA]
            for axes in figure.axes] == [[NO_DATA]] * 9  # fmt: skip


def test_the_caption_names_who_lacks_what(tmp_path: Path) -> None:
    numbers = example_diagnostics(2)
    numbers["systems"][NAMES[1]]["raw"]["tip_spectrum"] = None
    files = jitter_sheet(numbers, tmp_path / "jitter")
    with Image.open(files.png) as picture:
        description = picture.info["Description"]
    assert f"No spectrum of {NAMES[1]}: too short, or nothing moved." in description
    assert description.count("No ") == 1


def test_a_file_of_an_older_version_is_drawn(settings: None) -> None:
    numbers = example_diagnostics(1)
    for measures in numbers["systems"][NAMES[0]].values():
        del measures["tip_spectrum"], measures["tip_jerk_attribution"]
    del numbers["joint_names"], numbers["depth_of_joint"]
    panels = panels_of(draw_sheet(read_sheet(numbers), ""))
    assert NAMES[0] in lines_of(panels["depth raw"])
    assert NAMES[0] not in lines_of(panels["spectrum raw"])
    assert not lines_of(panels["joints raw"])


def test_more_systems_than_fit_are_refused_or_chosen() -> None:
    numbers = example_diagnostics(6)
    numbers["systems"]["seventh"] = numbers["systems"][NAMES[0]]
    assert list(read_sheet(numbers).measures) == ["reference", *NAMES]
    assert list(read_sheet(numbers, ["seventh"]).measures) == ["reference", "seventh"]
    with pytest.raises(FigureError, match="1 to 6 systems; got 7"):
        read_sheet(numbers, list(numbers["systems"]))
    with pytest.raises(FigureError, match="no numbers of 'other'"):
        read_sheet(numbers, ["other"])
    with pytest.raises(FigureError, match="got 0"):
        read_sheet({**numbers, "systems": {}})
