"""Figures of the report as SVG: bars as in the paper's Figure 7, pairs and strengths.

Readable without colour: bars differ in lightness and hatching, points have labels. Text is drawn as
paths, so that it looks the same everywhere.
"""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from app.study.design.key import StudyKey
from app.study.statistics.proportions import ResultEstimate
from app.study.statistics.results import QuestionResult
from conventions.names import printable

INK = "#1f2933"
FAINT = "#9aa5b1"
DARKEST, LIGHTEST = (0.34, 0.48, 0.63), (0.91, 0.94, 0.98)
MAX_PLAIN_FILLS = 5
"""Most fills that can be distinguished by lightness alone; with more, hatching is added."""
HATCHES = ("", "///", "...", "xx")
LINE_LENGTH = 14
"""Most characters per line of a question's name below its bars."""
WIDTH_IN = 5.0
ROW_IN = 0.38
LONGEST_NAME = 26
"""Most characters of a system's name in figures."""
MAX_NUMBERS = 16
"""Most bars with room for their numbers."""
KEY_LENGTH, KEY_MARK = 72, 6
"""Characters per line of the legend, and the width of a mark in characters."""
_PLATE = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none"}
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "path",
    "svg.hashsalt": "study",
    "text.parse_math": False,  # names may hold dollars
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "hatch.linewidth": 0.6,
}


def result_bars(results: Sequence[QuestionResult], key: StudyKey) -> Figure:
    """Draw one group of bars per question, one bar per system, with 95 % intervals.

    Shares in percent (of votes, of first places or of right choices), with the chance level as a
    line; mean ratings for sliders.
    """
    label, chance = {
        "right_choices": ("matching speech chosen (%)", 50.0),
        "first_places": ("ranked first (%)", 100 / len(key.systems)),
        "share_of_all_votes": ("preferred (% of votes)", 50.0),
        "mean_rating": ("mean rating", None),
    }[results[0].bar_measure]
    scale = 1 if results[0].bar_measure == "mean_rating" else 100
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(WIDTH_IN, 3.4), layout="constrained")
        axes = figure.add_subplot()
        count = len(key.systems)
        width = 0.8 / count
        for group, result in enumerate(results):
            for system, name in enumerate(key.systems):
                at = group + (system - (count - 1) / 2) * width
                if (bar := result.find_estimate(result.bar_measure, name)) is None:
                    continue
                value, low, high = (scale * each for each in bar.value_and_limits)
                axes.bar(at, value, 0.92 * width, **_fill(system, count))
                if np.isfinite(high - low):
                    reach = [[value - low], [high - value]]
                    axes.errorbar(at, value, reach, color=INK, capsize=3, lw=1.2)
                if count * len(results) <= MAX_NUMBERS:
                    axes.text(at, 2, f"{value:.0f}", ha="center", fontsize=9, bbox=_PLATE)
        if chance is not None:
            axes.axhline(chance, color=INK, lw=0.8, ls=(0, (4, 3)))
            beside = axes.get_yaxis_transform()
            axes.text(1, chance, " chance", transform=beside, va="center", fontsize=9)
        names = [textwrap.fill(printable(result.question.id), LINE_LENGTH) for result in results]
        axes.set_xticks(range(len(results)), names)
        axes.set_xlim(-0.5, len(results) - 0.5)
        axes.set_ylim(0, 108)
        axes.set_yticks(range(0, 101, 20))
        axes.set_ylabel(label)
        axes.tick_params(axis="x", length=0)
        _add_legend(figure, key)
    return figure


def _add_legend(figure: Figure, key: StudyKey) -> None:
    names = [_short(name) for name in key.systems]
    patches = [Patch(**_fill(system, len(names))) for system in range(len(names))]
    columns = max(1, KEY_LENGTH // (max(map(len, names)) + KEY_MARK))
    legend = figure.legend(
        patches, [""] * len(names), loc="outside upper center", ncols=columns, frameon=False,
        fontsize=9,
    )  # fmt: skip
    for entry, name in zip(legend.get_texts(), names, strict=True):
        entry.set_text(name)  # as arguments, names that begin with "_" would be left out


def forest_plot(estimates: Sequence[ResultEstimate]) -> Figure:
    """Draw values of one measure with intervals, one per row: pairs, or systems by rank."""
    measure, count = estimates[0].measure, len(estimates)
    label, middle, limits = {
        "share": ("votes for the first system (%; ties count as half)", 50, (0, 100)),
        "log_strength": ("log-strength (0 = mean of the systems)", 0, None),
        "mean_rank": ("mean rank (1 = best)", (count + 1) / 2, (1, count)),
        "mean_rating": ("mean rating (0 to 100)", None, (0, 100)),
    }[measure]
    scale = 1
    if measure == "share":
        scale, names = 100, [_against(str(one.first), str(one.second)) for one in estimates]
    else:
        best_first = slice(None, None, 1 if measure == "mean_rank" else -1)
        estimates = sorted(estimates, key=lambda one: one.value_and_limits[0])[best_first]
        names = [_short(str(one.first)) for one in estimates]
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(WIDTH_IN, 0.8 + ROW_IN * count), layout="constrained")
        axes = figure.add_subplot()
        if middle is not None:
            axes.axvline(middle, color=FAINT, lw=1, ls=(0, (4, 3)))
        places = np.arange(count)[::-1]
        for place, one in zip(places, estimates, strict=True):
            value, low, high = (scale * each for each in one.value_and_limits)
            if np.isfinite(high - low):
                axes.plot([low, high], [place, place], color=INK, lw=1.6)
            axes.plot(value, place, "o", color=INK, ms=5)
        axes.set_yticks(places, names)
        axes.set_ylim(-0.6, count - 0.4)
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
        if limits is not None:
            margin = 0.02 * (limits[1] - limits[0])
            axes.set_xlim(limits[0] - margin, limits[1] + margin)
        axes.locator_params(axis="x", nbins=6)
        axes.set_xlabel(label)
    return figure


def figure_to_svg(figure: Figure, id_prefix: str, description: str) -> str:
    """Return inline SVG with a text alternative; ids get a prefix, as figures share a page."""
    buffer = io.StringIO()
    with mpl.rc_context(_STYLE):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :]
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', svg))
    svg = re.sub(
        r' id="([^"]*)"', lambda m: f' id="{id_prefix}-{m[1]}"' if m[1] in used else "", svg
    )
    svg = re.sub(r'(href="#|url\(#)', rf"\g<1>{id_prefix}-", svg)
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    label = printable(description).replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    return svg.replace("<svg ", f'<svg role="img" aria-label="{label}" ', 1)


def write_pdf(figure: Figure, path: Path) -> None:
    """Write a figure as PDF for papers, with fonts as outlines."""
    with mpl.rc_context({**_STYLE, "pdf.fonttype": 42}):
        figure.savefig(path, format="pdf", metadata={"CreationDate": None})


def _fill(system: int, count: int) -> dict[str, Any]:
    """Return a bar's fill: dark to light in one hue, also distinguishable in print."""
    place = system / max(1, count - 1)
    shade = [dark + place * (light - dark) for dark, light in zip(DARKEST, LIGHTEST, strict=True)]
    hatch = HATCHES[system % len(HATCHES)] if count > MAX_PLAIN_FILLS else ""
    return {"facecolor": shade, "edgecolor": INK, "lw": 0.8, "hatch": hatch}


def _short(name: str) -> str:
    """Return start and end of a long name; tables have it whole."""
    name, half = printable(name), LONGEST_NAME // 2 - 1
    return name if len(name) <= LONGEST_NAME else f"{name[:half]}…{name[-half:]}"


def _against(first: str, second: str) -> str:
    """Format two names as "A vs B", on two lines if they are long."""
    first, second = _short(first), _short(second)
    gap = "  " if len(first) + len(second) <= LONGEST_NAME + 8 else "\n"
    return f"{first}{gap}vs  {second}"
