"""Coarser meshes of the open body: other faces among the same vertices."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
from jaxtyping import UInt16

COARSER_PATH = Path(__file__).parents[1] / "assets" / "coarser.npz"
"""Made by `tools.bake.coarser`."""


@functools.cache
def coarser_faces() -> tuple[UInt16[np.ndarray, "_ 3"], ...]:
    """Of each mesh, from fine to coarse."""
    with np.load(COARSER_PATH, allow_pickle=False) as archive:
        return tuple(archive[f"faces_{k}"] for k in range(len(archive.files)))
