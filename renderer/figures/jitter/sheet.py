"""The second sheet beside Figure 6: where the jitter sits, drawn from ``diagnostics.json`` alone.

Jerk by depth along the kinematic chain and of every joint, the velocity spectrum of the followed
point, how much of its jerk each joint of its chain carries, and jerk folded on the windows of
generation; each as generated and behind one and the same filter, with the recorded reference in
black.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from conventions.names import REFERENCE_NAME
from renderer.figures.files import FigureFiles, matplotlib_settings, write_figure
from renderer.figures.jitter.draw import draw_sheet
from renderer.figures.jitter.series import JitterSheet, read_sheet

__all__ = ["jitter_sheet"]


def jitter_sheet(
    diagnostics: Mapping[str, Any],
    out_stem: Path,
    *,
    names: Sequence[str] | None = None,
    point: str = "",
    clip: str = "",
    sentence: str = "",
) -> FigureFiles:
    """Write ``<out_stem>.png``, ``.svg`` and ``.pdf``; each appears whole or not at all.

    Args:
        diagnostics: the content of a ``diagnostics.json``; what it lacks is told in the caption.
        out_stem: path without an extension; its folder is made.
        names: systems to show, at most six; by default the first six.
        point: the followed point, for the titles.
        clip: name of the clip, for the caption.
        sentence: what the numbers say, at the end of the caption.

    Raises:
        FigureError: what was given cannot be drawn; one sentence says why.
    """
    sheet = read_sheet(diagnostics, names, point)
    caption = _caption(sheet, clip, sentence)
    with matplotlib_settings():
        return write_figure(draw_sheet(sheet, caption), out_stem, description=caption)


def _caption(sheet: JitterSheet, clip: str, sentence: str) -> str:
    parts = [f"Jitter{f' of {clip}' if clip else ''}, left as generated, right after the filter."]
    if REFERENCE_NAME in sheet.measures:
        parts.append("Black: the recorded reference, which has no windows and so no seams.")
    measures = {
        "jerk by depth": sheet.by_depth("raw"),
        "spectrum": sheet.spectrum("raw"),
        "attribution": sheet.attribution("raw"),
    }
    if sheet.window_advance:
        measures["seams"] = sheet.by_phase("raw")
    for title, curves in measures.items():
        lacking = [name for name in sheet.measures if name not in curves]
        if lacking and curves:
            parts.append(f"No {title} of {', '.join(lacking)}: too short, or nothing moved.")
    if sheet.window_advance == 0:
        parts += [
            f"The {part} of {name} jerk anew every {frames} frames."
            for name, (frames, part) in sheet.periods.items()
        ]
        without = [name for name in sheet.measures if name not in sheet.periods]
        if without:
            parts.append(f"No period of 2 to 240 frames in {', '.join(without)}.")
    return " ".join([*parts, sentence]).strip()
