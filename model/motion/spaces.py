"""The ways in which motion can be told to a network, by name."""

from typing import Literal

RotationSpace = Literal["local", "global", "axis-angle"]
"""Frame of the rotations of joints: in the parent, or in the world, both as row-6D; or in the
parent as axis times angle."""
RootMotion = Literal["velocity", "place"]
"""Horizontal motion of the pelvis: as a velocity, or as the way from where the body is at home."""
Representation = Literal["normalised", "raw"]
"""Every body-part group at unit variance, or raw 6D as in the official GlobalDiff code (the three
root channels normalised all the same)."""

ROOT_DIM = 3
AXIS_ANGLE_MOTION_DIM = 55 * 3 + ROOT_DIM
"""Channels of a frame that holds local axis-angle, and the root motion."""
