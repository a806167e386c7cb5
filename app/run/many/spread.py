"""The figure of how measures are spread over the clips of each set."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from app.findings.measure_rows import MEASURES
from conventions.names import REFERENCE_NAME

LEAST_CLIPS = 5
"""A spread of fewer says nothing."""


def draw_spread(
    out: Path, systems: list[str], numbers: list[dict[str, Any]]
) -> tuple[tuple[Path, ...], list[str]]:
    """Write ``distributions.png``, ``.svg`` and ``.pdf``; files and what must be said of them.

    Args:
        numbers: of each clip, as `app.run.many.table.numbers_of` in ``systems`` by name.
    """
    if len(numbers) < LEAST_CLIPS:
        return (), []
    from renderer.figures.distributions import SpreadPanel, distributions_figure
    from renderer.figures.style import SYSTEM_STYLES

    generated = [name for name in systems if name != REFERENCE_NAME]
    left_out = generated[len(SYSTEM_STYLES) :]
    shown = [name for name in systems if name not in left_out]
    panels = []
    for place, row in enumerate(MEASURES):
        values = {
            name: [
                value
                for each in numbers
                if (value := each["systems"][name]["values"][place]) is not None
            ]
            for name in shown
        }
        if row.is_first and any(values.values()):
            whose = " of the point" if row.group == "Followed point" else ""
            unit = f" ({row.unit})" if row.unit else ""
            panels.append(SpreadPanel(f"{row.title}{whose}{unit}", values))
    if not panels:
        return (), []
    files = distributions_figure(panels, out / "distributions", REFERENCE_NAME)
    if not left_out:
        return tuple(files), []
    return tuple(files), [f"distributions.png leaves out {', '.join(left_out)}: too many systems."]
