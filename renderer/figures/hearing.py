"""What speech and what chance decide, as a figure: a row for each system.

On the left the speed of the arms, two speeches with two noise seeds each: lines of one colour share
the speech, lines of one kind the noise. On the right the shares, by part of the body.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from conventions.rates import FPS
from renderer.figures import style
from renderer.figures.files import FigureError, FigureFiles, matplotlib_settings, write_figure
from renderer.figures.page import MARGIN, TITLE, Rect, begin_page, write_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN_S = 20.0
SPEECH_COLORS = ("#0072b2", "#d55e00")
NOISE_LINES = ("-", (0, (3, 1.5)))
BY_SPEECH, BY_NOISE = "#333333", "#b0b0b0"
_ROW, _LEFT, _SHARES, _BETWEEN, _BOTTOM, _KEYS = 1.15, 0.42, 1.9, 0.75, 0.3, 0.2
_CAPTION = (
    "Arm speed: angular speeds of both shoulders and elbows, summed, over {seconds:.0f} s. Lines "
    "of one colour share the speech, lines of one kind (solid, dashed) the noise seed. Where the "
    "system hears, lines of one colour rise and fall together; where it is deaf, lines of one "
    "kind. "
    "Shares: correlation of two motions with the same speech (or noise) and other noise (or "
    "speech), less that of two that share neither, over all speeches and seeds."
)


@dataclass(frozen=True)
class HearingRow:
    """One system."""

    name: str
    arm_speed: Mapping[tuple[str, int], Float[np.ndarray, " T"]]
    """Degrees a second by speech and seed; the first two of each are shown."""
    shares: Mapping[str, tuple[float, float]]
    """By part of the body: decided by speech, and by noise."""


def hearing_figure(rows: Sequence[HearingRow], out_stem: Path) -> FigureFiles:
    """Write ``<out_stem>.png``, ``.svg`` and ``.pdf``; each appears whole or not at all.

    Raises:
        FigureError: if there is no row.
    """
    if not rows:
        raise FigureError("There is no system to draw.")
    with matplotlib_settings():
        return write_figure(
            draw_hearing(rows), out_stem, description=_CAPTION.format(seconds=SHOWN_S)
        )


def draw_hearing(rows: Sequence[HearingRow]) -> "Figure":
    """The figure, without a canvas."""
    shown_s = min(
        SHOWN_S, max(len(speed) for row in rows for speed in row.arm_speed.values()) / FPS
    )
    row_height = TITLE + _ROW + _BOTTOM
    body_height, caption = _KEYS + len(rows) * row_height, _CAPTION.format(seconds=shown_s)
    figure, top, _ = begin_page((), None, body_height, caption)
    height = figure.get_figheight()
    wide = style.FIGURE_WIDTH_IN - 2 * MARGIN - _LEFT - _SHARES - _BETWEEN
    top += _KEYS
    highest = max(_shown(speed).max() for row in rows for speed in row.arm_speed.values())
    for number, row in enumerate(rows):
        place = Rect(MARGIN + _LEFT, top + TITLE, wide, _ROW)
        axes = figure.add_axes(place.fraction_of(height), label=f"speed {number}")
        write_title(figure, MARGIN, top + TITLE - 0.05, row.name)
        _draw_speeds(axes, row, 1.05 * highest, shown_s)
        right = Rect(place.right + _BETWEEN, place.top, _SHARES, _ROW)
        shares = figure.add_axes(right.fraction_of(height), label=f"shares {number}")
        _draw_shares(shares, row)
        if number == 0:
            _write_keys(axes, shares, row)
        if number == len(rows) - 1:
            axes.set_xlabel("seconds", size=style.LABEL_PT, labelpad=1.0)
        top += row_height
    return figure


def _draw_speeds(axes: "Axes", row: HearingRow, highest: float, shown_s: float) -> None:
    for (speech, seed), speed in row.arm_speed.items():
        speeches, seeds = _compared(row)
        if speech in speeches and seed in seeds:
            shown = _shown(speed)
            axes.plot(
                np.arange(len(shown)) / FPS,
                shown,
                linewidth=0.8,
                color=SPEECH_COLORS[speeches.index(speech)],
                linestyle=NOISE_LINES[seeds.index(seed)],
            )
    axes.set_xlim(0.0, shown_s)
    axes.set_ylim(0.0, highest)
    axes.set_ylabel("arm speed (\N{DEGREE SIGN}/s)", size=style.SMALL_PT, labelpad=2.0)
    axes.grid(axis="y")
    axes.set_axisbelow(True)


def _draw_shares(axes: "Axes", row: HearingRow) -> None:
    places = np.arange(len(row.shares))[::-1]
    for offset, which, color in ((0.19, 0, BY_SPEECH), (-0.19, 1, BY_NOISE)):
        values = [max(share[which], 0.0) for share in row.shares.values()]
        axes.barh(places + offset, values, height=0.34, color=color)
        for place, value in zip(places + offset, values, strict=True):
            axes.annotate(
                f"{value:.2f}".lstrip("0") if value < 1 else "1", (value, place),
                xytext=(2, 0), textcoords="offset points", va="center", size=style.SMALL_PT,
            )  # fmt: skip
    axes.set_yticks(places, list(row.shares), size=style.SMALL_PT)
    axes.set_xlim(0.0, 1.12)
    axes.set_xticks([0.0, 0.5, 1.0])


def _write_keys(speeds: "Axes", shares: "Axes", row: HearingRow) -> None:
    """What colours and kinds of line are, above the first row."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    speeches, seeds = _compared(row)
    keys = [
        Line2D([], [], color=SPEECH_COLORS[k], linewidth=1.2, label=_short(name))
        for k, name in enumerate(speeches)
    ]
    keys += [
        Line2D([], [], color=style.INK, linewidth=0.8, linestyle=NOISE_LINES[k], label=f"seed {n}")
        for k, n in enumerate(seeds)
    ]
    parts = [
        Patch(color=BY_SPEECH, label="decided by speech"),
        Patch(color=BY_NOISE, label="by chance"),
    ]
    for axes, handles in ((speeds, keys), (shares, parts)):
        axes.legend(
            handles=handles, loc="lower right", bbox_to_anchor=(1.0, 1.12), ncols=len(handles),
            frameon=False, fontsize=style.SMALL_PT, borderpad=0.0, handlelength=1.4,
            columnspacing=0.9, handletextpad=0.4, borderaxespad=0.0,
        )  # fmt: skip


def _compared(row: HearingRow) -> tuple[list[str], list[int]]:
    speeches = list(dict.fromkeys(speech for speech, _ in row.arm_speed))[: len(SPEECH_COLORS)]
    seeds = sorted({seed for _, seed in row.arm_speed})[: len(NOISE_LINES)]
    return speeches, seeds


def _shown(speed: Float[np.ndarray, " T"]) -> Float[np.ndarray, " n"]:
    return speed[: round(SHOWN_S * FPS)]


def _short(name: str, longest: int = 24) -> str:
    return name if len(name) <= longest else name[: longest - 1] + "\N{HORIZONTAL ELLIPSIS}"
