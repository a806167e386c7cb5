"""Where the wrists of a motion are, as plans tell it."""

import numpy as np
from jaxtyping import Float

from conventions.joints import JOINT_INDEX
from model.motion.tracks import Tracks
from model.plan.plan import SIDES, Side

OUTWARD: dict[Side, tuple[float, float, float]] = {
    "left": (1.0, 1.0, 1.0),
    "right": (-1.0, 1.0, 1.0),
}
"""What turns the chest's axes into out, up and forward, and back."""


def wrist_places(tracks: Tracks) -> dict[Side, Float[np.ndarray, "T 3"]]:
    """Metres from the chest joint in the chest's frame: out to the hand's own side, up, forward."""
    chest = JOINT_INDEX["spine3"]
    turned = tracks.global_rot[:, chest].astype(np.float64)
    places: dict[Side, Float[np.ndarray, "T 3"]] = {}
    for side in SIDES:
        off = tracks.joints[:, JOINT_INDEX[f"{side}_wrist"]] - tracks.joints[:, chest]
        places[side] = np.einsum("tij,ti->tj", turned, off) * np.array(OUTWARD[side])
    return places
