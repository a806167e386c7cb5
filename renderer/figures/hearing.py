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

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN_S = 20.0
SPEECH_COLORS = ("#0072b2", "#d55e00")
NOISE_LINES = ("-", (0, (3, 1.5)))
BY_SPEECH, BY_NOISE = "#333333", "#b0b0b0"
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
    """Write the figure with its caption.

    Raises:
        FigureError: if there is no row.
    """
    if not rows:
        raise FigureError("There is no system to draw.")
    caption = _CAPTION.format(seconds=_shown_s(rows))
    with matplotlib_settings():
        return write_figure(draw_hearing(rows), out_stem, caption)


def draw_hearing(rows: Sequence[HearingRow]) -> "Figure":
    """The figure, without a canvas."""
    figure = style.new_figure(style.PAGE_MM, min(10.0 + 38.0 * len(rows), style.MAX_HEIGHT_MM))
    highest = max(_shown(speed).max() for row in rows for speed in row.arm_speed.values())
    pairs = figure.subplots(len(rows), 2, squeeze=False, width_ratios=(2.0, 1.0))
    for number, (row, (speeds, shares)) in enumerate(zip(rows, pairs, strict=True)):
        speeds.set_label(f"speed {number}")
        shares.set_label(f"shares {number}")
        title = style.cut_text(row.name, style.TITLE_PT, 75.0)
        speeds.set_title(title, size=style.TITLE_PT, weight="bold")
        _draw_speeds(speeds, row, 1.05 * highest, _shown_s(rows))
        _draw_shares(shares, row)
    pairs[-1][0].set_xlabel("time (s)")
    pairs[-1][1].set_xlabel("share")
    _write_keys(figure, rows[0])
    return figure


def _shown_s(rows: Sequence[HearingRow]) -> float:
    longest = max(len(speed) for row in rows for speed in row.arm_speed.values())
    return min(SHOWN_S, longest / FPS)


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
    axes.set_ylabel("arm speed (\N{DEGREE SIGN}/s)")
    axes.grid(True, axis="y")


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


def _write_keys(figure: "Figure", row: HearingRow) -> None:
    """What colours and kinds of line are, above the first row."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    speeches, seeds = _compared(row)
    handles: list[Artist] = [
        Line2D([], [], color=SPEECH_COLORS[k], label=style.cut_text(name, style.LABEL_PT, 30.0))
        for k, name in enumerate(speeches)
    ]
    handles += [
        Line2D([], [], color=style.INK, linewidth=0.8, linestyle=NOISE_LINES[k], label=f"seed {n}")
        for k, n in enumerate(seeds)
    ]
    handles += [
        Patch(color=BY_SPEECH, label="decided by speech"),
        Patch(color=BY_NOISE, label="by chance"),
    ]
    figure.legend(handles=handles, loc="outside upper left", ncols=len(handles), handlelength=1.4)


def _compared(row: HearingRow) -> tuple[list[str], list[int]]:
    speeches = list(dict.fromkeys(speech for speech, _ in row.arm_speed))[: len(SPEECH_COLORS)]
    seeds = sorted({seed for _, seed in row.arm_speed})[: len(NOISE_LINES)]
    return speeches, seeds


def _shown(speed: Float[np.ndarray, " T"]) -> Float[np.ndarray, " n"]:
    return speed[: round(SHOWN_S * FPS)]
