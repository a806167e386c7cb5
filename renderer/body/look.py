"""Looks of the open body: its builds and a colour for each painted region.

Every look has the same joints, fingertips and topology, so the motion and its metrics do not depend
on it. Colours are linear RGB (not sRGB), 0 to 1, as a shader multiplies them with light.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int

Color = tuple[float, float, float]

CLAY: Color = (0.50, 0.46, 0.43)
"""Colour of a body without colours: the tone clay, and any SMPL-X file."""

_LIGHT: dict[str, Color] = {
    "skin": (0.50, 0.385, 0.32),
    "lips": (0.40, 0.235, 0.205),
    "mouth": (0.085, 0.025, 0.025),
    "teeth": (0.40, 0.38, 0.34),
    "hair": (0.045, 0.032, 0.026),
    "brows": (0.085, 0.06, 0.048),
    "eye_white": (0.72, 0.72, 0.71),
    "iris": (0.09, 0.12, 0.15),
    "iris_rim": (0.04, 0.055, 0.07),
    "pupil": (0.01, 0.01, 0.012),
    "shirt": (0.09, 0.155, 0.26),
    "trousers": (0.07, 0.07, 0.08),
    "shoes": (0.025, 0.026, 0.03),
    "soles": (0.45, 0.45, 0.44),
}
_MEDIUM = _LIGHT | {
    "skin": (0.34, 0.215, 0.145),
    "lips": (0.265, 0.125, 0.10),
    "hair": (0.018, 0.014, 0.012),
    "brows": (0.03, 0.021, 0.017),
    "iris": (0.055, 0.03, 0.015),
    "iris_rim": (0.025, 0.014, 0.009),
    "shirt": (0.10, 0.165, 0.125),
    "trousers": (0.055, 0.06, 0.075),
}
_DARK = _MEDIUM | {
    "skin": (0.125, 0.07, 0.045),
    "lips": (0.125, 0.052, 0.045),
    "hair": (0.010, 0.009, 0.009),
    "brows": (0.012, 0.009, 0.008),
    "iris": (0.03, 0.016, 0.009),
    "shirt": (0.27, 0.18, 0.085),
    "trousers": (0.065, 0.06, 0.06),
}
REGION_NAMES: tuple[str, ...] = tuple(_LIGHT)
REGION_INDEX: dict[str, int] = {name: i for i, name in enumerate(REGION_NAMES)}


def _clay() -> dict[str, Color]:
    """Return one colour for all regions, darker for mouth and eyes, which show speech and gaze."""
    darker = {"mouth": 0.2, "iris": 0.6, "iris_rim": 0.5, "pupil": 0.3}
    red, green, blue = CLAY
    shares = {name: darker.get(name, 1.0) for name in REGION_NAMES}
    return {name: (red * s, green * s, blue * s) for name, s in shares.items()}


SKIN_TONE_COLORS: dict[str, dict[str, Color]] = {
    "light": _LIGHT,
    "medium": _MEDIUM,
    "dark": _DARK,
    "clay": _clay(),
}
"""Colour of each region by tone."""


def vertex_colors(look: str, regions: Int[np.ndarray, " V"]) -> Float32[np.ndarray, "V 3"]:
    """Return linear RGB by region index (into ``REGION_NAMES``) in one of `BODY_LOOKS`."""
    colors = SKIN_TONE_COLORS[look.partition("-")[2]]
    return np.array([colors[name] for name in REGION_NAMES], np.float32)[regions]
