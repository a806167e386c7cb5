"""A face that does not move, or is another's."""

import numpy as np

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.faults.evidence import Evidence
from model.faults.finding import Finding
from model.measures.face.face_measures import unit_columns

STILL_JAW_DEG = 0.05
"""Standard deviation; clean: at least 0.57 in a stretch of 10 s."""
STILL_UNIT = 1e-3
"""Of the liveliest coefficient; clean: at least 0.11."""
LEAST_FRAMES = 3 * FPS
COPIED_SHARE = 0.5


def still_face(evidence: Evidence) -> list[Finding]:
    """The jaw, the coefficients, or both. A jaw that opens by a coefficient counts as a jaw."""
    if evidence.num_frames < LEAST_FRAMES:
        return []
    motion = evidence.motion
    jaw = motion.poses.reshape(-1, 55, 3)[:, JOINT_INDEX["jaw"]].astype(np.float64)
    jaw_deg = float(np.degrees(jaw.std(axis=0).max()))
    unit = float(motion.expressions.std(axis=0).max())
    jaw_unit = 0.0
    if motion.expression_basis == "arkit52":
        jaw_unit = float(motion.expressions[:, unit_columns("jawOpen")].std(axis=0).max())
    is_jaw_still = jaw_deg < STILL_JAW_DEG and jaw_unit < STILL_UNIT
    numbers = {"jaw_deviation_deg": jaw_deg, "expression_deviation": unit}
    if is_jaw_still and unit < STILL_UNIT:
        if not (jaw.any() or motion.expressions.any()):
            said = "There is no face: jaw and expressions are zero throughout."
        else:
            said = "The face never moves, neither jaw nor expression."
        return [Finding("still_face", said, numbers)]
    if is_jaw_still:
        return [Finding("still_face", "The jaw never moves, though the expression does.", numbers)]
    if unit < STILL_UNIT:
        value = "all zero" if not motion.expressions.any() else "the same in every frame"
        return [Finding("still_face", f"The expressions are {value}; only the jaw moves.", numbers)]
    return []


def copied_face(evidence: Evidence) -> list[Finding]:
    """Frames of expressions that are the reference's to the last bit, at whatever time."""
    if evidence.reference is None:
        return []
    own, theirs = evidence.motion.expressions, evidence.reference.motion.expressions
    recorded = {row.tobytes() for row in theirs if row.any()}
    is_copy = np.array([row.tobytes() in recorded for row in own])
    share = float(is_copy.mean())
    if share <= COPIED_SHARE or own.std(axis=0).max() < STILL_UNIT:
        return []
    return [
        Finding(
            "copied_face",
            f"The expressions are the reference's, bit for bit, in {share:.0%} of the frames: they"
            " were copied, not made.",
            {"copied_share": share},
            excess=share / COPIED_SHARE,
        )
    ]
