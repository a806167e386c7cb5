"""How the figures look: colours, line styles, type sizes and the measuring of text.

Colours are Okabe and Ito's palette without its yellow, which vanishes on white. No series is told
apart by colour alone: each also has a dash pattern and a marker of its own, so that a greyscale
print and a colour-blind reader lose nothing. Gaps between dashes hold a tint of the colour: a curve
with holes would look rougher than it is. Importing this module does not import matplotlib.
"""

from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

FIGURE_WIDTH_IN = 7.0  # text width of a two-column page: the figure goes in at scale 1
PNG_DPI = 288  # 2016 pixels wide
VECTOR_DPI = 300  # of the snapshots inside the SVG and the PDF

TITLE_PT = 7.5
LABEL_PT = 7.0
SMALL_PT = 6.0
MARKER_PT = 3.0

INK = "#1a1a1a"
FAINT_INK = "#555555"
GRID_INK = "#dcdcdc"
PANE_INK = "#f8f8f8"
SNAPSHOT_INK = "#b8b8b8"

ROUND_NUMBERS = np.outer(10.0 ** np.arange(-9, 10), [1.0, 2.0, 5.0]).ravel()
"""Steps that ticks and grids may have, increasing."""

RC_PARAMS: dict[str, object] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same letters on every machine
    "font.size": LABEL_PT,
    "text.parse_math": False,  # a name may hold a dollar sign
    "text.color": INK,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.5,
    "axes.formatter.useoffset": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": SMALL_PT,
    "ytick.labelsize": SMALL_PT,
    "xtick.major.width": 0.5,
    "ytick.major.width": 0.5,
    "xtick.major.size": 2.0,
    "ytick.major.size": 2.0,
    "xtick.major.pad": 2.0,
    "ytick.major.pad": 2.0,
    "grid.color": GRID_INK,
    "grid.linewidth": 0.4,
    "axes3d.xaxis.panecolor": PANE_INK,
    "axes3d.yaxis.panecolor": PANE_INK,
    "axes3d.zaxis.panecolor": PANE_INK,
    "image.composite_image": False,  # each snapshot stays a picture of its own
    "pdf.fonttype": 42,  # whole TrueType outlines; many journals refuse Type 3
    "ps.fonttype": 42,
    "svg.fonttype": "path",  # outlines: nobody needs the font, so nothing moves or overlaps
    "svg.hashsalt": "co-speech motion figure",
}


@dataclass(frozen=True)
class SeriesStyle:
    """How one system's curve is drawn."""

    color: str
    dashes: tuple[float, ...]
    """On and off lengths in line widths; empty means solid."""
    marker: str
    width_pt: float

    @property
    def gap_color(self) -> tuple[float, float, float]:
        """The colour, halfway to white."""
        red, green, blue = (int(self.color[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
        return (0.5 + 0.5 * red, 0.5 + 0.5 * green, 0.5 + 0.5 * blue)

    @property
    def line_properties(self) -> dict[str, Any]:
        """Keyword arguments of matplotlib's ``Line2D``."""
        return {
            "color": self.color,
            "linestyle": (0.0, self.dashes) if self.dashes else "-",
            "linewidth": self.width_pt,
            "gapcolor": self.gap_color if self.dashes else None,
            "dash_capstyle": "butt",
            "solid_joinstyle": "round",
            "marker": self.marker,
            "markersize": MARKER_PT,
            "markerfacecolor": "white",
            "markeredgewidth": 0.7,
        }


REFERENCE_STYLE = SeriesStyle("#000000", (), "o", 1.3)
SYSTEM_STYLES = (  # the first few differ most in lightness
    SeriesStyle("#D55E00", (9.0, 1.5), "s", 0.9),
    SeriesStyle("#56B4E9", (3.0, 1.5), "^", 0.9),
    SeriesStyle("#0072B2", (6.0, 1.5, 1.5, 1.5), "D", 0.9),
    SeriesStyle("#E69F00", (1.3, 1.3), "v", 0.9),
    SeriesStyle("#009E73", (4.0, 1.3, 1.3, 1.3, 1.3, 1.3), "P", 0.9),
    SeriesStyle("#CC79A7", (9.0, 1.5, 3.0, 1.5), "X", 0.9),
)
MAX_SYSTEMS = len(SYSTEM_STYLES)


def styles_of(names: Iterable[str], reference: str | None) -> dict[str, SeriesStyle]:
    """Name to style: the reference black, the systems by their order."""
    systems = iter(SYSTEM_STYLES)
    return {name: REFERENCE_STYLE if name == reference else next(systems) for name in names}


def text_width_in(text: str, size_pt: float) -> float:
    """Width of one line of the figures' type, in inches."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextToPath

    font = FontProperties(family=str(RC_PARAMS["font.family"]), size=size_pt)
    width_pt, _, _ = TextToPath().get_text_width_height_descent(text, font, ismath=False)
    return float(width_pt) / 72.0


def wrap_text(text: str, size_pt: float, width_in: float, breaks_after: str = " ") -> list[str]:
    """The text on as many lines as fit the width; nothing of it is left out.

    A line ends after one of ``breaks_after`` where it can, else in the middle of a word.
    """
    lines: list[str] = []
    rest = text
    while rest:
        too_long = bisect_right(
            range(len(rest) + 1),
            width_in,
            key=lambda count, line=rest: text_width_in(line[:count].rstrip(), size_pt),
        )
        fits = max(1, too_long - 1)
        if fits < len(rest):
            last_break = max(rest.rfind(character, 0, fits) for character in breaks_after)
            fits = last_break + 1 if last_break > 0 else fits
        lines.append(rest[:fits].strip())
        rest = rest[fits:].lstrip()
    return lines or [""]
