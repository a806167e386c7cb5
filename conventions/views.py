"""How a body is shown: from where, how much of it, and with which looks."""

from typing import Literal, get_args

View = Literal["front", "three_quarter", "side", "face", "left_hand", "right_hand"]
VIEWS: tuple[View, ...] = get_args(View)
CloseUp = Literal["face", "hands"]
CLOSE_UPS: tuple[CloseUp, ...] = get_args(CloseUp)
"""What may be shown large beside the body."""
Framing = Literal["whole", "knees"]
FRAMINGS: tuple[Framing, ...] = get_args(Framing)
"""How much of a body a view shows that is no close-up: all, or from the knees up."""

Build = Literal["average", "slender", "broad"]
BUILDS: tuple[Build, ...] = get_args(Build)
"""Builds of the open body; the first is the one its file is written around."""
Tone = Literal["light", "medium", "dark", "clay"]
TONES: tuple[Tone, ...] = get_args(Tone)
LOOKS = tuple(f"{build}-{tone}" for build in BUILDS for tone in TONES)
"""Looks of the open body; the first is the usual one."""

CUTOFF_HZ = 5.0
"""A tremble that is shown larger lies above it: gestures hold little there."""
MAX_TURN_RAD = 0.8
"""A multiplied tremble is no larger than this, so that no joint turns over."""
