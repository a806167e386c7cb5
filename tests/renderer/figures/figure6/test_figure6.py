"""Figure 6: what it shows is what it was given, and nothing covers anything else."""

import itertools
from typing import Any

import numpy as np
import pytest
from PIL import Image

from renderer.figures.figure6.figure6 import draw_figure6, figure6
from renderer.figures.figure6.layout import plan_layout
from renderer.figures.figure6.snapshots import JointMarks, crop_alike
from renderer.figures.figure6.spec import (
    ONE_SEED_CAVEAT,
    Figure6,
    check_figure6,
    choose_snapshot_frames,
)
from renderer.figures.files import FigureError, matplotlib_settings
from renderer.figures.page import LINE, SWATCH
from renderer.figures.style import FIGURE_WIDTH_IN
from tests.renderer.figures.figure_checks import NAMES, ODD_NAMES, check_apart, drawn_texts, overlap

FRAME = (48, 64)
SLOW = pytest.mark.slow


def make_trajectory(seed: int, num_frames: int = 300) -> np.ndarray:
    rng = np.random.default_rng(seed)
    t = np.arange(num_frames)[:, None] / 30.0
    wave = np.sin(t * rng.uniform(0.5, 3.0, 3) + rng.uniform(0, 6, 3)) * [0.3, 0.25, 0.1]
    noise = rng.normal(scale=0.01, size=(num_frames, 3))
    return (wave + noise + [-0.3, 1.1, 0.3]).astype(np.float32)


def make_snapshots(seed: int, count: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    pictures = np.full((count, *FRAME, 3), 230, dtype=np.uint8)
    for picture in pictures:
        left = rng.integers(20, 34)
        picture[8:44, left : left + 10] = (90, 110, 140)
    return pictures


def make_inputs(
    num_systems: int,
    has_reference: bool = True,
    num_snapshots: int = 6,
    num_frames: int = 300,
    names: tuple[str, ...] = NAMES,
) -> dict[str, Any]:
    """Arguments of ``check_figure6``."""
    shown = [*names[:num_systems], *(["reference"] if has_reference else [])]
    return {
        "trajectories": {name: make_trajectory(i, num_frames) for i, name in enumerate(shown)},
        "snapshots": {name: make_snapshots(i, num_snapshots) for i, name in enumerate(shown)}
        if num_snapshots
        else {},
        "snapshot_frames": tuple(range(0, 50 * num_snapshots, 50)),
        "fps": 30.0,
        "reference": "reference" if has_reference else None,
    }


def make_marks(inputs: dict[str, Any], **changes: object) -> JointMarks:
    """Two joints in each snapshot: one full and one without a value."""
    stacks = {name: len(pictures) for name, pictures in inputs["snapshots"].items()}
    marks = {
        "pixels": {name: np.full((count, 2, 2), 24.0) for name, count in stacks.items()},
        "values": {name: np.tile([500.0, np.nan], (count, 1)) for name, count in stacks.items()},
        "full_scale": 500.0,
    }
    return JointMarks(**{**marks, **changes})


def check(**inputs: object) -> Figure6:
    """Of a rigid tip in a real clip, so that the caption has all its sentences."""
    told = {"tip_source": "rigid", "clip": "2_scott_0_1_1"}
    return check_figure6(**{**told, **inputs})


def drawn(contents: Figure6) -> Any:
    with matplotlib_settings():
        return draw_figure6(contents)


def axes_of(figure: Any) -> dict[str, Any]:
    return {ax.get_label(): ax for ax in figure.axes}


def test_the_file_tells_its_caption(tmp_path):
    files = figure6(check(**make_inputs(1, False, 0, 15)), tmp_path / "figure6")
    with Image.open(files.png) as picture:
        assert picture.width == 2016
        assert ONE_SEED_CAVEAT in picture.info["Description"]


def test_the_figure_is_its_input():
    """Lines, one scale of the three coordinates, snapshots under their frames, the caption."""
    inputs = make_inputs(2, num_snapshots=3)
    inputs["snapshot_frames"] = (20, 50, 100)
    contents = check(**inputs, start_frame=20, window_frames=100)
    figure = drawn(contents)
    axes = axes_of(figure)
    for coordinate, letter in enumerate("xyz"):
        lines = {line.get_label(): line for line in axes[letter].get_lines()}
        for name, positions in inputs["trajectories"].items():
            np.testing.assert_array_equal(lines[name].get_xdata(), np.arange(20, 120) / 30.0)
            np.testing.assert_array_equal(lines[name].get_ydata(), positions[20:120, coordinate])
    for line in axes["path"].get_lines():
        positions = inputs["trajectories"][line.get_label()]
        np.testing.assert_array_equal(np.stack(line.get_data_3d(), 1), positions[20:120])
    scales = [np.ptp(axes[x].get_ylim()) / axes[x].get_window_extent().height for x in "xyz"]
    np.testing.assert_allclose(scales, scales[0], rtol=1e-9)
    assert contents.caption in " ".join(text.get_text() for text in figure.texts)
    placed = {image.get_label(): image for image in axes["snapshots"].get_images()}
    boxes = {label: image.get_window_extent() for label, image in placed.items()}
    by_place = sorted(placed, key=lambda label: (-round(boxes[label].y0), boxes[label].x0))
    assert by_place == [
        f"{name} at frame {frame}" for name in ("reference", *NAMES[:2]) for frame in (20, 50, 100)
    ]
    for name, pictures in crop_alike(inputs["snapshots"]).items():
        for frame, picture in zip((20, 50, 100), pictures, strict=True):
            label = f"{name} at frame {frame}"
            np.testing.assert_array_equal(placed[label].get_array(), picture)
            height, width = picture.shape[:2]
            shown = boxes[label]
            assert shown.width / shown.height == pytest.approx(width / height, rel=1e-6)


@pytest.mark.parametrize(("shift", "spread"), [(0.0, 0.0), (40.0, 1e-4), (-3.0, 30.0)])
def test_every_point_is_inside_its_axis_and_each_axis_has_a_scale(shift, spread):
    tips = make_trajectory(0, 30) * [1.0, 0.2, 0.01]
    positions = tips.astype(np.float32) * spread + shift
    inputs = {**make_inputs(1, False, 0, 30), "trajectories": {NAMES[0]: positions}}
    axes = axes_of(drawn(check(**inputs)))
    for coordinate, letter in enumerate("xyz"):
        low, high = axes[letter].get_ylim()
        assert low < positions[:, coordinate].min() <= positions[:, coordinate].max() < high
        inside = [tick for tick in axes[letter].get_yticks() if low <= tick <= high]
        assert len(inside) >= 2


def test_caption_states_frames_source_filter_and_honesty():
    raw = check(**make_inputs(1), start_frame=30).caption
    assert "frames 30 to 299 of 2_scott_0_1_1 at 30 frames per second" in raw
    assert "Tip source: rigid." in raw
    assert "Raw motion, no filter." in raw
    assert raw.endswith("One clip and one noise seed: an example, not a comparison of the systems.")
    assert "length" not in raw
    filtered = check(**make_inputs(1), post_filter="savgol").caption
    assert "Savitzky-Golay" in filtered and "Raw" not in filtered
    inputs = make_inputs(1)
    inputs["trajectories"][NAMES[0]] = make_trajectory(5, 200)
    contents = check(**inputs)
    assert contents.num_frames == 200
    assert "The motions differ in length and are cut to the shortest." in contents.caption


def test_marks_are_in_the_pictures_and_their_scale_in_the_caption():
    inputs = make_inputs(1, False, 2, 30)
    contents = check(**inputs, marks=make_marks(inputs))
    assert "jerk of each joint around the frame, largest and darkest at 500 m/s³" in (
        contents.caption
    )
    for image in axes_of(drawn(contents))["snapshots"].get_images():
        assert image.get_array().min() < 60  # nothing else in these pictures is below 90


def test_snapshot_frames_are_every_50_of_the_window():
    assert choose_snapshot_frames(1000) == (0, 50, 100, 150, 200, 250)
    assert choose_snapshot_frames(1000, start_frame=30, window_frames=101) == (30, 80, 130)
    assert choose_snapshot_frames(15) == (0,)
    assert choose_snapshot_frames(1000, window_frames=1000) == tuple(range(0, 350, 50))


def drawn_path_box(figure: object) -> object:
    """Pixels that differ between the drawing with and without the path's axes."""
    from matplotlib.transforms import Bbox

    axes = next(ax for ax in figure.axes if ax.get_label() == "path")
    complete = np.array(figure.canvas.buffer_rgba()).astype(int)
    axes.set_visible(False)
    figure.canvas.draw()
    difference = np.abs(complete - np.asarray(figure.canvas.buffer_rgba())).any(axis=-1)
    rows, columns = np.nonzero(difference)
    height = len(difference)
    return Bbox([[columns.min(), height - 1 - rows.max()], [columns.max(), height - rows.min()]])


def check_legible(contents: Figure6, monkeypatch: pytest.MonkeyPatch) -> None:
    with matplotlib_settings():
        figure = draw_figure6(contents)
        texts = drawn_texts(figure, monkeypatch)
        written = "".join(text for text, _ in texts).replace(" ", "")
        for name in contents.trajectories:
            assert written.count(name.replace(" ", "")) >= (2 if contents.snapshots else 1)
        panels, num_scales = {}, 0
        for ax in figure.axes:
            if ax.get_label() in "xyz":
                panels[ax.get_label()] = ax.get_window_extent()
            elif ax.get_label() == "scale of marks":
                num_scales += 1
                panels[f"scale at {ax.get_position().x0}"] = ax.get_window_extent()
            else:
                panels |= {image.get_label(): image.get_window_extent() for image in ax.images}
        assert num_scales == (2 if contents.marks is not None else 0)
        num_pictures = len(contents.snapshots) * len(contents.snapshot_frames)
        assert len(panels) == num_scales + 3 + num_pictures
        check_apart(figure, texts, panels)
        path = drawn_path_box(figure)
    assert path.width > 90 and path.height > 150  # pixels of 1/144 inch
    for label, panel in panels.items():
        assert not overlap(path, panel), f"the path covers {label}"
    for text, box in texts:
        if text not in ("x", "y", "z"):
            assert not overlap(path, box), f"the path covers {text!r}"
    assert figure.get_figwidth() == FIGURE_WIDTH_IN
    assert figure.get_figheight() < 9.7  # a page of A4 with an inch on both sides


FAR = 107_000


@pytest.mark.parametrize(
    ("inputs", "has_marks", "start"),
    [
        pytest.param(make_inputs(1, False, 1, 1), False, 0, marks=SLOW),
        (make_inputs(3, True, 7, names=ODD_NAMES), False, FAR),
        (make_inputs(6, True, 1, 15, names=ODD_NAMES), True, 0),
        *(
            pytest.param(make_inputs(count, has_reference, number), number == 7, 0, marks=SLOW)
            for count in (1, 2, 4, 5, 6)
            for has_reference, number in ((False, 2), (True, 7), (True, 0))
        ),
    ],
)
def test_nothing_overlaps(monkeypatch, inputs, has_marks, start):
    marks = make_marks(inputs, full_scale=20000.0) if has_marks else None
    if start:  # far from the origin, with large frame numbers
        inputs = inputs | {
            "trajectories": {
                name: np.concatenate([np.zeros((start, 3)), positions - 1234.5])
                for name, positions in inputs["trajectories"].items()
            },
            "snapshot_frames": tuple(start + frame for frame in inputs["snapshot_frames"]),
        }
    check_legible(check(**inputs, start_frame=start, marks=marks), monkeypatch)


def test_keys_differ_in_a_greyscale_print():
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    scale = 288.0
    with matplotlib_settings():
        figure = draw_figure6(check(**make_inputs(6, True, 0, 15)))
        figure.set_dpi(scale)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        picture = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])
    grey = np.asarray(picture.convert("L")).astype(float)
    layout = plan_layout(("reference", *NAMES), 0, 1.0, 1, 0.3)
    samples = []
    for key in layout.legend:
        left, top = round(key.rect.left * scale), round(key.rect.top * scale)
        sample = grey[top : top + round(LINE * scale), left : left + round(SWATCH * scale)]
        samples.append(sample)
        assert sample.min() < 190  # visible on white
    for a, b in itertools.combinations(samples, 2):
        assert np.abs(a - b).mean() > 2.0
        assert (np.abs(a - b) > 40).sum() > 40


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"trajectories": {}, "reference": None}, "1 to 6 systems"),
        (
            {"trajectories": {str(i): np.zeros((9, 3)) for i in range(7)}, "reference": None},
            "got 7",
        ),
        ({"reference": "ground truth"}, "'ground truth' has no trajectory"),
        ({"fps": 0.0}, "frame rate must be positive; got 0"),
        ({"fps": float("nan")}, "frame rate"),
        ({"start_frame": 300}, "only 300 frames"),
        ({"start_frame": -1}, "frame 0 or later"),
        ({"window_frames": 0}, "at least 1 frame"),
        ({"snapshot_frames": range(8)}, "1 to 7 snapshots; got 8"),
        ({"snapshot_frames": (0, 50)}, "has 6 snapshots for 2 frames"),
        ({"tip": np.zeros((30, 2))}, r"shape \(frames, 3\); got \(30, 2\)"),
        ({"tip": np.zeros((0, 3))}, "only 0 frames"),
        (
            {"tip": np.where(np.arange(90).reshape(30, 3) == 40, np.nan, 0.0)},
            "not a number at frame 13",
        ),
        ({"pictures": np.zeros((6, *FRAME, 3), np.float32)}, "must be uint8"),
        ({"pictures": np.zeros((6, *FRAME, 4), np.uint8)}, "height, width, 3"),
        ({"pictures": np.zeros((6, 10, 10, 3), np.uint8)}, "one size"),
        ({"snapshots": {NAMES[0]: make_snapshots(0, 6)}}, "same systems"),
        ({"marks": {"full_scale": 0.0}}, "full scale of marks must be positive; got 0"),
        ({"marks": {"values": {}}}, "of the same systems"),
        ({"marks": {"pixels": {NAMES[0]: np.zeros((6, 2, 3))}}}, r"pixels \(N, J, 2\)"),
        ({"marks": {"values": {NAMES[0]: np.zeros((5, 2))}}}, r"got \(6, 2, 2\) and \(5, 2\)"),
    ],
)
def test_refuses_with_one_sentence(changes, message):
    inputs = make_inputs(1, has_reference="marks" not in changes)
    with pytest.raises(FigureError, match=message):
        if "tip" in changes:
            inputs["trajectories"][NAMES[0]] = changes["tip"]
        elif "pictures" in changes:
            inputs["snapshots"][NAMES[0]] = changes["pictures"]
        elif "marks" in changes:
            inputs["marks"] = make_marks(inputs, **changes["marks"])
        else:
            inputs |= changes
        check(**inputs)
