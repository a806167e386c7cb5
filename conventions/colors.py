"""Colours of motions: one table for the page, figures, reports and saved files.

The colours were chosen by search: in CIELAB, any two are at least 19 apart for normal vision,
protanopia, deuteranopia and tritanopia (Machado et al. 2009), and each has a contrast of at least 2
with the page, light and dark.
"""

from __future__ import annotations

from collections.abc import Iterable

REFERENCE_COLOR = "#000000"
SYSTEM_COLORS = {
    "globaldiff/local": "#d55e00",
    "globaldiff/global": "#0072b2",
    "workbench/planned": "#00bbbb",
    "workbench/priorflow": "#990077",
    "globaldiff/joint": "#bbaa55",
    "globaldiff/skeleton": "#774444",
    "globaldiff/full": "#5533bb",
    "gan/5": "#aa1100",
    "gan/10": "#dd9988",
    "gan/20": "#777744",
    "asynfusion/lcm-async": "#cc6688",
    "asynfusion/lcm-sync": "#aa77ff",
    "asynfusion/ddim": "#99aaee",
}
"""Colour of each system, in the order in which other motions take what is left."""
_BY_LABEL = {name.rpartition("/")[2]: name for name in SYSTEM_COLORS}


def colors_of(names: Iterable[str], reference: str | None) -> dict[str, str]:
    """Return the colours of the motions of one run or figure: a system has its own in every run.

    A motion of a system may be named in full, by its label, or with an addition such as a sample's
    number. The second motion of a system and all other motions take the colours that are left.
    """
    names = [*dict.fromkeys(names)]
    colors: dict[str, str] = {}
    for name in names:
        system = _system_of(name)
        own = REFERENCE_COLOR if name == reference else SYSTEM_COLORS.get(system)
        if own is not None and own not in colors.values():
            colors[name] = own
    left = [color for color in SYSTEM_COLORS.values() if color not in colors.values()]
    others = (name for name in names if name not in colors)
    all_colors = [*SYSTEM_COLORS.values()]
    for number, name in enumerate(others):
        colors[name] = left[number] if number < len(left) else all_colors[number % len(all_colors)]
    return {name: colors[name] for name in names}


def _system_of(name: str) -> str:
    """Return the system in the name of a motion; empty if it names none."""
    for system, label in ((each, label) for label, each in _BY_LABEL.items()):
        if any(name == own or name.startswith((f"{own}.s", f"{own} ")) for own in (system, label)):
            return system
    return ""
