"""Options of rendering: view, framing, and the build and skin tone of the body."""

from typing import Literal, get_args

View = Literal["front", "three_quarter", "side", "face", "left_hand", "right_hand"]
VIEWS: tuple[View, ...] = get_args(View)
CloseUp = Literal["face", "hands"]
CLOSE_UPS: tuple[CloseUp, ...] = get_args(CloseUp)
"""Close-ups that may be rendered next to the body."""
Framing = Literal["whole", "knees"]
FRAMINGS: tuple[Framing, ...] = get_args(Framing)
"""Part of the body in views that are no close-ups: all of it, or from the knees up."""

Build = Literal["average", "slender", "broad"]
BUILDS: tuple[Build, ...] = get_args(Build)
"""Builds of the open body; the first is the one of its mesh file."""
Tone = Literal["light", "medium", "dark", "clay"]
TONES: tuple[Tone, ...] = get_args(Tone)
BODY_LOOKS = tuple(f"{build}-{tone}" for build in BUILDS for tone in TONES)
"""Looks of the open body; the first is the default."""

CUTOFF_HZ = 5.0
"""Cutoff frequency above which motion is exaggerated (Hz); gestures have little energy there."""
MAX_EXAGGERATED_RAD = 0.8
"""Largest rotation of an exaggerated residual (rad), so that no joint turns over."""
