"""The strips under Figure 6: the tremble of each motion, all to one scale."""

from typing import TYPE_CHECKING

import numpy as np

from renderer.figures import style
from renderer.figures.figure6.layout import Layout
from renderer.figures.figure6.spec import Figure6
from renderer.figures.figure6.tremble import CUT_OFF_HZ
from renderer.figures.page import MARGIN, NAME_BREAKS, TITLE_GAP
from renderer.figures.text import write, write_title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHOWN = 99.0  # percentile of all strips that their common scale holds
_HEADROOM = 1.35  # of that; a motion's name stands there
_SMALLEST_MM = 0.1


def draw_strips(figure: "Figure", layout: Layout, contents: Figure6) -> None:
    """A strip for each motion with x, y and z, all to one scale, and their rms."""
    times = (contents.start_frame + np.arange(contents.num_frames)) / contents.fps
    margin = 0.01 * (times[-1] - times[0])
    top = layout.strips[0].top - TITLE_GAP
    letter = "d" if contents.snapshots else "c"
    write_title(
        figure, MARGIN, top,
        f"{letter}  Tremble: how far off its own path below {CUT_OFF_HZ:g} Hz, in mm",
    )  # fmt: skip
    sizes = np.abs(np.concatenate(list(contents.tremble.values())))
    reach = max(_HEADROOM * float(np.percentile(sizes, _SHOWN)), _SMALLEST_MM)
    tick = float(style.ROUND_NUMBERS[style.ROUND_NUMBERS <= 0.8 * reach][-1])
    for rect, (name, values) in zip(layout.strips, contents.tremble.items(), strict=True):
        axes = figure.add_axes(rect.fraction_of(layout.height), label=f"tremble of {name}")
        axes.plot(times, values, color=contents.styles[name].color, linewidth=0.6)
        axes.set_xlim(times[0] - margin, times[-1] + margin)
        axes.set_ylim(-reach, reach)
        axes.set_yticks((-tick, 0.0, tick), ("", f"\N{PLUS-MINUS SIGN}{tick:g}", ""))
        axes.grid(axis="y")
        is_last = rect is layout.strips[-1]
        axes.tick_params(axis="x", labelbottom=is_last)
        if is_last:
            axes.set_xlabel("time (s)", size=style.LABEL_PT, labelpad=2.0)
        rms = float(np.sqrt(np.square(values).sum(axis=1).mean()))
        size = f"{rms:.1f} mm rms"
        room = rect.width - style.text_width_in(size, style.SMALL_PT) - 0.5
        for place, side, text in (
            (rect.left + 0.05, "left", _cut(name, room)),
            (rect.right - 0.03, "right", size),
        ):
            write(
                figure, place, rect.top + 0.01, text, size=style.SMALL_PT, va="top", ha=side,
                bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.5},
            )  # fmt: skip


def _cut(name: str, width: float) -> str:
    """As much of a name as one line holds; the legend has the whole."""
    first, *rest = style.wrap_text(name, style.SMALL_PT, width, breaks_after=NAME_BREAKS)
    return f"{first}\N{HORIZONTAL ELLIPSIS}" if rest else first
