"""How the body looks: one colour per painted region of the mesh.

Colours are linear RGB (not sRGB), 0 to 1, as a shader multiplies them with light.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int

REGION_COLORS: dict[str, tuple[float, float, float]] = {
    "skin": (0.50, 0.40, 0.34),
    "suit": (0.115, 0.17, 0.26),
    "shoe": (0.045, 0.05, 0.06),
    "eye_white": (0.80, 0.80, 0.79),
    "iris": (0.10, 0.15, 0.20),
    "iris_rim": (0.05, 0.07, 0.09),
    "pupil": (0.01, 0.01, 0.012),
    "teeth": (0.62, 0.60, 0.55),
    "mouth": (0.10, 0.035, 0.035),
    "lip_inside": (0.30, 0.17, 0.16),
}
REGION_NAMES: tuple[str, ...] = tuple(REGION_COLORS)


def vertex_colors(regions: Int[np.ndarray, " V"]) -> Float32[np.ndarray, "V 3"]:
    """Linear RGB of each vertex from its region index (an index into ``REGION_NAMES``)."""
    palette = np.array([REGION_COLORS[name] for name in REGION_NAMES], np.float32)
    return palette[regions]
