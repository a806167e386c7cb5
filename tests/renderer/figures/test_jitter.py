"""The jitter sheet: what it shows is what the numbers say, and nothing covers anything else."""

import itertools
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from conventions.joints import JOINT_DEPTH, JOINT_INDEX
from conventions.names import FILTER_VERSIONS, FilterVersion
from renderer.figures.errors import FigureError
from renderer.figures.jitter import (
    NO_DATA,
    NO_PERIOD,
    ROWS,
    Jitter,
    JitterSheet,
    draw_jitter_sheet,
    jitter_sheet_caption,
)
from renderer.figures.style import matplotlib_settings
from tests.renderer.figures.figure_checks import NAMES, ODD_NAMES, check_apart, drawn_texts

CHAIN = (
    *("pelvis", "spine1", "spine2", "spine3", "right_collar", "right_shoulder", "right_elbow"),
    *("right_wrist", "right_middle1", "right_middle2", "right_middle3"),
)


def example_sheet(
    num_systems: int = 2, has_reference: bool = True, names: tuple[str, ...] = NAMES
) -> JitterSheet:
    depth = np.array(JOINT_DEPTH)
    systems = {
        name: both(depth, seed, 1.0 + 1.4 * (num_systems - seed))
        for seed, name in enumerate(names[:num_systems])
    }
    reference = {"reference": both(depth, 99, 1.0)} if has_reference else {}
    return JitterSheet(reference | systems, "right middle fingertip", 52, 8)


def with_numbers(sheet: JitterSheet, name: str, kind: FilterVersion, **numbers: Any) -> JitterSheet:
    """The sheet with other numbers of one motion."""
    versions = sheet.jitter[name]
    versions = {**versions, kind: replace(versions[kind], **numbers)}
    return replace(sheet, jitter={**sheet.jitter, name: versions})


def both(depth: np.ndarray, seed: int, roughness: float) -> dict[FilterVersion, Jitter]:
    raw = jitter_of(depth, seed, roughness)
    return {"raw": raw, "savgol": jitter_of(depth, seed, 1.0 + 0.25 * (roughness - 1.0))}


def jitter_of(depth: np.ndarray, seed: int, roughness: float) -> Jitter:
    rng = np.random.default_rng(seed)
    jerk = (8.0 + 12.0 * depth) * roughness ** (depth / 10.0) * np.exp(rng.normal(0, 0.15, 55))
    frequency = np.linspace(0.0, 15.0, 65)
    power = np.exp(-frequency / 0.9) + 2e-4 * (roughness - 0.9) * rng.gamma(5.0, 0.2, 65)
    phase = 40.0 * roughness * rng.gamma(30.0, 1 / 30.0, 52)
    phase[:9] *= 1.0 + 0.5 * (roughness - 1.0)
    share = rng.dirichlet(np.ones(len(CHAIN))) - 0.02
    return Jitter(
        jerk_by_depth=np.array([jerk[depth == d].mean() for d in range(11)]),
        jerk_by_joint=jerk,
        spectrum=(frequency, power / power.sum()),
        chain=CHAIN,
        jerk_drop_by_joint=share,
        jerk_by_frame_in_period=phase,
        period_and_part=None,
    )


@pytest.fixture
def settings() -> Iterator[None]:
    with matplotlib_settings():
        yield


def panels_of(figure: Any) -> dict[str, Any]:
    return {axes.get_label(): axes for axes in figure.axes}


def lines_of(axes: Any) -> dict[str, Any]:
    return {line.get_label(): line for line in axes.get_lines() if line.get_label()[0] != "_"}


def test_the_caption_has_the_clip_who_lacks_what_and_the_sentence():
    sentence = "On this clip a has 1.6 times the jerk of b."
    lacking = with_numbers(example_sheet(2), NAMES[1], "raw", spectrum=None)
    description = jitter_sheet_caption(lacking, "2_scott_0_1_1", sentence)
    assert "2_scott_0_1_1" in description and description.endswith(sentence)
    assert "The recorded reference is black" in description
    assert (
        f"Not measured: spectrum of {NAMES[1]}; the clip is too short or nothing moves."
        in description
    )
    assert description.count("Not measured") == 1


def test_curves_are_the_numbers_and_raw_and_filtered_panels_have_one_scale(settings):
    sheet = replace(example_sheet(3), window_overlap=6)
    panels = panels_of(draw_jitter_sheet(sheet))
    for name, kind in itertools.product(sheet.jitter, FILTER_VERSIONS):
        measured = sheet.jitter[name][kind]
        curves = {row: lines_of(panels[f"{row} {kind}"])[name] for row in ROWS if row != "joints"}
        np.testing.assert_allclose(curves["depth"].get_ydata(), measured.jerk_by_depth)
        np.testing.assert_allclose(curves["seams"].get_ydata(), measured.jerk_by_frame_in_period)
        np.testing.assert_allclose(
            curves["attribution"].get_ydata(), 100 * measured.jerk_drop_by_joint
        )
        assert measured.spectrum is not None
        frequency, power = measured.spectrum
        np.testing.assert_allclose(curves["spectrum"].get_xdata(), frequency)
        highest = np.nanmax(np.asarray(curves["spectrum"].get_ydata(), dtype=float))
        assert highest == pytest.approx(100 * power.max())
        for row in curves:
            assert panels[f"{row} raw"].get_ylim() == panels[f"{row} savgol"].get_ylim()
    (shade,) = panels["seams raw"].patches
    assert (shade.get_x(), shade.get_width()) == (-0.5, 6.0), "the shared frames"
    marks = [line.get_xdata() for line in panels["spectrum raw"].get_lines()]
    assert any(list(mark) == [5.0, 5.0] for mark in marks)


def test_every_joint_has_its_own_value_over_its_own_name(settings):
    sheet = with_numbers(example_sheet(1), NAMES[0], "raw", jerk_by_joint=100.0 + np.arange(55))
    axes = panels_of(draw_jitter_sheet(sheet))["joints raw"]
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


def test_zero_jerk_is_a_gap_on_a_logarithmic_axis(settings: None) -> None:
    sheet = with_numbers(example_sheet(2), NAMES[1], "raw", jerk_by_depth=np.full(11, 2e4))
    jerk = sheet.jitter[NAMES[0]]["raw"].jerk_by_depth.copy()
    jerk[3] = 0.0
    sheet = with_numbers(sheet, NAMES[0], "raw", jerk_by_depth=jerk)
    axes = panels_of(draw_jitter_sheet(sheet))["depth raw"]
    assert axes.get_yscale() == "log"
    path = (
        lines_of(axes)[NAMES[0]].get_transform().transform_path(lines_of(axes)[NAMES[0]].get_path())
    )
    assert np.flatnonzero(~np.isfinite(path.vertices).all(axis=1)).tolist() == [3]
    low, high = axes.get_ylim()
    assert 0.0 < low < high < 1e5


def test_a_factor_of_1_4_is_seen_on_a_linear_axis(settings: None) -> None:
    panels = panels_of(draw_jitter_sheet(example_sheet(2)))
    for row in ("depth", "joints", "seams"):
        assert panels[f"{row} raw"].get_yscale() == "linear"
        assert panels[f"{row} raw"].get_ylim()[0] == 0.0
    assert panels["spectrum raw"].get_yscale() == "log"


def test_periods_found_are_folded_and_named(settings: None) -> None:
    sheet = replace(example_sheet(2, has_reference=False), window_advance=0, window_overlap=0)
    for kind in FILTER_VERSIONS:
        sheet = with_numbers(sheet, NAMES[0], kind, jerk_by_frame_in_period=np.zeros(0))
        phase = np.array([3.0, 1.0, 2.0, 1.0])
        sheet = with_numbers(
            sheet, NAMES[1], kind, jerk_by_frame_in_period=phase, period_and_part=(4, "legs")
        )
    axes = panels_of(draw_jitter_sheet(sheet))["seams raw"]
    assert axes.get_xlabel() == "frame in the detected period"
    assert list(lines_of(axes)) == [NAMES[1]]
    assert not axes.patches  # no frames are shared that one knows of
    for kind in FILTER_VERSIONS:
        sheet = with_numbers(
            sheet, NAMES[1], kind, jerk_by_frame_in_period=np.zeros(0), period_and_part=None
        )
    axes = panels_of(draw_jitter_sheet(sheet))["seams raw"]
    assert " ".join(axes.texts[0].get_text().split()) == NO_PERIOD


def check_legible(sheet: JitterSheet, monkeypatch: pytest.MonkeyPatch) -> None:
    figure = draw_jitter_sheet(sheet)
    texts = drawn_texts(figure, monkeypatch)
    written = "".join(text for text, _ in texts).replace(" ", "").replace("\n", "")
    assert all(name.replace(" ", "") in written for name in sheet.jitter)

    boxes = {str(axes.get_label()): axes.get_window_extent() for axes in figure.axes}
    assert len(boxes) == 9
    check_apart(figure, texts, boxes, within_panels=("5 Hz", NO_DATA))
    assert min(box.height for box in boxes.values()) > 70  # pixels of 1/144 inch
    assert figure.get_figheight() < 9.3  # a page


@pytest.mark.parametrize(
    ("names", "has_reference", "factor"),
    [
        pytest.param(NAMES[:1], False, 1e-4, marks=pytest.mark.slow),
        (NAMES[:2], True, 1e3),
        (ODD_NAMES, True, 1.0),
        pytest.param(NAMES, True, 0.0, marks=pytest.mark.slow),
    ],
)
def test_nothing_overlaps_whatever_the_names_and_numbers(
    settings, monkeypatch, names, has_reference, factor
):
    sheet = example_sheet(len(names), has_reference, names)
    for name, kind in itertools.product(list(sheet.jitter), FILTER_VERSIONS):
        jitter = sheet.jitter[name][kind]
        jerk = {
            key: factor * getattr(jitter, key)
            for key in ("jerk_by_joint", "jerk_by_depth", "jerk_by_frame_in_period")
        }
        drop = -min(factor, 3.0) * jitter.jerk_drop_by_joint
        sheet = with_numbers(sheet, name, kind, jerk_drop_by_joint=drop, **jerk)
    check_legible(sheet, monkeypatch)


def test_missing_numbers_leave_a_stated_gap(settings, monkeypatch):
    nothing = Jitter(
        jerk_by_depth=np.full(11, np.nan),
        jerk_by_joint=np.full(55, np.nan),
        spectrum=None,
        chain=("pelvis",),
        jerk_drop_by_joint=np.full(1, np.nan),
        jerk_by_frame_in_period=np.zeros(0),
        period_and_part=None,
    )
    sheet = JitterSheet({NAMES[0]: {"raw": nothing, "savgol": nothing}}, window_advance=52)
    check_legible(sheet, monkeypatch)
    figure = draw_jitter_sheet(sheet)
    said = [[t.get_text() for t in axes.texts if t.get_text() == NO_DATA] for axes in figure.axes]
    assert said == [[NO_DATA]] * 9


def test_more_systems_than_fit_are_refused():
    jitter = example_sheet(6).jitter
    with pytest.raises(FigureError, match="1 to 6 systems besides the reference; got 7"):
        JitterSheet({**jitter, "seventh": jitter[NAMES[0]]})
    with pytest.raises(FigureError, match="got 0"):
        JitterSheet({"reference": jitter["reference"]})
