"""Does the face live? Blinks, brows, and a mouth that opens with the voice; for ARKit's units."""

import numpy as np
from jaxtyping import Float

from conventions.joints import JOINT_INDEX
from model.motion.motion import Motion
from model.motion.skeleton import face_unit_names

BLINK_CLOSED, BLINK_OPEN = 0.5, 0.3
"""A lid that passes the first has begun a blink, and ends it below the second."""


def unit_columns(name: str) -> tuple[int, ...]:
    """Columns of a face unit on both sides, in the body's order of ``expression_names``."""
    return tuple(k for k, found in enumerate(face_unit_names()) if found.startswith(name))


def face_measures(motion: Motion, loudness: Float[np.ndarray, " T"]) -> dict[str, float]:
    """Blinks a minute, the spread of the brows, and how far jaw and loudness go together.

    ``blinks_per_min``; ``brow_std``: standard deviation of the inner brow's raise (0 to 1);
    ``jaw_loudness``: correlation of the jaw's angle with the loudness of speech, which is 0 for a
    jaw that is still. A motion in FLAME's coefficients has the last only.
    """
    frames = min(motion.num_frames, len(loudness))
    jaw = np.linalg.norm(motion.poses[:frames, 3 * JOINT_INDEX["jaw"] :][:, :3], axis=1)
    found = {"jaw_loudness": _correlation(jaw, loudness[:frames])}
    if motion.expression_basis == "arkit52":
        lids = motion.expressions[:, unit_columns("eyeBlink")].mean(1)
        brow = motion.expressions[:, unit_columns("browInnerUp")].mean(1)
        found["blinks_per_min"] = 60 * count_blinks(lids) / motion.duration_s
        found["brow_std"] = float(brow.std())
    return found


def count_blinks(lids: Float[np.ndarray, " T"]) -> int:
    """How often the lids close, from 0 (open) to 1."""
    is_closed, count = False, 0
    for value in lids:
        if not is_closed and value > BLINK_CLOSED:
            is_closed, count = True, count + 1
        elif is_closed and value < BLINK_OPEN:
            is_closed = False
    return count


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    return 0.0 if a.std() == 0 or b.std() == 0 else float(np.corrcoef(a, b)[0, 1])
