"""Options of rendering: view, framing, and the build and skin tone of the body."""

from typing import Literal, get_args

View = Literal["front", "three_quarter", "side", "face", "left_hand", "right_hand"]
VIEWS: tuple[View, ...] = get_args(View)
CloseUp = Literal["face", "hands"]
CLOSE_UPS: tuple[CloseUp, ...] = get_args(CloseUp)
"""Close-ups that may be rendered next to the body."""
Framing = Literal["whole", "knees"]
FRAMINGS: tuple[Framing, ...] = get_args(Framing)
"""Part of the body in views that are not close-ups: all of it, or from the knees up."""

BodyBuild = Literal["average", "slender", "broad"]
BODY_BUILDS: tuple[BodyBuild, ...] = get_args(BodyBuild)
"""Builds of the open body; the first is the one of its mesh file."""
SkinTone = Literal["light", "medium", "dark", "clay"]
SKIN_TONES: tuple[SkinTone, ...] = get_args(SkinTone)
BODY_LOOKS = tuple(f"{build}-{tone}" for build in BODY_BUILDS for tone in SKIN_TONES)
"""Looks of the open body; the first is the default."""

CUTOFF_HZ = 5.0
"""Cutoff frequency above which motion is exaggerated (Hz); gestures have little energy there."""
MAX_EXAGGERATED_RAD = 0.8
"""Largest rotation of an exaggerated residual (rad), so that no joint turns over."""
