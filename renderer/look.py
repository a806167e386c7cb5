"""How the body looks: one colour per painted region of the mesh.

Colours are linear RGB (not sRGB), 0 to 1, as a shader multiplies them with light.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int

REGION_COLORS: dict[str, tuple[float, float, float]] = {
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
REGION_NAMES: tuple[str, ...] = tuple(REGION_COLORS)
REGION_INDEX: dict[str, int] = {name: i for i, name in enumerate(REGION_NAMES)}


def vertex_colors(regions: Int[np.ndarray, " V"]) -> Float32[np.ndarray, "V 3"]:
    """Linear RGB of each vertex from its region index (an index into ``REGION_NAMES``)."""
    palette = np.array([REGION_COLORS[name] for name in REGION_NAMES], np.float32)
    return palette[regions]
