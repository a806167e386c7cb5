"""Figure 6: what it shows is what it was given, and nothing covers anything else."""

import itertools
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from renderer.figures.figure6.figure6 import draw_figure6, figure6
from renderer.figures.figure6.snapshots import JointMarks, crop_alike
from renderer.figures.figure6.spec import (
    ONE_SEED_CAVEAT,
    Figure6,
    check_figure6,
    choose_snapshot_frames,
)
from renderer.figures.files import FigureError, FigureFiles, matplotlib_settings
from renderer.figures.style import FIGURE_WIDTH_IN
from tests.helpers import ROOT
from tests.renderer.figures.figure_checks import drawn_texts, overlap

NAMES = (
    "globaldiff/local",
    "globaldiff/global",
    "globaldiff/joint",
    "globaldiff/skeleton.s2",
    "globaldiff/full",
    "asynfusion/lcm",
)
FRAME = (48, 64)


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
) -> dict[str, object]:
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


def make_marks(inputs: dict[str, object], **changes: object) -> JointMarks:
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
    return check_figure6(**{**told, **inputs})  # type: ignore[arg-type]


@pytest.fixture
def settings() -> Iterator[None]:
    with matplotlib_settings():
        yield


# ---------------------------------------------------------------------------- the files


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> FigureFiles:
    """One figure of two systems and a reference, with snapshots, in a folder of its own."""
    folder = tmp_path_factory.mktemp("figure") / "new"
    return figure6(check(**make_inputs(2)), folder / "figure6.s2")


def test_writes_three_files_that_open_and_nothing_else(written: FigureFiles) -> None:
    assert sorted(path.name for path in written.png.parent.iterdir()) == [
        "figure6.s2.pdf",
        "figure6.s2.png",
        "figure6.s2.svg",
    ]
    with Image.open(written.png) as picture:
        assert picture.width == 2016
        assert np.asarray(picture.convert("L")).std() > 10
        assert ONE_SEED_CAVEAT in picture.info["Description"]
    assert ElementTree.parse(written.svg).getroot().tag.endswith("svg")
    assert written.pdf.read_bytes().startswith(b"%PDF-")


def test_a_failure_leaves_old_files_and_no_half_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = figure6(check(**make_inputs(1, num_snapshots=0)), tmp_path / "figure6")
    before = {path: path.read_bytes() for path in files}
    from matplotlib.backends.backend_pdf import FigureCanvasPdf

    def full_disk(*args: object, **kwargs: object) -> None:
        raise OSError("No space left on device")

    monkeypatch.setattr(FigureCanvasPdf, "print_figure", full_disk)
    with pytest.raises(OSError, match="No space"):
        figure6(check(**make_inputs(2, num_snapshots=0)), tmp_path / "figure6")

    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_fonts_are_embedded_truetype(written: FigureFiles) -> None:
    pdf = written.pdf.read_bytes()

    assert b"/FontFile2" in pdf
    assert b"/Subtype /TrueType" in pdf or b"/CIDFontType2" in pdf
    assert b"/Type3" not in pdf


def test_svg_needs_no_font_and_no_other_file(written: FigureFiles) -> None:
    elements = list(ElementTree.parse(written.svg).iter())
    tags = {element.tag.rpartition("}")[2] for element in elements}
    assert "text" not in tags
    assert "image" in tags
    links = {
        value[:11]
        for element in elements
        for name, value in element.items()
        if name.endswith("href") and not value.startswith("#")
    }
    assert links == {"data:image/"}


def test_same_input_gives_the_same_bytes_in_another_process(
    written: FigureFiles, tmp_path: Path
) -> None:
    program = (
        "import sys; from pathlib import Path\n"
        "import tests.renderer.figures.figure6.test_figure6 as t\n"
        "t.figure6(t.check(**t.make_inputs(2)), Path(sys.argv[1]))\n"
    )
    command = [sys.executable, "-c", program, str(tmp_path / "other")]
    subprocess.run(command, check=True, cwd=ROOT, timeout=300)

    for path in written:
        assert path.read_bytes() == (tmp_path / f"other{path.suffix}").read_bytes(), path.suffix


def test_figures_of_several_threads_are_those_of_one(tmp_path: Path) -> None:
    inputs = make_inputs(1, num_snapshots=0, num_frames=30)
    alone = figure6(check(**inputs), tmp_path / "alone").png.read_bytes()
    with ThreadPoolExecutor(3) as threads:
        stems = [tmp_path / str(i) for i in range(3)]
        files = list(threads.map(lambda stem: figure6(check(**inputs), stem), stems))

    assert [each.png.read_bytes() == alone for each in files] == [True, True, True]


def test_importing_is_cheap_and_pyplot_is_never_loaded(tmp_path: Path) -> None:
    program = (
        "import sys, numpy; from pathlib import Path\n"
        "from renderer.figures.figure6.figure6 import figure6\n"
        "from renderer.figures.figure6.spec import check_figure6\n"
        "assert 'matplotlib' not in sys.modules\n"
        "t = {'a': numpy.random.default_rng(0).random((5, 3))}\n"
        "figure6(check_figure6(t, {}, (), 30.0), Path(sys.argv[1]))\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
        "import matplotlib; assert matplotlib.rcParams['pdf.fonttype'] == 3\n"
    )
    subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "figure6")],
        check=True,
        cwd=ROOT,
        timeout=300,
    )


# ---------------------------------------------------------------------------- the contents


def test_lines_are_the_input(settings: None) -> None:
    inputs = make_inputs(3)
    contents = check(**inputs, start_frame=20, window_frames=100)
    figure = draw_figure6(contents)

    axes = {ax.get_label(): ax for ax in figure.axes}
    for coordinate, letter in enumerate("xyz"):
        lines = {line.get_label(): line for line in axes[letter].get_lines()}
        for name, positions in inputs["trajectories"].items():
            np.testing.assert_array_equal(lines[name].get_xdata(), np.arange(20, 120) / 30.0)
            np.testing.assert_array_equal(lines[name].get_ydata(), positions[20:120, coordinate])
    for line in axes["path"].get_lines():
        positions = inputs["trajectories"][line.get_label()]
        np.testing.assert_array_equal(np.stack(line.get_data_3d(), 1), positions[20:120])


def test_the_three_coordinates_share_one_scale(settings: None) -> None:
    figure = draw_figure6(check(**make_inputs(2)))
    axes = {ax.get_label(): ax for ax in figure.axes}

    scales = [
        np.ptp(axes[letter].get_ylim()) / axes[letter].get_window_extent().height
        for letter in "xyz"
    ]
    np.testing.assert_allclose(scales, scales[0], rtol=1e-9)


@pytest.mark.parametrize("shift", [0.0, 40.0])
@pytest.mark.parametrize("spread", [0.0, 1e-4, 1.0, 30.0])
def test_every_point_is_inside_its_axis_and_each_axis_has_a_scale(
    settings: None, shift: float, spread: float
) -> None:
    positions = (make_trajectory(0) * [1.0, 0.2, 0.01]).astype(np.float32) * spread + shift
    figure = draw_figure6(
        check(
            **{
                **make_inputs(1),
                "trajectories": {NAMES[0]: positions},
                "reference": None,
                "snapshots": {},
            }
        )
    )
    axes = {ax.get_label(): ax for ax in figure.axes}
    for coordinate, letter in enumerate("xyz"):
        low, high = axes[letter].get_ylim()
        assert low < positions[:, coordinate].min() <= positions[:, coordinate].max() < high
        inside = [tick for tick in axes[letter].get_yticks() if low <= tick <= high]
        assert len(inside) >= 2


def test_snapshots_stand_in_rows_under_their_frames_reference_first(settings: None) -> None:
    inputs = make_inputs(2, num_snapshots=3)
    figure = draw_figure6(check(**inputs))

    axes = next(ax for ax in figure.axes if ax.get_label() == "snapshots")
    placed = {image.get_label(): image for image in axes.get_images()}
    boxes = {label: image.get_window_extent() for label, image in placed.items()}
    by_place = sorted(placed, key=lambda label: (-round(boxes[label].y0), boxes[label].x0))
    assert by_place == [
        f"{name} at frame {frame}" for name in ("reference", *NAMES[:2]) for frame in (0, 50, 100)
    ]
    for name, pictures in crop_alike(inputs["snapshots"]).items():
        for frame, picture in zip((0, 50, 100), pictures, strict=True):
            label = f"{name} at frame {frame}"
            np.testing.assert_array_equal(placed[label].get_array(), picture)
            height, width = picture.shape[:2]
            shown = boxes[label]
            assert shown.width / shown.height == pytest.approx(width / height, rel=1e-6)


def test_caption_states_frames_source_filter_and_honesty() -> None:
    raw = check(**make_inputs(1), start_frame=30).caption
    assert "frames 30 to 299 of 2_scott_0_1_1 at 30 frames per second" in raw
    assert "metres" in raw
    assert "Tip source: rigid." in raw
    assert "Raw motion, no filter." in raw
    assert raw.endswith("One clip and one noise seed: an example, not a comparison of the systems.")
    assert "length" not in raw

    filtered = check(**make_inputs(1), post_filter="savgol").caption
    assert "Savitzky-Golay" in filtered
    assert "Raw" not in filtered


def test_the_whole_caption_is_in_the_picture(settings: None) -> None:
    contents = check(**make_inputs(2))
    texts = [text.get_text() for text in draw_figure6(contents).texts]

    assert contents.caption in " ".join(texts)


def test_marks_are_in_the_pictures_and_their_scale_in_the_caption(settings: None) -> None:
    inputs = make_inputs(1, has_reference=False, num_snapshots=2)
    contents = check(**inputs, marks=make_marks(inputs))
    assert "jerk of each joint around the frame, largest and darkest at 500 m/s³" in (
        contents.caption
    )
    axes = next(ax for ax in draw_figure6(contents).axes if ax.get_label() == "snapshots")
    for image in axes.get_images():
        assert image.get_array().min() < 60  # nothing else in these pictures is below 90


def test_a_longer_reference_is_cut_and_the_caption_says_so() -> None:
    inputs = make_inputs(1)
    inputs["trajectories"][NAMES[0]] = make_trajectory(5, 200)
    contents = check(**inputs)

    assert contents.num_frames == 200
    assert "The motions differ in length and are cut to the shortest." in contents.caption


def test_snapshot_frames_are_every_50_of_the_window() -> None:
    assert choose_snapshot_frames(1000) == (0, 50, 100, 150, 200, 250)
    assert choose_snapshot_frames(1000, start_frame=30, window_frames=101) == (30, 80, 130)
    assert choose_snapshot_frames(15) == (0,)
    assert choose_snapshot_frames(1000, window_frames=1000) == tuple(range(0, 350, 50))


# ---------------------------------------------------------------------------- legibility


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
    figure = draw_figure6(contents)
    figure.set_dpi(144)
    texts = drawn_texts(figure, monkeypatch)
    words = [text for text, _ in texts]
    for name in contents.trajectories:
        rest = "".join(words).replace(" ", "")
        assert rest.count(name.replace(" ", "")) >= (2 if contents.snapshots else 1)

    for (text_a, box_a), (text_b, box_b) in itertools.combinations(texts, 2):
        assert not overlap(box_a, box_b), f"{text_a!r} covers {text_b!r}"
    boxes = {ax.get_label(): ax.get_window_extent() for ax in figure.axes}
    panels = {label: boxes[label] for label in "xyz"}
    for ax in figure.axes:
        if ax.get_label() == "scale of marks":
            panels[f"scale at {ax.get_position().x0}"] = ax.get_window_extent()
        else:
            panels |= {image.get_label(): image.get_window_extent() for image in ax.get_images()}
    num_scales = 2 if contents.marks is not None else 0
    assert len(panels) - num_scales == 3 + len(contents.snapshots) * len(contents.snapshot_frames)
    for text, box in texts:
        assert box.x0 >= 0 and box.y0 >= 0, f"{text!r} leaves the figure"
        assert box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1, f"{text!r} leaves the figure"
        for label, panel in panels.items():
            assert not overlap(box, panel), f"{text!r} covers {label}"
    for (label_a, a), (label_b, b) in itertools.combinations(panels.items(), 2):
        assert not overlap(a, b), f"{label_a} covers {label_b}"
    path = drawn_path_box(figure)
    assert path.width > 90 and path.height > 150  # pixels of 1/144 inch
    for label, panel in panels.items():
        assert not overlap(path, panel), f"the path covers {label}"
    for text, box in texts:
        if text not in ("x", "y", "z"):
            assert not overlap(path, box), f"the path covers {text!r}"
    assert figure.get_figwidth() == FIGURE_WIDTH_IN
    assert figure.get_figheight() < 9.7  # a page of A4 with an inch on both sides


@pytest.mark.parametrize("has_reference", [False, True])
@pytest.mark.parametrize("num_systems", [1, 2, 3, 4, 5, 6])
def test_nothing_overlaps(
    settings: None, monkeypatch: pytest.MonkeyPatch, num_systems: int, has_reference: bool
) -> None:
    check_legible(check(**make_inputs(num_systems, has_reference, 7)), monkeypatch)


@pytest.mark.parametrize(("num_systems", "num_snapshots"), [(1, 1), (6, 7)])
def test_nothing_overlaps_with_marks(
    settings: None, monkeypatch: pytest.MonkeyPatch, num_systems: int, num_snapshots: int
) -> None:
    inputs = make_inputs(num_systems, True, num_snapshots)
    check_legible(check(**inputs, marks=make_marks(inputs, full_scale=20000.0)), monkeypatch)


@pytest.mark.parametrize(
    ("num_systems", "has_reference", "num_frames"), [(1, False, 1), (2, True, 15), (6, True, 15)]
)
def test_nothing_overlaps_in_a_short_clip(
    settings: None,
    monkeypatch: pytest.MonkeyPatch,
    num_systems: int,
    has_reference: bool,
    num_frames: int,
) -> None:
    check_legible(check(**make_inputs(num_systems, has_reference, 1, num_frames)), monkeypatch)


@pytest.mark.parametrize("num_snapshots", [0, 2, 4])
def test_nothing_overlaps_with_any_number_of_snapshots(
    settings: None, monkeypatch: pytest.MonkeyPatch, num_snapshots: int
) -> None:
    check_legible(check(**make_inputs(3, True, num_snapshots)), monkeypatch)


@pytest.mark.parametrize("num_snapshots", [1, 7])
def test_long_and_odd_names_stay_whole_and_apart(
    settings: None, monkeypatch: pytest.MonkeyPatch, num_snapshots: int
) -> None:
    names = (
        "globaldiff/skeleton.s2",
        "a_folder_with_a_long_name/2_scott_0_103_103_of_the_second_run_with_everything_in_it.s12",
        "$x^2$_{nothing}\\frac",
        "x" * 130,
        "éàü",
        "b",
    )
    check_legible(check(**make_inputs(6, True, num_snapshots, names=names)), monkeypatch)


@pytest.mark.parametrize("shift", [0.0, -1234.5])
def test_far_and_large_frame_numbers_do_not_overlap(
    settings: None, monkeypatch: pytest.MonkeyPatch, shift: float
) -> None:
    inputs = make_inputs(2, num_snapshots=7)
    start = 107_000
    inputs["trajectories"] = {
        name: np.concatenate([np.zeros((start, 3)), positions + shift])
        for name, positions in inputs["trajectories"].items()
    }
    inputs["snapshot_frames"] = tuple(start + frame for frame in inputs["snapshot_frames"])
    check_legible(check(**inputs, start_frame=start), monkeypatch)


def test_keys_differ_in_a_greyscale_print(tmp_path: Path) -> None:
    figure6(check(**make_inputs(6, num_snapshots=0)), tmp_path / "figure6")
    grey = np.asarray(Image.open(tmp_path / "figure6.png").convert("L")).astype(float)

    scale = 2016 / FIGURE_WIDTH_IN
    from renderer.figures.figure6.layout import plan_layout
    from renderer.figures.page import LINE, SWATCH

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


# ---------------------------------------------------------------------------- cropping


# ---------------------------------------------------------------------------- refusals


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
    ],
)
def test_refuses_with_one_sentence(
    tmp_path: Path, changes: dict[str, object], message: str
) -> None:
    with pytest.raises(FigureError, match=message):
        check(**{**make_inputs(1), **changes})


@pytest.mark.parametrize(
    ("positions", "message"),
    [
        (np.zeros((30, 2)), r"shape \(frames, 3\); got \(30, 2\)"),
        (np.zeros(30), r"got \(30,\)"),
        (np.zeros((0, 3)), "only 0 frames"),
        (np.where(np.arange(90).reshape(30, 3) == 40, np.nan, 0.0), "not a number at frame 13"),
        (np.full((30, 3), np.inf), "not a number at frame 0"),
    ],
)
def test_refuses_bad_trajectories(positions: np.ndarray, message: str) -> None:
    inputs = make_inputs(1)
    inputs["trajectories"][NAMES[0]] = positions
    with pytest.raises(FigureError, match=message):
        check(**inputs)


@pytest.mark.parametrize(
    ("pictures", "message"),
    [
        (np.zeros((6, *FRAME, 3), np.float32), "must be uint8"),
        (np.zeros((6, *FRAME, 4), np.uint8), "height, width, 3"),
        (np.zeros((6, 10, 10, 3), np.uint8), "one size"),
        (np.zeros((5, *FRAME, 3), np.uint8), "has 5 snapshots for 6 frames"),
    ],
)
def test_refuses_bad_snapshots(pictures: np.ndarray, message: str) -> None:
    inputs = make_inputs(1)
    inputs["snapshots"][NAMES[0]] = pictures
    with pytest.raises(FigureError, match=message):
        check(**inputs)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"full_scale": 0.0}, "full scale of marks must be positive; got 0"),
        ({"values": {}}, "of the same systems"),
        ({"pixels": {NAMES[0]: np.zeros((6, 2, 3))}}, r"pixels \(N, J, 2\)"),
        ({"values": {NAMES[0]: np.zeros((5, 2))}}, r"got \(6, 2, 2\) and \(5, 2\)"),
    ],
)
def test_refuses_bad_marks(changes: dict[str, object], message: str) -> None:
    inputs = make_inputs(1, has_reference=False)
    with pytest.raises(FigureError, match=message):
        check(**inputs, marks=make_marks(inputs, **changes))


def test_refuses_snapshots_of_other_systems() -> None:
    inputs = make_inputs(2)
    del inputs["snapshots"][NAMES[1]]
    with pytest.raises(FigureError, match="same systems"):
        check(**inputs)
