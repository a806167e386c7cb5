"""Names of the representations of motion for networks."""

from typing import Literal

RotationSpace = Literal["local", "global", "axis-angle"]
"""Rotation format of joints: local or global row-6D, or local axis-angle."""
RootFormat = Literal["velocity", "place"]
"""Root channels: the pelvis' horizontal velocity, or its position relative to the body's home."""
VectorScaling = Literal["normalised", "raw"]
"""Scaling of motion vectors: every body-part group at unit variance, or raw 6D as in the official
GlobalDiff code (with normalised root channels all the same)."""

ROOT_DIM = 3
AXIS_ANGLE_MOTION_DIM = 55 * 3 + ROOT_DIM
"""Number of channels of a frame with local axis-angle and the root motion."""
