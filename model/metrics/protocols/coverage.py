"""Protocol ``gac/unicamp``: area that the body's bones sweep over, seen from the front.

Gesture Area Coverage (AI-Unicamp): the bones of each frame are drawn as lines on a grid of cells of
5 mm, 2 m wide and high. The coverage is the number of cells touched; the coverages of a motion and
of its reference are compared by their Dice score, twice the common cells by the sum of both.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from conventions.joints import PARENTS
from model.metrics.protocols.clip import Clip, Sums

BONES = range(2, 22)
"""Lower ends of the bones; the first two of the 22 body joints are skipped."""
CELL_CM, WIDTH_CM = 0.5, 200
_SIZE = int(WIDTH_CM / CELL_CM)


def coverage_sums(clip: Clip) -> Sums:
    """Compute the number of cells of a clip, and the Dice score with its reference."""
    cells = covered_cells(clip.joints)
    sums = {"count": np.array(1.0), "cells": np.array(float(cells.sum()))}
    if clip.reference is not None:
        sums["dice"] = np.array(dice_score(cells, covered_cells(clip.reference.joints)))
    return sums


def dice_score(cells: Bool[np.ndarray, "y x"], others: Bool[np.ndarray, "y x"]) -> float:
    """Compute the Dice score of two coverages, 0 to 1."""
    return float(2 * (cells & others).sum() / (cells.sum() + others.sum()))


def covered_cells(joints: Float[np.ndarray, "T 55 3"]) -> Bool[np.ndarray, "400 400"]:
    """Return the cells [height, width] that the bones touch in any frame."""
    body = (joints[:, :22] - joints[:, :1])[..., :2] * 100
    body[..., 1] -= body[..., 1].min()
    body[..., 0] += WIDTH_CM / 2
    cells = np.rint(body / CELL_CM).astype(np.int64).clip(0, _SIZE - 1)
    lines = [np.hstack([cells[:, PARENTS[joint]], cells[:, joint]]) for joint in BONES]
    return _drawn(np.unique(np.concatenate(lines), axis=0))


def _drawn(lines: Int[np.ndarray, "n 4"]) -> Bool[np.ndarray, "400 400"]:
    """Mark the cells of all lines at once, each from its first end, by Bresenham's algorithm."""
    grid = np.zeros((_SIZE, _SIZE), bool)
    at, end = lines[:, :2].copy(), lines[:, 2:]
    length, sign = np.abs(end - at), np.where(at < end, 1, -1)
    error = length[:, 0] - length[:, 1]
    grid[at[:, 1], at[:, 0]] = True
    while len(at):
        left = (at != end).any(1)
        at, end, length, sign, error = (array[left] for array in (at, end, length, sign, error))
        sideways, upwards = 2 * error > -length[:, 1], 2 * error < length[:, 0]
        error = error - sideways * length[:, 1] + upwards * length[:, 0]
        at = at + sign * np.stack([sideways, upwards], axis=1)
        grid[at[:, 1], at[:, 0]] = True
    return grid
