"""Style and output of all figures: sizes, fonts, colours, legends, and PNG, SVG and PDF files.

Colours are those of `conventions.colors`; each comes with a marker. Lines are never dashed: a curve
with holes hides how jagged it is.

matplotlib is imported at the first figure, and without pyplot: no windows, no global list of
figures. Figures are made one at a time, because matplotlib's settings belong to the process. The
same input gives the same bytes: no dates, a fixed salt for the names inside the SVG.
"""

import gc
import math
import os
import threading
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from conventions.colors import REFERENCE_COLOR, SYSTEM_COLORS, colors_of
from conventions.names import printable
from renderer.figures.grid_layout import lay_out

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

MM = 1.0 / 25.4
PAGE_MM, COLUMN_MM = 174.0, 85.0
"""Widths of a page and of a column in journals (mm), at scale 1."""
MAX_HEIGHT_MM = 235.0
DPI = 300  # resolution of PNG, and of pictures inside SVG and PDF
FIGURE_FORMATS = ("png", "svg", "pdf")
"""File formats of a figure."""
FONTS = Path(__file__).parents[1] / "assets" / "fonts"
CONTENTS_SUFFIX = ".figure.npz"
"""Suffix of files from which other formats are drawn, see `renderer.figures.saved_figures`."""
SIMPLIFIED_PX = 0.05
"""Largest distance (PNG pixels) between a dense line and its simplification in SVG and PDF."""
_PNG_COMPRESSION = 3  # zlib level; 6 takes twice as long for files 5 % smaller

TITLE_PT, LABEL_PT, SMALL_PT = 7.5, 7.0, 6.0
MARKER_PT = 3.0

INK = "#1a1a1a"
FAINT_INK = "#555555"
GRID_INK = "#dcdcdc"
SNAPSHOT_INK = "#c8c8c8"

RC_PARAMS: dict[str, object] = {
    "font.family": ["Inter", "DejaVu Sans"],  # shipped: the same letters on every machine
    "font.size": LABEL_PT,
    "text.parse_math": False,  # a name may hold a dollar sign
    "text.color": INK,
    "axes.axisbelow": True,
    "axes.edgecolor": INK,
    "axes.formatter.useoffset": False,
    "axes.labelcolor": INK,
    "axes.labelpad": 1.5,
    "axes.labelsize": LABEL_PT,
    "axes.linewidth": 0.5,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlepad": 3.0,
    "axes.titlesize": LABEL_PT,
    "grid.color": GRID_INK,
    "grid.linewidth": 0.4,
    "image.composite_image": False,  # each row of snapshots stays a separate picture
    "legend.borderaxespad": 0.4,
    "legend.borderpad": 0.0,
    "legend.columnspacing": 1.6,
    "legend.fontsize": LABEL_PT,
    "legend.frameon": False,
    "legend.handletextpad": 0.5,
    "legend.labelspacing": 0.3,
    # In points, the unit of SVG and PDF; matplotlib strays up to twice as far.
    "path.simplify_threshold": SIMPLIFIED_PX / 2.0 * 72.0 / DPI,
    "pdf.fonttype": 42,  # text stays text; many journals refuse Type 3
    "ps.fonttype": 42,
    "svg.fonttype": "path",  # outlines: no font is needed, so nothing moves or overlaps
    "svg.hashsalt": "co-speech motion figure",
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": SMALL_PT,
    "ytick.labelsize": SMALL_PT,
    "xtick.major.pad": 2.0,
    "ytick.major.pad": 2.0,
    "xtick.major.size": 2.0,
    "ytick.major.size": 2.0,
    "xtick.major.width": 0.5,
    "ytick.major.width": 0.5,
}


@dataclass(frozen=True)
class SeriesStyle:
    """Colour, marker and line width of one system's curve."""

    color: str
    marker: str
    width_pt: float

    @property
    def line_properties(self) -> dict[str, Any]:
        """Keyword arguments of matplotlib's ``Line2D``."""
        return {
            "color": self.color,
            "linewidth": self.width_pt,
            "solid_joinstyle": "round",
            "marker": self.marker,
            "markersize": MARKER_PT,
            "markerfacecolor": "white",
            "markeredgewidth": 0.7,
        }


MARKERS = dict(zip((REFERENCE_COLOR, *SYSTEM_COLORS.values()), "os^DvPX<>ph*d8", strict=True))
"""Marker of each colour."""
MAX_SYSTEMS = 6
"""Maximum number of systems in one figure."""


def series_styles(names: Iterable[str], reference: str | None) -> dict[str, SeriesStyle]:
    """Return a style per name: the reference black and thicker, each system in its own colour."""
    return {
        name: SeriesStyle(color, MARKERS[color], 1.1 if name == reference else 0.8)
        for name, color in colors_of(names, reference).items()
    }


def shades(color: str) -> list[str]:
    """Return a colour in three lightnesses, dark, middle and light, alike for all colours."""
    from matplotlib.colors import to_hex, to_rgb

    rgb = np.array(to_rgb(color))
    luma = float(rgb @ [0.299, 0.587, 0.114])
    scaled = [
        rgb * target / luma if luma > target else 1 - (1 - rgb) * (1 - target) / (1 - luma)
        for target in (0.12, 0.42, 0.68)
    ]
    return [to_hex(tuple(each)) for each in scaled]


def new_figure(width_mm: float, height_mm: float) -> "Figure":
    """Make a white figure, whose parts `save_figure` places; call it under its settings."""
    from matplotlib.figure import Figure

    return Figure((width_mm * MM, height_mm * MM), facecolor="white")


def draw_legend(figure: "Figure | SubFigure", styles: Mapping[str, SeriesStyle]) -> None:
    """Draw a legend of line samples with whole names above all parts."""
    from matplotlib.lines import Line2D

    width_mm = figure.bbox.width / figure.get_figure(root=True).dpi / MM
    handles = []
    for name, series in styles.items():
        label = "\n".join(wrap_text(name, LABEL_PT, width_mm - 17.0))
        handles.append(Line2D([], [], label=label, **series.line_properties))
    lines = [line for each in handles for line in str(each.get_label()).split("\n")]
    column_mm = max((text_width_mm(line, LABEL_PT) for line in lines), default=0.0) + 12.0
    columns = max(1, min(len(handles), int((width_mm - 2.0) / column_mm)))
    if handles:
        figure.legend(handles=handles, loc="outside upper left", ncols=columns)


def write_title(part: "SubFigure", text: str) -> None:
    """Write the bold title of a part at its left."""
    part.suptitle(text, x=0.0, ha="left", size=TITLE_PT, weight="bold")


def text_width_mm(text: str, size_pt: float) -> float:
    """Return the width of one line in the figures' font (mm)."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextToPath

    _add_fonts()
    font = FontProperties(family=cast(list[str], RC_PARAMS["font.family"]), size=size_pt)
    width_pt, _, _ = TextToPath().get_text_width_height_descent(text, font, ismath=False)
    return float(width_pt) / 72.0 / MM


def wrap_text(text: str, size_pt: float, width_mm: float) -> list[str]:
    """Wrap text to a width, without leaving anything out; words break only where they must."""
    lines: list[str] = []
    rest = text
    while rest:
        too_long = bisect_right(
            range(len(rest) + 1),
            width_mm,
            key=lambda count, line=rest: text_width_mm(line[:count].rstrip(), size_pt),
        )
        fits = max(1, too_long - 1)
        if fits < len(rest):
            last_break = max(rest.rfind(character, 0, fits) for character in "/-_. ")
            fits = last_break + 1 if last_break > 0 else fits
        lines.append(rest[:fits].strip())
        rest = rest[fits:].lstrip()
    return lines or [""]


def round_down_to_1_2_5(value: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is at most a positive value."""
    power = 10.0 ** math.floor(math.log10(value))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= value)


def truncate_text(text: str, size_pt: float, width_mm: float) -> str:
    """Return as much of a name as fits in one line, with an ellipsis; the legend has it whole."""
    first, *rest = wrap_text(text, size_pt, width_mm)
    return f"{first}\N{HORIZONTAL ELLIPSIS}" if rest else first


def short_joint_name(joint_name: str) -> str:
    """Return a short name of a joint, for example 'L middle 2' for ``left_middle2``."""
    words = joint_name.replace("left_", "L ").replace("right_", "R ").replace("_", " ")
    return f"{words[:-1]} {words[-1]}" if words[-1:].isdigit() else words


def set_y_from_zero_with_grid(axes: "Axes", *values: Any) -> None:
    """Set a linear y axis from zero to a little above the highest value, with a grid."""
    numbers = np.concatenate([np.asarray(each, float).ravel() for each in values or [[]]])
    highest = float(numbers[np.isfinite(numbers)].max(initial=0.0))
    axes.set_ylim(0.0, 1.08 * highest or 1.0)
    axes.grid(True, axis="y")


def set_x_tick_names(axes: "Axes", names: Sequence[str], size_pt: float = SMALL_PT) -> None:
    """Set vertical tick labels, one per position along x."""
    axes.set_xticks(range(len(names)), names, rotation=90, size=size_pt)
    axes.set_xlim(-0.6, max(len(names), 1) - 0.4)


_MATPLOTLIB_LOCK = threading.RLock()


@cache
def _add_fonts() -> None:
    """Make the shipped fonts known to matplotlib."""
    from matplotlib.font_manager import fontManager

    for path in sorted(FONTS.glob("*.ttf")):
        fontManager.addfont(path)


@contextmanager
def matplotlib_settings() -> Iterator[None]:
    """Use matplotlib's defaults with the figures' settings, in one thread at a time."""
    from matplotlib import style

    _add_fonts()
    with _MATPLOTLIB_LOCK, style.context(["default", RC_PARAMS]):
        yield


def save_figure(
    draw: "Callable[[], Figure]",
    out_stem: Path,
    caption: str,
    file_formats: Sequence[str] = FIGURE_FORMATS,
) -> tuple[Path, ...]:
    """Draw a figure once and write its image files and its caption; return the paths, caption last.

    The files are ``<out_stem>.png``, ``.svg`` and ``.pdf``, or some of these formats, without
    dates, and ``.txt``. The folder is made if needed. Either all files are written or none.
    """
    caption, out_stem = printable(caption), Path(out_stem)
    out_stem.parent.mkdir(parents=True, exist_ok=True)
    metadata: dict[str, dict[str, Any]] = {
        "png": {"Description": caption},
        "svg": {"Date": None, "Description": caption},
        "pdf": {"CreationDate": None, "Subject": caption},
    }
    files = [out_stem.with_name(f"{out_stem.name}.{ending}") for ending in (*file_formats, "txt")]
    with (
        matplotlib_settings(),
        _without_collection(),
        TemporaryDirectory(dir=out_stem.parent, prefix=".figure-") as folder,
    ):
        figure = draw()
        figure.set_dpi(DPI)
        _make_printable(figure)
        lay_out(figure)
        for form in file_formats:
            how: Any = {"pil_kwargs": {"compress_level": _PNG_COMPRESSION}} if form == "png" else {}
            path = Path(folder, f"figure.{form}")
            figure.savefig(path, format=form, dpi=DPI, metadata=metadata[form], **how)
        Path(folder, "figure.txt").write_text(f"{caption}\n", "utf-8")
        for path in files:
            os.replace(Path(folder, f"figure{path.suffix}"), path)
    return tuple(files)


@contextmanager
def _without_collection() -> Iterator[None]:
    """Disable the garbage collector while a figure is drawn, where it took a fifth of the time."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def _make_printable(figure: "Figure") -> None:
    """Replace characters in texts that would break the SVG or reverse the text around them."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        assert isinstance(text, Text)
        harmless = "\n".join(map(printable, text.get_text().split("\n")))
        if harmless != text.get_text():  # setting a text measures it again
            text.set_text(harmless)
