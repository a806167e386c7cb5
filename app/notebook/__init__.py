"""The program from Python: speech and motion as arrays in, motion, plans and numbers out, bodies
that play in a notebook's cell. It may import the page's player; nothing of the program imports it.

``docs/notebook.ipynb`` walks through it. Everything is imported at its first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from app.notebook.comparing import Comparison, compare
    from app.notebook.inputs import read_motion, read_speech
    from app.notebook.measuring import diagnose, find_plan
    from app.notebook.performing import Performance, generate, plan
    from app.notebook.rendering import render
    from app.notebook.showing import Player, show

__all__ = [
    "Comparison",
    "Performance",
    "Player",
    "compare",
    "diagnose",
    "find_plan",
    "generate",
    "plan",
    "read_motion",
    "read_speech",
    "render",
    "show",
    "systems",
]
_ROOMS = {
    "comparing": ("Comparison", "compare"),
    "inputs": ("read_motion", "read_speech"),
    "measuring": ("diagnose", "find_plan"),
    "performing": ("Performance", "generate", "plan"),
    "rendering": ("render",),
    "showing": ("Player", "show"),
}


def systems() -> dict[str, str]:
    """The bundled systems by name, with a sentence on each."""
    from app.config import BUNDLED_WEIGHTS
    from model.systems.registry import family_of, list_systems

    return {name: family_of(name).about[name] for name in list_systems(BUNDLED_WEIGHTS)}


def __getattr__(name: str) -> Any:
    for room, names in _ROOMS.items():
        if name in names:
            return getattr(import_module(f"app.notebook.{room}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
