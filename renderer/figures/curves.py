"""Figures of one kind of panel, drawn from data frames.

Distributions of metrics over clips, quality against generation time, rotation error along the
kinematic chain, and the shares of motion that speech and noise decide.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from conventions.rates import FPS
from renderer.figures import style
from renderer.figures.errors import FigureError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame

AXIS_PERCENTILE = 99.0
"""Percentile of a panel's values at which its x axis ends, so that one outlier does not set it."""
_COLUMNS = 3
DISTRIBUTIONS_CAPTION = (
    "Each curve shows the share of clips at or below a value; a curve further to the right means "
    f"larger values. Each x axis ends at the {AXIS_PERCENTILE:g}th percentile of the panel's "
    "values; a curve that does not reach 1 has clips with values beyond the axis. The motion is "
    "unfiltered."
)


def draw_cumulative_distributions(
    values: "DataFrame", systems: Sequence[str], reference: str | None = None
) -> "Figure":
    """Draw the cumulative distribution of each metric: the share of clips at or below a value.

    Args:
        values: one row per clip and measure: ``measure`` with its unit, ``system``, ``value``.
        reference: name of the recorded motion, drawn in black.

    Raises:
        FigureError: if there is nothing to draw, a value that is not finite, or too many systems.
    """
    if values.empty:
        raise FigureError("There are no values to draw.")
    count = len([name for name in systems if name != reference])
    if count > style.MAX_SYSTEMS:
        raise FigureError(
            f"The figure can show at most {style.MAX_SYSTEMS} systems besides the reference; "
            f"got {count}."
        )
    wrong = values[~np.isfinite(values["value"])]
    if not wrong.empty:
        first = wrong.iloc[0]
        raise FigureError(f"{first['measure']} of {first['system']} is not a finite number.")
    styles = style.series_styles(systems, reference)
    panels = list(values.groupby("measure", sort=False))
    num_rows = -(-len(panels) // _COLUMNS)
    figure = style.new_figure(style.PAGE_MM, 10.0 + 42.0 * num_rows)
    style.draw_legend(figure, styles)
    grid = figure.subplots(num_rows, _COLUMNS, sharey=True, squeeze=False).ravel()
    for number, ((title, panel), axes) in enumerate(zip(panels, grid, strict=False)):
        axes.set_label(title)
        axes.set_title(title, size=style.TITLE_PT, weight="bold")
        for name, series in styles.items():
            own = np.sort(panel.loc[panel["system"] == name, "value"].astype(float))
            if len(own):  # from 0 at the least value up to 1 at the greatest
                x, y = np.r_[own[0], own], np.arange(len(own) + 1) / len(own)
                looks = series.line_properties | {"marker": ""}
                axes.plot(x, y, label=name, drawstyle="steps-post", **looks)
        low, high = panel["value"].min(), panel["value"].quantile(AXIS_PERCENTILE / 100)
        room = 0.04 * (high - low) or 0.04 * abs(high) or 1.0
        axes.set_xlim(low - room, high + room)
        axes.grid(True, axis="y")
        axes.locator_params(axis="x", nbins=4)
        if number % _COLUMNS == 0:
            axes.set_ylabel("share of clips")
    grid[0].set_ylim(0.0, 1.02)
    grid[0].set_yticks([0.0, 0.5, 1.0])
    for axes in grid[len(panels) :]:
        axes.remove()
    return figure


STEP_PANELS = {
    "tip_jerk_m_s3": "a  Fingertip jerk (m/s\N{SUPERSCRIPT THREE})",
    "distance_cm": "b  Distance from the result with the most steps (cm)",
}
REAL_TIME_MS = 1000.0 / FPS
STEP_SWEEP_CAPTION = (
    "Each mark is one motion for the same speech; the number next to it is the number of sampling "
    "steps. Time is measured on this machine for one motion at a time, without the computation of "
    "speech features. Stochastic samplers (GAN and few-step consistency) draw new noise at every "
    "step, so their result changes with the number of steps in any case. One clip and one noise "
    "seed."
)


def draw_speed_quality_tradeoff(points: "DataFrame") -> "Figure":
    """Draw quality against time: one curve per system, one mark per number of steps.

    The points have the columns ``system``, ``steps``, ``ms_per_frame`` and those of `STEP_PANELS`;
    the rows of one system are sorted by steps. Raises FigureError if there is no point, or a point
    has a number that cannot be drawn.
    """
    from matplotlib.ticker import LogLocator

    if points.empty:
        raise FigureError("There are no points to draw.")
    is_good = np.isfinite(points[["ms_per_frame", *STEP_PANELS]]).all(axis=1)
    for _, point in points[~is_good | (points["ms_per_frame"] <= 0)].iterrows():
        raise FigureError(
            f"{point['system']} with {point['steps']} sampling steps cannot be drawn: its time per "
            "frame, jerk and distance must be finite numbers, and the time greater than 0."
        )
    styles = style.series_styles(points["system"].unique(), None)
    figure = style.new_figure(style.PAGE_MM, 75.0)
    style.draw_legend(figure, styles)
    times = points["ms_per_frame"]
    for axes, (quantity, title) in zip(figure.subplots(1, 2), STEP_PANELS.items(), strict=True):
        axes.set_label(quantity)
        axes.set_title(title, size=style.TITLE_PT, weight="bold")
        for name, series in styles.items():
            own = points[points["system"] == name]
            axes.plot(own["ms_per_frame"], own[quantity], label=name, **series.line_properties)
            for steps, x, y in zip(own["steps"], own["ms_per_frame"], own[quantity], strict=True):
                axes.annotate(
                    str(steps), (x, y), xytext=(2.5, 2.5), textcoords="offset points",
                    size=style.SMALL_PT, color=series.color,
                )  # fmt: skip
        axes.set_xscale("log")
        axes.set_xlim(times.min() / 1.3, times.max() * 1.5)
        style.set_y_from_zero_with_grid(axes, points[quantity])
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.minorticks_off()
        axes.set_xlabel("generation time (ms per frame)")
        if axes.get_xlim()[1] > REAL_TIME_MS:
            axes.axvline(REAL_TIME_MS, color=style.FAINT_INK, linewidth=0.5)
            axes.annotate(
                "real time", (REAL_TIME_MS, 1.0), xycoords=("data", "axes fraction"), va="top",
                ha="right", size=style.SMALL_PT, rotation=90, color=style.FAINT_INK,
            )  # fmt: skip
    return figure


def draw_noise_shift_along_chain(rms_shifts: "DataFrame") -> "Figure":
    """Draw the shift of points along the kinematic chain under noise on local and global rotations.

    The shifts are in metres, one row per ``point``: ``local`` and ``global`` are measured (marks),
    ``predicted_local`` and ``predicted_global`` are the closed form (lines).
    """
    figure = style.new_figure(style.COLUMN_MM, 70.0)
    axes = figure.subplots()
    for form, series in style.series_styles(("local", "global"), None).items():
        looks = series.line_properties
        line: dict[str, Any] = looks | {"marker": ""}
        marks: dict[str, Any] = looks | {"linestyle": "none"}
        axes.plot(
            100.0 * rms_shifts[f"predicted_{form}"].to_numpy(),
            label=f"{form} noise, predicted",
            **line,
        )
        axes.plot(100.0 * rms_shifts[form].to_numpy(), label=f"{form} noise, measured", **marks)
    style.set_y_from_zero_with_grid(
        axes, *(np.asarray(line.get_ydata()) for line in axes.get_lines())
    )
    style.set_x_tick_names(axes, [style.short_joint_name(point) for point in rms_shifts["point"]])
    axes.set_ylabel("root mean square shift (cm)")
    figure.legend(loc="outside upper left", ncols=2, fontsize=style.SMALL_PT)
    return figure


PLOTTED_S = 20.0
SPEECH_COLORS = ("#0072b2", "#d55e00")
NOISE_LINES = ("-", (0, (3, 1.5)))
BY_SPEECH, BY_NOISE = "#333333", "#b0b0b0"
SPEECH_EFFECT_CAPTION = (
    "Left: arm speed, which is the sum of the angular speeds of both shoulders and elbows, in the "
    f"first {PLOTTED_S:.0f} s. Lines of one colour have the same speech; lines of one style (solid "
    "or dashed) have the same noise seed. If the motion follows the speech, lines of one colour "
    "rise and fall together; if it follows the noise, lines of one style do. Right: the effect of "
    "the speech is the correlation of two motions with the same speech and different noise, minus "
    "the correlation of two motions with different speech and different noise; the effect of the "
    "noise seed is computed likewise from motions with the same noise and different speech. Both "
    "are computed over all speech recordings and seeds."
)


@dataclass(frozen=True)
class SpeechEffectRow:
    """Arm speed and shares of one system, for one row of `draw_speech_effect`."""

    name: str
    arm_speed_deg_s: Mapping[tuple[str, int], Float[np.ndarray, " T"]]
    """Sum of the angular speeds of shoulders and elbows (T,), by speech and noise seed; the first
    two of each are drawn."""
    speech_and_noise_shares: Mapping[str, tuple[float, float]]
    """Effects of speech and of noise by part of the body, each a difference of correlations."""

    @property
    def drawn_speeches_and_seeds(self) -> tuple[list[str], list[int]]:
        """Names of the speeches and noise seeds that are drawn."""
        speeches = list(dict.fromkeys(speech for speech, _ in self.arm_speed_deg_s))
        seeds = sorted({seed for _, seed in self.arm_speed_deg_s})
        return speeches[: len(SPEECH_COLORS)], seeds[: len(NOISE_LINES)]


def draw_speech_effect(rows: Sequence[SpeechEffectRow]) -> "Figure":
    """Draw what speech and what noise decide, one row per system.

    On the left the arm speed for two speeches with two noise seeds each, on the right the shares by
    part of the body.
    """
    figure = style.new_figure(style.PAGE_MM, min(10.0 + 38.0 * len(rows), style.MAX_HEIGHT_MM))
    cut = round(PLOTTED_S * FPS)
    longest = max(len(speed) for row in rows for speed in row.arm_speed_deg_s.values())
    highest = max(speed[:cut].max() for row in rows for speed in row.arm_speed_deg_s.values())
    pairs = figure.subplots(len(rows), 2, squeeze=False, width_ratios=(2.0, 1.0))
    for number, (row, (speeds, shares)) in enumerate(zip(rows, pairs, strict=True)):
        speeds.set_label(f"speed {number}")
        shares.set_label(f"shares {number}")
        title = style.truncate_text(row.name, style.TITLE_PT, 75.0)
        speeds.set_title(title, size=style.TITLE_PT, weight="bold")
        speeches, seeds = row.drawn_speeches_and_seeds
        for (speech, seed), speed in row.arm_speed_deg_s.items():
            if speech in speeches and seed in seeds:
                color, line = SPEECH_COLORS[speeches.index(speech)], NOISE_LINES[seeds.index(seed)]
                times = np.arange(len(speed[:cut])) / FPS
                speeds.plot(times, speed[:cut], linewidth=0.8, color=color, linestyle=line)
        speeds.set_xlim(0.0, min(cut, longest) / FPS)
        speeds.set_ylim(0.0, 1.05 * highest)
        speeds.set_ylabel("arm speed (\N{DEGREE SIGN}/s)")
        speeds.grid(True, axis="y")
        _draw_shares(shares, row)
    pairs[-1][0].set_xlabel("time (s)")
    pairs[-1][1].set_xlabel("difference in correlation")
    _write_keys(figure, rows[0])
    return figure


def _draw_shares(axes: "Axes", row: SpeechEffectRow) -> None:
    places = np.arange(len(row.speech_and_noise_shares))[::-1]
    for offset, which, color in ((0.19, 0, BY_SPEECH), (-0.19, 1, BY_NOISE)):
        values = [max(share[which], 0.0) for share in row.speech_and_noise_shares.values()]
        axes.barh(places + offset, values, height=0.34, color=color)
        for place, value in zip(places + offset, values, strict=True):
            axes.annotate(
                f"{value:.2f}".lstrip("0") if value < 1 else "1", (value, place),
                xytext=(2, 0), textcoords="offset points", va="center", size=style.SMALL_PT,
            )  # fmt: skip
    axes.set_yticks(places, list(row.speech_and_noise_shares), size=style.SMALL_PT)
    axes.set_xlim(0.0, 1.12)
    axes.set_xticks([0.0, 0.5, 1.0])


def _write_keys(figure: "Figure", row: SpeechEffectRow) -> None:
    """Write the legend of colours and line styles above the first row."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    speeches, seeds = row.drawn_speeches_and_seeds
    handles: list[Any] = [
        Line2D([], [], color=color, label=style.truncate_text(name, style.LABEL_PT, 30.0))
        for color, name in zip(SPEECH_COLORS, speeches, strict=False)
    ]
    handles += [
        Line2D([], [], color=style.INK, linewidth=0.8, linestyle=line, label=f"seed {seed}")
        for line, seed in zip(NOISE_LINES, seeds, strict=False)
    ]
    handles += [Patch(color=BY_SPEECH, label="due to speech")]
    handles += [Patch(color=BY_NOISE, label="due to noise seed")]
    figure.legend(handles=handles, loc="outside upper left", ncols=len(handles), handlelength=1.4)
