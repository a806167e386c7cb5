"""What does not move though people do: the body, its parts, and the face."""

from collections.abc import Iterator

import numpy as np

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.faults.evidence import BODY, UPPER_AND_HANDS, Evidence, Finding, clock, stretches_of
from model.measures.face import unit_columns

STILL_M_S = 1e-3
"""Mean speed of the fastest joint under which nothing moves."""
FROZEN_DEG_S = 1.0
FROZEN_FRAMES = 8
"""Clean: no two frames in a row in which upper body and fingers all turn slower than 1 degree per
second, in two recorded and 90 procedural clips."""
HAND_STILL = 0.5
"""Of all frames; clean: 0, because living fingers are never still for a thirtieth of a second."""
MOVING_FRAMES = 2 * FPS
"""Nobody's pelvis stays for two seconds where it is, to the last bit."""


def nothing_moves(evidence: Evidence) -> Iterator[Finding]:
    if not evidence.raw.positions.joint_speed_m_s.max() < STILL_M_S:
        return
    yield Finding("Nothing moves in this motion.", {})


def freezes(evidence: Evidence) -> Iterator[Finding]:
    """Longer than two seconds or a quarter: the whole upper body stops, fingers too."""
    fastest = evidence.turning_deg_s[:, list(UPPER_AND_HANDS)].max(axis=1, initial=0.0)
    runs = [
        (first, last + 1)
        for first, last in stretches_of(fastest < FROZEN_DEG_S)
        if last - first + 1 >= FROZEN_FRAMES
    ]
    if not runs:
        return
    first, last = runs[0]
    times = f"{len(runs)} times, longest" if len(runs) > 1 else "once,"
    total_s = sum(end - start for start, end in runs) / FPS
    yield Finding(
        f"Upper body and fingers freeze {times} for {(last - first) / FPS:.1f} s at"
        f" {clock(first)}; in recorded clips no two frames are so still.",
        {"times": len(runs), "longest_s": (last - first) / FPS, "total_s": total_s},
        excess=(last - first) / FROZEN_FRAMES,
        worst_frame=first,
        stretches=tuple(runs),
    )


def frozen_hands(evidence: Evidence) -> Iterator[Finding]:
    for side, share in vars(evidence.raw.rotations.fingers_still_share).items():
        if share > HAND_STILL:
            yield Finding(
                f"The fingers of the {side} hand are frozen in {100 * share:.0f} % of the frames.",
                {"side": side, "still_share": share},
                excess=share / HAND_STILL,
            )


def translation_never_changes(evidence: Evidence) -> Iterator[Finding]:
    """The body turns about a pelvis that is nailed down."""
    trans = evidence.motion.trans
    if len(trans) < MOVING_FRAMES or np.ptp(trans, axis=0).any():
        return
    if evidence.turning_deg_s[:, list(BODY)].mean() < FROZEN_DEG_S:
        return
    where = "all zero" if not trans.any() else "the same in every frame"
    yield Finding(
        f"The translation is {where}: the body never leaves its place, so that feet slide or"
        " float wherever it leans. Foot measures tell of that more than of the feet.",
        {"trans_m": trans[0].tolist()},
    )


STILL_JAW_DEG = 0.05
"""Standard deviation; clean: at least 0.57 in a stretch of 10 s."""
STILL_UNIT = 1e-3
"""Of the liveliest coefficient; clean: at least 0.11."""
LEAST_FRAMES = 3 * FPS
COPIED_SHARE = 0.5


def still_face(evidence: Evidence) -> Iterator[Finding]:
    """The jaw, the coefficients, or both. A jaw that opens by a coefficient counts as a jaw."""
    if evidence.num_frames < LEAST_FRAMES:
        return
    motion = evidence.motion
    jaw = motion.poses.reshape(-1, 55, 3)[:, JOINT_INDEX["jaw"]].astype(np.float64)
    jaw_deg = float(np.degrees(jaw.std(axis=0).max()))
    unit = float(motion.expressions.std(axis=0).max())
    jaw_unit = 0.0
    if motion.expression_basis == "arkit52":
        jaw_unit = float(motion.expressions[:, unit_columns("jawOpen")].std(axis=0).max())
    is_jaw_still = jaw_deg < STILL_JAW_DEG and jaw_unit < STILL_UNIT
    if is_jaw_still and unit < STILL_UNIT:
        said = "The face never moves, neither jaw nor expression."
        if not (jaw.any() or motion.expressions.any()):
            said = "There is no face: jaw and expressions are zero throughout."
    elif is_jaw_still:
        said = "The jaw never moves, though the expression does."
    elif unit < STILL_UNIT:
        value = "all zero" if not motion.expressions.any() else "the same in every frame"
        said = f"The expressions are {value}; only the jaw moves."
    else:
        return
    numbers = {"jaw_deviation_deg": jaw_deg, "expression_deviation": unit}
    yield Finding(said, numbers)


def copied_face(evidence: Evidence) -> Iterator[Finding]:
    """Frames of expressions that are the reference's to the last bit, at whatever time."""
    if evidence.reference is None:
        return
    own, theirs = evidence.motion.expressions, evidence.reference.motion.expressions
    recorded = {row.tobytes() for row in theirs if row.any()}
    is_copy = np.array([row.tobytes() in recorded for row in own])
    share = float(is_copy.mean())
    if share <= COPIED_SHARE or own.std(axis=0).max() < STILL_UNIT:
        return
    yield Finding(
        f"The expressions are the reference's, bit for bit, in {100 * share:.0f} % of the frames:"
        " they were copied, not made.",
        {"copied_share": share},
        excess=share / COPIED_SHARE,
    )
