"""Figure 6: what it shows is what it was given, and nothing is cut or covers anything else."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from renderer.body.body import BodyMotion, load_body
from renderer.figures.errors import FigureError
from renderer.figures.figure6.contents import (
    MIN_TREMOR_FRAMES,
    ONE_SEED_CAVEAT,
    PANELS,
    Figure6,
    JointMarks,
    choose_snapshot_frames,
    high_pass_mm,
)
from renderer.figures.figure6.layout import column_figure_fits_page, draw_figure6
from renderer.figures.figure6.panels import PROJECTION
from renderer.figures.figure6.snapshots import MARK_RGB, SnapshotStrips
from renderer.figures.grid_layout import lay_out
from renderer.figures.style import (
    COLUMN_MM,
    MAX_HEIGHT_MM,
    PAGE_MM,
    matplotlib_settings,
    save_figure,
)
from renderer.scene.camera_setup import make_camera_setup
from renderer.video.render import RenderSettings, projected_joints
from tests.renderer.drawn import render_stills
from tests.renderer.figures.figure_checks import NAMES, ODD_NAMES, check_apart, drawn_texts

FRAME = (48, 64)
FPS = 30.0
INSIDE = slice(30, -30)


def make_trajectory(seed: int, num_frames: int = 300) -> np.ndarray:
    rng = np.random.default_rng(seed)
    t = np.arange(num_frames)[:, None] / FPS
    wave = np.sin(t * rng.uniform(0.5, 3.0, 3) + rng.uniform(0, 6, 3)) * [0.3, 0.25, 0.1]
    noise = rng.normal(scale=0.01, size=(num_frames, 3))
    return (wave + noise + [-0.3, 1.1, 0.3]).astype(np.float32)


def make_inputs(
    num_systems: int,
    has_reference: bool = True,
    num_snapshots: int = 6,
    num_frames: int = 300,
    names: tuple[str, ...] = NAMES,
) -> dict[str, Any]:
    """Arguments of ``Figure6``: bodies are bars, with a joint at each end, the first of full
    and the second of an unknown value."""
    rng = np.random.default_rng(0)
    shown = [*names[:num_systems], *(["reference"] if has_reference else [])]
    pictures, pixels = {}, {}
    for name in shown if num_snapshots else ():
        pictures[name] = np.full((num_snapshots, *FRAME, 3), 230, dtype=np.uint8)
        pixels[name] = np.zeros((num_snapshots, 2, 2))
        for picture, joints in zip(pictures[name], pixels[name], strict=True):
            left = rng.integers(20, 34)
            picture[8:44, left : left + 10] = rng.integers(0, 200, 3)
            joints[:] = [[left, 12], [left + 10, 42]]
    values = {name: np.tile([500.0, np.nan], (num_snapshots, 1)) for name in pictures}
    return {
        "trajectories": {name: make_trajectory(i, num_frames) for i, name in enumerate(shown)},
        "snapshots": pictures,
        "snapshot_frames": tuple(range(0, 50 * num_snapshots, 50)),
        "marks": JointMarks(pixels, values, 500.0) if pictures else None,
        "fps": FPS,
        "reference": "reference" if has_reference else None,
    }


def check(**inputs: Any) -> Figure6:
    """Of a rigid tip in a real clip, so that the caption has all its sentences."""
    told: dict[str, Any] = {"tracked_point_source": "rigid", "clip": "2_scott_0_1_1"}
    return Figure6(**told | inputs)


def drawn(contents: Figure6) -> Any:
    with matplotlib_settings():
        return draw_figure6(contents)


def axes_of(figure: Any, label: str) -> list[Any]:
    return [axes for axes in figure.axes if axes.get_label() == label]


def lines_of(axes: Any) -> dict[str, Any]:
    return {line.get_label(): line for line in axes.get_lines() if line.get_label()[0] != "_"}


def test_the_caption_stands_beside_the_figure_and_not_in_it(tmp_path: Path) -> None:
    contents = check(**make_inputs(1, False, 0, 15))
    png, *_, txt = save_figure(
        partial(draw_figure6, contents), tmp_path / "figure6", contents.caption
    )
    with Image.open(png) as picture:
        assert picture.width == 2055  # 174 mm at 300 dpi
        assert picture.info["Description"] == contents.caption
    assert txt.read_text() == f"{contents.caption}\n"
    assert ONE_SEED_CAVEAT in contents.caption
    texts = [text.get_text() for text in drawn(contents).findobj(lambda a: hasattr(a, "get_text"))]
    assert not any("example" in text for text in texts)


def test_two_systems_share_their_plots_and_all_is_the_input() -> None:
    inputs = make_inputs(2, num_snapshots=3, num_frames=120)
    inputs["snapshot_frames"] = (20, 50, 100)
    contents = check(**inputs, start_frame=20)
    figure = drawn(contents)
    for coordinate, letter in enumerate("xyz"):
        (axes,) = axes_of(figure, letter)
        lines = lines_of(axes)
        assert list(lines) == ["reference", *NAMES[:2]]
        for name, positions in inputs["trajectories"].items():
            np.testing.assert_array_equal(lines[name].get_xdata(), np.arange(20, 120) / FPS)
            np.testing.assert_array_equal(lines[name].get_ydata(), positions[20:120, coordinate])
            assert lines[name].get_linestyle() == "-"
            assert lines[name].get_markevery() == [0, 30, 80]
    (path,) = axes_of(figure, "path")
    for name, line in lines_of(path).items():
        wanted = inputs["trajectories"][name][20:120] @ PROJECTION
        np.testing.assert_allclose(line.get_xydata(), wanted)
    np.testing.assert_allclose(PROJECTION.T @ PROJECTION, np.eye(2), atol=1e-12)
    assert (PROJECTION[:, 0] > 0).tolist() == [True, False, True] and PROJECTION[1, 1] > 0.9

    strips = SnapshotStrips.from_contents(contents)
    for name in contents.motion_names:
        (axes,) = axes_of(figure, f"snapshots of {name}")
        (image,) = axes.get_images()
        strip = np.asarray(image.get_array())
        np.testing.assert_array_equal(strip, strips.pictures[name])
        joints = axes.collections[0].get_offsets()
        for x, y in joints:
            assert (strip[int(y), int(x)] != 230).any(), "a joint is on its bar"
        assert [int(x // strips.spacing_px) for x, _ in joints] == [0, 1, 2]
        assert len(joints) == 3, "nothing is known of the second joint"
    labels = [
        label.get_text() for label in axes_of(figure, "snapshots of reference")[0].get_xticklabels()
    ]
    assert labels == ["20", "50", "100"]


def test_of_more_systems_each_has_small_plots_with_the_first_faint_behind() -> None:
    inputs = make_inputs(3, num_snapshots=2)
    contents = check(**inputs)
    figure = drawn(contents)
    for label in ("x", "y", "z", "path"):
        own = axes_of(figure, label)
        shown = [list(lines_of(axes)) for axes in own]
        assert shown == [["reference"], *(["reference", name] for name in NAMES[:3])]
        assert len({(axes.get_xlim(), axes.get_ylim()) for axes in own}) == 1
        for axes in own[1:]:
            assert lines_of(axes)["reference"].get_alpha() == 0.3
    assert "reference is drawn faintly in all rows" in contents.caption


@pytest.mark.parametrize(("shift", "spread"), [(0.0, 0.0), (40.0, 1e-4), (-3.0, 30.0)])
def test_no_peak_is_cut_and_each_axis_has_a_scale(shift, spread):
    positions = make_trajectory(0, 60) * [1.0, 0.2, 0.01] * spread + shift
    positions[40, 1] += spread  # a single frame
    inputs = {**make_inputs(1, False, 0, 60), "trajectories": {NAMES[0]: positions}}
    figure = drawn(check(**inputs))
    for coordinate, letter in enumerate("xyz"):
        (axes,) = axes_of(figure, letter)
        low, high = axes.get_ylim()
        assert low < positions[:, coordinate].min() <= positions[:, coordinate].max() < high
        assert len([tick for tick in axes.get_yticks() if low <= tick <= high]) >= 2
    (path,) = axes_of(figure, "path")
    assert [text.get_text() for text in path.texts] == ["x", "y", "z"]
    titles = [part.get_suptitle() for part in figure.findobj(lambda a: hasattr(a, "get_suptitle"))]
    assert any("Path (" in title for title in titles)


def test_caption_states_frames_source_filter_and_honesty() -> None:
    raw = check(**make_inputs(1), start_frame=30).caption
    assert "frames 30 to 299 of 2_scott_0_1_1 at 30 fps" in raw
    assert "The fingertip is rigidly attached to the last finger joint" in raw
    assert "The motion is unfiltered." in raw
    assert "They are largest and darkest at 500 m/s³ and above; joints below" in raw
    assert raw.endswith(ONE_SEED_CAVEAT) and "an example, not a comparison" in raw
    assert "length" not in raw and "row" not in raw
    filtered = check(**make_inputs(1), post_filter="savgol").caption
    assert "Savitzky-Golay" in filtered and "unfiltered" not in filtered
    inputs = make_inputs(1)
    inputs["trajectories"][NAMES[0]] = make_trajectory(5, 200)
    contents = check(**inputs)
    assert contents.window_num_frames == 200
    assert "All motions are cut to the length of the shortest one." in contents.caption


def test_marks_grow_and_darken_with_the_value_and_faint_ones_are_none() -> None:
    inputs = make_inputs(1, False, 1, 30)
    strengths: dict[float, Any] = {}
    for strength in (1.0, 0.9, 0.3, 0.05, 7.0):
        values = {NAMES[0]: np.array([[500.0 * strength, np.nan]])}
        inputs["marks"] = JointMarks(inputs["marks"].pixels, values, 500.0)
        (axes,) = axes_of(drawn(check(**inputs)), f"snapshots of {NAMES[0]}")
        marks = axes.collections[0]
        strengths[strength] = (list(marks.get_sizes()), marks.get_facecolor().tolist())
    assert strengths[0.05] == ([], [])
    assert strengths[7.0] == strengths[1.0]
    sizes = [strengths[each][0][0] for each in (0.3, 0.9, 1.0)]
    opacities = [strengths[each][1][0][3] for each in (0.3, 0.9, 1.0)]
    assert sizes == sorted(sizes) and opacities == sorted(opacities) and sizes[0] < sizes[1]
    assert strengths[1.0][1][0][:3] == pytest.approx(MARK_RGB)


def test_panels_and_width_can_be_chosen_and_count_from_a() -> None:
    inputs = make_inputs(2, False, 3)
    figure = drawn(check(**inputs, requested_panels=("a", "d"), width_mm=COLUMN_MM))
    assert figure.get_figwidth() == pytest.approx(COLUMN_MM / 25.4)
    titles = [part.get_suptitle() for part in figure.findobj(lambda a: hasattr(a, "get_suptitle"))]
    assert [title[0] for title in titles if title] == ["a", "b"]
    assert {axes.get_label() for axes in figure.axes} == {
        *"xyz", *(f"tremor of {name}" for name in NAMES[:2])
    }  # fmt: skip
    assert [line.get_markevery()[:2] for line in lines_of(axes_of(figure, "x")[0]).values()] == [
        [0, 50]
    ] * 2
    with pytest.raises(
        FigureError, match=r"\(b, d\) can be drawn.*needs at least 32 frames; the motion has 15"
    ):
        check(**make_inputs(1, False, 0, 15), requested_panels=("b", "d"))


def test_a_column_that_fits_is_no_taller_than_a_page() -> None:
    for count in (4, 5):
        inputs = make_inputs(count, False, 3)
        figure = drawn(check(**inputs, requested_panels=("a", "b"), width_mm=COLUMN_MM))
        is_low = figure.get_figheight() * 25.4 <= MAX_HEIGHT_MM
        assert is_low == column_figure_fits_page(count, ("a", "b")) == (count == 4)


def test_snapshot_frames_are_every_50_of_the_window() -> None:
    assert choose_snapshot_frames(1000) == (0, 50, 100, 150, 200, 250)
    assert choose_snapshot_frames(131, start_frame=30) == (30, 80, 130)
    assert choose_snapshot_frames(15) == (0,)


SLOW = pytest.mark.slow
FAR = 107_000


@pytest.mark.parametrize(
    ("inputs", "start", "width"),
    [
        (make_inputs(1, False, 1, 1), 0, PAGE_MM),
        (make_inputs(2, True, 6, names=NAMES), 0, COLUMN_MM),
        (make_inputs(5, True, 7, names=ODD_NAMES), FAR, PAGE_MM),
        pytest.param(make_inputs(5, False, 1, 40), 0, PAGE_MM, marks=SLOW),
        *(
            pytest.param(make_inputs(count, has_reference, number), 0, width, marks=SLOW)
            for count in (1, 2, 4, 6)
            for has_reference, number in ((False, 2), (True, 7), (True, 0))
            for width in (PAGE_MM, COLUMN_MM)
            if width == PAGE_MM or column_figure_fits_page(count + has_reference, PANELS)
        ),
    ],
)
def test_nothing_overlaps(monkeypatch, inputs, start, width):
    if start:  # far from the origin, with large frame numbers
        inputs = inputs | {
            "trajectories": {
                name: np.concatenate([np.zeros((start, 3)), positions - 9.5])
                for name, positions in inputs["trajectories"].items()
            },
            "snapshot_frames": tuple(start + frame for frame in inputs["snapshot_frames"]),
        }
    contents = check(**inputs, start_frame=start, width_mm=width)
    with matplotlib_settings():
        figure = draw_figure6(contents)
        texts = drawn_texts(figure, monkeypatch)
    written = "".join(text for text, _ in texts).replace(" ", "").replace("\n", "")
    for name in contents.motion_names:
        assert name.replace(" ", "") in written
    labels = [(axes.get_label(), axes.get_window_extent()) for axes in figure.axes]
    panels = {f"{k} {label}": box for k, (label, box) in enumerate(labels) if label != "path"}
    check_apart(figure, texts, panels)
    assert min(box.height for box in panels.values()) > 10 and figure.get_figheight() < 9.3
    for axes in axes_of(figure, "path"):
        box = axes.get_window_extent()
        assert min(box.width, box.height) > 45  # pixels of 1/144 inch
    bodies = [box.height for label, box in labels if label.startswith("snapshots")]
    assert bodies == pytest.approx(bodies[:1] * len(bodies), rel=0.05), "all of one size"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"trajectories": {}, "reference": None}, "1 to 6 systems"),
        (
            {"trajectories": {str(i): np.zeros((9, 3)) for i in range(7)}, "reference": None},
            "got 7",
        ),
        ({"reference": "ground truth"}, "'ground truth' is not among the trajectories"),
        ({"start_frame": 300}, "only 300 frames"),
        ({"tip": np.zeros((0, 3))}, "only 0 frames"),
        (
            {"tip": np.where(np.arange(90).reshape(30, 3) == 40, np.nan, 0.0)},
            "at frame 13 is not a finite number",
        ),
        ({"marks": None}, "and no joint marks"),
        ({"snapshots": {"another": np.zeros((6, *FRAME, 3), np.uint8)}}, "snapshots of 'another'"),
    ],
)
def test_refuses_with_one_sentence(changes: dict[str, Any], message: str) -> None:
    inputs = make_inputs(1, has_reference=changes.keys() & {"reference", "tip"} != set())
    if "tip" in changes:
        inputs["trajectories"][NAMES[0]] = changes["tip"]
    else:
        inputs |= changes
    with pytest.raises(FigureError, match=message):
        check(**inputs)


@pytest.mark.gl
@pytest.mark.parametrize("view", ["front", "side"])
def test_cuts_follow_the_body_and_lose_nothing_of_it(view: str) -> None:
    rng = np.random.default_rng(0)
    motion = BodyMotion.zero_pose(61)
    motion.poses[:] = rng.normal(scale=0.15, size=(1, 165))
    motion.trans[:, 0] = np.linspace(0.0, 4.0, 61)
    body, frames = load_body(), (0, 30, 60)
    settings = RenderSettings(160, 160, view=view, is_transparent=True)
    stage = make_camera_setup(body, [motion], view)
    pictures = render_stills(body, motion, frames, settings, stage=stage)
    pixels = projected_joints(body, motion, frames, settings, stage)
    marks = JointMarks({"a": pixels}, {"a": np.ones(pixels.shape[:2])}, 1.0)
    shown = np.repeat(pictures[..., 3:], 3, axis=-1)
    tracks = {"a": make_trajectory(0, 61)}
    strips = SnapshotStrips.from_contents(Figure6(tracks, {"a": shown}, frames, FPS, marks=marks))
    strip = strips.pictures["a"]
    assert strips.snapshot_width_px < 140 and ((0 < strip) & (strip < 255)).any()
    cut = [strip[:, k * strips.spacing_px :][:, : strips.snapshot_width_px] for k in range(3)]
    assert [(each > 0).sum() for each in cut] == [(each > 0).sum() for each in shown]
    x, y = np.floor(strips.joint_pixels["a"][:, 16]).astype(int).T  # a shoulder
    assert (strip[y, x] == 255).all()


def test_joints_that_nobody_knows_leave_pictures_whole() -> None:
    inputs = make_inputs(1, False, 2)
    pixels = {NAMES[0]: np.full((2, 2, 2), np.nan)}
    inputs["marks"] = JointMarks(pixels, inputs["marks"].joint_jerk, 500.0)
    strips = SnapshotStrips.from_contents(check(**inputs))
    for k, picture in enumerate(inputs["snapshots"][NAMES[0]]):
        cut = strips.pictures[NAMES[0]][:, k * strips.spacing_px :][:, : strips.snapshot_width_px]
        np.testing.assert_array_equal(cut, picture)


def wave(hertz: float, metres: float, num_frames: int = 300) -> np.ndarray:
    t = np.arange(num_frames) / FPS
    return metres * np.stack([np.sin(2 * np.pi * hertz * t + k) for k in range(3)], axis=1)


@pytest.mark.parametrize(("hertz", "kept"), [(1.0, 0.0), (2.0, 0.0), (5.0, 0.5), (10.0, 1.0)])
def test_what_is_slow_is_taken_away_and_what_is_fast_stays(hertz: float, kept: float) -> None:
    """Forwards and backwards, a Butterworth filter halves what lies at its cut-off."""
    off = high_pass_mm(wave(hertz, 0.01), FPS)[INSIDE]
    assert np.abs(off - kept * 1000 * wave(hertz, 0.01)[INSIDE]).max() < 0.1


def test_each_motion_has_a_strip_on_one_scale_with_its_rms_and_sees_what_lies_before() -> None:
    """The filter starts at the clip's beginning, so a window has no ringing at its own."""
    slow = wave(0.5, 0.3, 600)
    tracks = {
        name: slow + wave(9.0, size, 600) for name, size in (("calm", 0.001), ("wild", 0.004))
    }
    figure = drawn(Figure6(tracks, {}, (), FPS, start_frame=300))
    strips = [axes_of(figure, f"tremor of {name}")[0] for name in tracks]
    assert len({axes.get_ylim() for axes in strips}) == 1
    for axes, track in zip(strips, tracks.values(), strict=True):
        off = high_pass_mm(track, FPS)[300:]
        lifts = axes.get_yticks()
        assert lifts[0] > lifts[1] == 0.0 > lifts[2], "x, y and z stand apart"
        limit = np.percentile(
            np.abs([high_pass_mm(each, FPS)[300:] for each in tracks.values()]), 99
        )
        for k, line in enumerate(axes.get_lines()[:3]):
            np.testing.assert_allclose(
                line.get_ydata(), np.clip(off[:, k], -limit, limit) + lifts[k]
            )
            np.testing.assert_allclose(line.get_xdata(), np.arange(300, 600) / FPS)
        rms = np.sqrt(np.square(off).sum(1).mean())
        assert f"{rms:.1f} mm rms" in axes.get_ylabel()
    short = {"a": wave(1.0, 0.1, MIN_TREMOR_FRAMES - 1)}
    assert "d" not in Figure6(short, {}, (), FPS).panels


def test_a_spike_of_tremor_is_cut_marked_and_told_and_flattens_nothing() -> None:
    calm = wave(0.5, 0.3) + wave(9.0, 0.002)
    spiked = calm.copy()
    spiked[[7, 8], 1] += 0.5  # as a jump at the start of a window
    contents = Figure6({"calm": calm, "b": calm, "c": calm, "spiked": spiked}, {}, (), FPS)
    figure = drawn(contents)
    (strip,), *_, (other,) = (
        axes_of(figure, f"tremor of {name}") for name in contents.motion_names
    )
    assert other.get_ylim() == strip.get_ylim() and strip.get_ylim()[1] < 20.0, "mm, of 500"
    peaks = [dots.get_offsets() for dots in other.collections]
    assert [len(each) > 0 for each in peaks][2:4] == [True, True], "of y, upwards and downwards"
    assert any(abs(x - 7.5 / FPS) < 1 / FPS for x, _ in peaks[2])
    low, high = other.get_ylim()
    assert all(low < y < high for each in peaks for _, y in each)
    assert "triangles mark peaks above it, which are cut off" in contents.caption
    assert "(spiked)" in contents.caption
    inks = [line.get_color() for line in strip.get_lines()[:3]]
    luma = [sum(int(ink[k : k + 2], 16) for k in (1, 3, 5)) / 765 for ink in inks]
    assert luma[1] - luma[0] > 0.15 < luma[2] - luma[1], "x, y and z differ in grey, too"


def test_hands_of_five_systems_are_seen_in_print() -> None:
    """At 174 mm and 300 dpi; the joints are those of the open body with its arms lowered."""
    from conventions.joints import FACE, HANDS, JOINT_INDEX, UPPER_BODY

    pose = BodyMotion.zero_pose(1)
    for side, turn in (("left", -1.1), ("right", 1.1)):
        start = 3 * JOINT_INDEX[f"{side}_shoulder"]
        pose.poses[:, start : start + 3] = [0.0, 0.0, turn]
    joints = load_body().joint_positions(pose)[0]
    size = 512
    pixels = 20 + (joints[:, :2] - joints[:, :2].min(axis=0)) * 440 / np.ptp(joints[:, 1])
    pixels[:, 1] = size - pixels[:, 1]
    names = (*NAMES[:5], "reference")
    stack = np.full((6, size, size, 3), 200, np.uint8)
    marks = JointMarks(
        {name: np.tile(pixels, (6, 1, 1)) for name in names},
        {name: np.zeros((6, len(joints))) for name in names},
        500.0,
        crop_joints=(*UPPER_BODY, *HANDS, *FACE),
    )
    contents = Figure6(
        {name: make_trajectory(i) for i, name in enumerate(names)},
        dict.fromkeys(names, stack),
        tuple(range(0, 300, 50)),
        marks=marks,
        reference="reference",
    )
    strips = SnapshotStrips.from_contents(contents)
    with matplotlib_settings():
        figure = draw_figure6(contents)
        figure.set_dpi(300)
        lay_out(figure)
    wrist, tip = JOINT_INDEX["left_wrist"], JOINT_INDEX["left_middle3"]
    for name in names:
        (axes,) = axes_of(figure, f"snapshots of {name}")
        ends = axes.transData.transform(strips.joint_pixels[name][0, [wrist, tip]])
        assert np.linalg.norm(ends[1] - ends[0]) >= 25
    assert np.isnan(strips.joint_pixels["reference"][0, JOINT_INDEX["left_ankle"]]).all(), (
        "is cut off"
    )
