"""Detectors of impossible posture and joint angles, and of body parts that never move."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from conventions.joints import JOINT_INDEX
from conventions.names import join_names
from conventions.rates import FPS
from model.faults import analysis
from model.faults.analysis import BODY, UPPER_AND_HANDS, AnalysedMotion, Finding
from model.metrics.face import blendshape_columns
from model.metrics.joints import FINGER_JOINT_NAMES
from model.metrics.posture import FEET, FLOATING_M, GROUND_PERCENTILE, SINKING_M, WRISTS
from model.metrics.smoothness import derivative_magnitudes
from model.motion.tracks import point_label

LYING_DEG = 45.0
"""Mean tilt of the spine (degrees); clean: 12 at most."""
MAX_HEIGHT_OFFSET_M = 0.08
"""Difference in height of the lower foot, motion to reference (m); clips of one speaker: 0.001."""
FOOT_SLIDE_M_S = 0.15
"""Mean speed of feet on the ground (m/s); clean: at most 0.12, and 0.07 over a whole clip."""
FLOATING_FRAMES = 8
FLOATING_ABOVE_PERCENTILE_M = 0.10
"""Height of the lower foot above its 5th percentile (m); recorded clips: at most 0.08 in 10 s."""
SINKING_FRAMES = 2
STANDING_M, STANDING_SHARE = 0.03, 0.5
"""Distance from the floor (m) in which feet stand, and the least share of frames in which they do.
Recordings: 0.9 and more; with up to 10 s of 30 at 12 cm below, 0.62; bobbing by 11 cm, 0.41."""
CONTACT_SHARE = 0.35
"""Least share of frames with ground contact; clean: at least 0.52 in 10 s, 0.97 in a whole clip."""


def lying_body(analysed: AnalysedMotion) -> Iterator[Finding]:
    tilt = analysed.metrics.posture.spine_tilt_deg
    if not tilt.mean > LYING_DEG:
        return
    yield Finding(
        f"The spine is tilted by {tilt.mean:.0f}° on average: the body is lying, or the file's up "
        "axis is not y. If it is z, use the import setting up=z (on the command line: --assume).",
        {"spine_tilt_deg": tilt.mean},
        limit_ratio=tilt.mean / LYING_DEG,
    )


def height_offset_to_reference(analysed: AnalysedMotion) -> Iterator[Finding]:
    """Detect feet that stand above or below those of the reference."""
    if analysed.reference is None:
        return
    apart = analysed.median_lower_foot_height_m - analysed.reference.median_lower_foot_height_m
    if abs(apart) <= MAX_HEIGHT_OFFSET_M:
        return
    where = "above" if apart > 0 else "below"
    yield Finding(
        f"The feet stand {100 * abs(apart):.0f} cm {where} the reference's.",
        {"height_m": apart},
        "recorded clips of one speaker: within 1 cm",
        limit_ratio=abs(apart) / MAX_HEIGHT_OFFSET_M,
    )


def feet_slide(analysed: AnalysedMotion) -> Iterator[Finding]:
    slide = analysed.metrics.posture.foot_slide_m_s
    if not slide > FOOT_SLIDE_M_S:
        return
    feet = analysed.tracks.joints[:, list(FEET)] * (1.0, 0.0, 1.0)
    contact = analysed.metrics.posture.foot_contact_share
    is_rare = contact < CONTACT_SHARE
    few = f"; they are on the ground in only {100 * contact:.0f} % of the frames" if is_rare else ""
    yield Finding(
        f"Feet slide at {100 * slide:.0f} cm/s on average while on the ground{few}.",
        {"foot_slide_m_s": slide, "contact_share": contact},
        f"recorded clips: under {100 * FOOT_SLIDE_M_S:.0f} cm/s",
        limit_ratio=slide / FOOT_SLIDE_M_S,
        worst_frame=analysis.middle_of_worst_second(derivative_magnitudes(feet, 1).mean(axis=1)),
    )


def feet_float(analysed: AnalysedMotion) -> Iterator[Finding]:
    """Detect both feet in the air, above the lower foot's median height or 5th percentile.

    The percentile may lie below the floor of a body that stands; see `feet_sink`.
    """
    above = analysed.lower_foot_height_m - analysed.median_lower_foot_height_m
    is_up, contact = above > FLOATING_M, _standing_share(analysed)
    if contact < STANDING_SHARE:
        above = analysed.lower_foot_height_m - np.percentile(
            analysed.lower_foot_height_m, GROUND_PERCENTILE
        )
        is_up, contact = (
            is_up | (above > FLOATING_ABOVE_PERCENTILE_M),
            analysed.metrics.posture.foot_contact_share,
        )
    runs = [r for r in analysis.longest_true_ranges(is_up) if r[1] - r[0] + 1 >= FLOATING_FRAMES]
    if not runs and contact >= CONTACT_SHARE:
        return
    worst = int(above.argmax())
    message = (
        f"Both feet are above the floor by up to {100 * above[worst]:.0f} cm, worst at "
        f"{analysis.format_time(worst)}{f', {len(runs)} times in all' if len(runs) > 1 else ''}"
        if runs
        else "The feet have no consistent floor height"
    )
    yield Finding(
        f"{message}; a foot is on the ground in {100 * contact:.0f} % of the frames.",
        {
            "height_m": float(above[worst]),
            "contact_share": contact,
            "floating_share": analysed.metrics.posture.foot_floating_share,
        },
        "recorded clips: in at least 97 %",
        limit_ratio=max(float(above[worst]) / FLOATING_M, CONTACT_SHARE / max(contact, 0.01)),
        worst_frame=worst,
        frame_ranges=tuple(runs),
    )


def _standing_share(analysed: AnalysedMotion) -> float:
    """Return the share of frames in which the lower foot is near its median height."""
    return float(
        np.mean(
            abs(analysed.lower_foot_height_m - analysed.median_lower_foot_height_m) < STANDING_M
        )
    )


def feet_sink(analysed: AnalysedMotion) -> Iterator[Finding]:
    """Detect a foot below the floor; a body that bobs or drifts has none, see `feet_float`."""
    below = analysed.median_lower_foot_height_m - analysed.lower_foot_height_m
    is_below = below > SINKING_M
    if is_below.sum() < SINKING_FRAMES or _standing_share(analysed) < STANDING_SHARE:
        return
    worst = int(below.argmax())
    share = float(np.mean(is_below))
    yield Finding(
        f"A foot is up to {100 * below[worst]:.0f} cm below the floor, worst at "
        f"{analysis.format_time(worst)}, "
        f"and deeper than {100 * SINKING_M:.0f} cm in {100 * share:.1f} % of the frames (floor: "
        "median height of the lower foot).",
        {"depth_m": float(below[worst]), "share": share},
        limit_ratio=float(below[worst]) / SINKING_M,
        worst_frame=worst,
        frame_ranges=analysis.longest_true_ranges(is_below),
    )


FINGERS_OUTSIDE = 0.02
"""Share of all frames and finger joints; clean: at most 0.005, and 0.001 over a whole clip."""
FINGER_JOINT_OUTSIDE_SHARE = 0.2
"""Share of the frames of one finger joint; clean: at most 0.01 over a whole clip."""
NAMED = 3
ELBOWS_BACKWARDS = 0.5
"""Share of all frames, on both sides; clean: 0."""
SWAPPED_ERROR_RATIO = 0.6
"""Error with sides changed over the error without; about 1 if unrelated, 0 for a swapped copy."""
MIN_HAND_TO_SPINE_M = 0.06
"""Distance (m) of wrist, knuckle or fingertip from the line through pelvis, spine and neck, which
is 10 cm and more under the skin in front; clean: at least 0.099."""
INSIDE_FRAMES = 3
_SPINE = ("pelvis", "spine1", "spine2", "spine3", "neck")
_KNUCKLES = ("left_middle1", "right_middle1")


def finger_joint_limits(analysed: AnalysedMotion) -> Iterator[Finding]:
    share = analysed.metrics.joint_limits.finger_angle_outside_share
    by_joint = analysed.metrics.joint_limits.finger_angle_outside_by_joint
    worst = sorted(by_joint, key=lambda name: -by_joint[name])[:NAMED]
    if share <= FINGERS_OUTSIDE and by_joint[worst[0]] <= FINGER_JOINT_OUTSIDE_SHARE:
        return
    assert set(by_joint) == set(FINGER_JOINT_NAMES)
    named = join_names(
        [f"{point_label(name)} ({100 * by_joint[name]:.0f} %)" for name in worst if by_joint[name]]
    )
    yield Finding(
        f"Over all frames, {100 * share:.1f} % of the finger-joint angles are beyond the human "
        f"range, most often those of the {named}.",
        {
            "outside_share": share,
            "joints": {name: by_joint[name] for name in worst if by_joint[name]},
        },
        limit_ratio=max(share / FINGERS_OUTSIDE, by_joint[worst[0]] / FINGER_JOINT_OUTSIDE_SHARE),
    )


def hand_penetration(analysed: AnalysedMotion) -> Iterator[Finding]:
    joints = analysed.tracks.joints
    knuckles = [*WRISTS, *(JOINT_INDEX[name] for name in _KNUCKLES)]
    hands = np.concatenate([joints[:, knuckles], analysed.tracks.fingertips], axis=1)
    nearest = np.full(hands.shape[:2], np.inf)
    for lower, upper in pairwise(_SPINE):
        start = joints[:, None, JOINT_INDEX[lower]]
        bone = joints[:, None, JOINT_INDEX[upper]] - start
        along = ((hands - start) * bone).sum(-1) / np.maximum((bone**2).sum(-1), 1e-12)
        off = hands - start - np.clip(along, 0.0, 1.0)[..., None] * bone
        nearest = np.minimum(nearest, np.linalg.norm(off, axis=-1))
    distance = nearest.min(axis=1)
    is_inside = distance < MIN_HAND_TO_SPINE_M
    if is_inside.sum() < INSIDE_FRAMES:
        return
    worst = int(distance.argmin())
    place = int(nearest[worst].argmin())
    is_left = place % 2 == 0 if place < len(knuckles) else place - len(knuckles) < 5
    side = "left" if is_left else "right"
    yield Finding(
        f"The {side} hand penetrates the body in {is_inside.sum()} frames, deepest at "
        f"{analysis.format_time(worst)}: {100 * distance[worst]:.0f} cm from the axis of the "
        "spine.",
        {"side": side, "distance_m": float(distance[worst]), "frames": int(is_inside.sum())},
        limit_ratio=MIN_HAND_TO_SPINE_M / max(float(distance[worst]), 0.005),
        worst_frame=worst,
        frame_ranges=analysis.longest_true_ranges(is_inside),
    )


def swapped_sides(analysed: AnalysedMotion) -> Iterator[Finding]:
    """Detect exchanged sides by comparison with a reference of the same speech.

    Without one, only exchanged joint names show (both elbows bend backwards); mirroring does not.
    """
    if analysed.metrics.errors is not None:
        errors = analysed.metrics.errors.rotation_error_by_sides_deg
        is_mirrored = errors.mirrored <= errors.swapped
        error = errors.mirrored if is_mirrored else errors.swapped
        if error >= SWAPPED_ERROR_RATIO * errors.as_is:
            return
        how = "as a mirror image" if is_mirrored else "in the joint order"
        yield Finding(
            f"Left and right seem swapped {how}: upper body and hands differ from the reference by"
            f" {errors.as_is:.0f}°, and by {error:.0f}° after swapping them back.",
            {
                "way": "mirrored" if is_mirrored else "swapped",
                "error_deg": errors.as_is,
                "error_swapped_deg": error,
            },
            limit_ratio=SWAPPED_ERROR_RATIO * errors.as_is / max(error, 0.1),
        )
        return
    backwards = analysed.metrics.joint_limits.elbow_backwards_share
    share = min(backwards.left, backwards.right)
    if share <= ELBOWS_BACKWARDS:
        return
    yield Finding(
        "Left and right joints seem swapped: both elbows bend backwards in at"
        f" least {100 * share:.0f} % of the frames.",
        {"way": "swapped", "elbow_backwards_share": backwards},
        limit_ratio=share / ELBOWS_BACKWARDS,
    )


STILL_M_S = 1e-3
"""Mean speed of the fastest joint below which nothing moves (m/s)."""
FROZEN_DEG_S = 1.0
FROZEN_FRAMES = 8
"""Shortest freeze (frames). Clean: no two frames in a row in which upper body and fingers all turn
slower than 1 degree per second, in two recorded and 90 procedural clips."""
HAND_STILL = 0.5
"""Share of all frames; clean: 0, because living fingers are never still for 1/30 s."""
MIN_TRANSLATION_CHECK_FRAMES = 2 * FPS
"""Shortest clip for the check (frames): nobody's pelvis is bit-identical for two seconds."""


def still_motion(analysed: AnalysedMotion) -> Iterator[Finding]:
    if not analysed.metrics.positions.joint_speed_m_s.max() < STILL_M_S:
        return
    yield Finding("No joint moves in this motion.", {})


def frozen_upper_body(analysed: AnalysedMotion) -> Iterator[Finding]:
    """Detect runs of `FROZEN_FRAMES` or more in which the whole upper body stops, fingers too."""
    fastest = analysed.angular_speed_deg_s[:, list(UPPER_AND_HANDS)].max(axis=1, initial=0.0)
    runs = [
        (first, last + 1)  # speed k is that from frame k to frame k + 1
        for first, last in analysis.longest_true_ranges(fastest < FROZEN_DEG_S)
        if last - first + 1 >= FROZEN_FRAMES
    ]
    if not runs:
        return
    first, last = runs[0]
    times = f"{len(runs)} times, longest" if len(runs) > 1 else "once,"
    total_s = sum(end - start for start, end in runs) / FPS
    yield Finding(
        f"Upper body and fingers freeze {times} for {(last - first) / FPS:.1f} s at"
        f" {analysis.format_time(first)}.",
        {"times": len(runs), "longest_s": (last - first) / FPS, "total_s": total_s},
        "recorded clips: never for two frames in a row",
        limit_ratio=(last - first) / FROZEN_FRAMES,
        worst_frame=first,
        frame_ranges=tuple(runs),
    )


def frozen_hands(analysed: AnalysedMotion) -> Iterator[Finding]:
    for side, share in vars(analysed.metrics.rotations.fingers_still_share).items():
        if share > HAND_STILL:
            yield Finding(
                f"The fingers of the {side} hand are frozen in {100 * share:.0f} % of the frames.",
                {"side": side, "still_share": share},
                limit_ratio=share / HAND_STILL,
            )


def translation_never_changes(analysed: AnalysedMotion) -> Iterator[Finding]:
    """Detect a translation that is constant while the body turns."""
    trans = analysed.motion.trans
    if len(trans) < MIN_TRANSLATION_CHECK_FRAMES or np.ptp(trans, axis=0).any():
        return
    if analysed.angular_speed_deg_s[:, list(BODY)].mean() < FROZEN_DEG_S:
        return
    where = "all zero" if not trans.any() else "the same in every frame"
    yield Finding(
        f"The translation is {where}: the pelvis stays at one point, so feet slide or float when "
        "the body leans. This dominates the foot metrics.",
        {"trans_m": trans[0].tolist()},
    )


STILL_JAW_DEG = 0.05
"""Standard deviation of the jaw angle (degrees); clean: at least 0.57 in a stretch of 10 s."""
STILL_COEFFICIENT = 1e-3
"""Standard deviation of the liveliest coefficient; clean: at least 0.11."""
LEAST_FRAMES = 3 * FPS
COPIED_SHARE = 0.5


def still_face(analysed: AnalysedMotion) -> Iterator[Finding]:
    """Detect a still jaw, also in the coefficient that opens it, or still coefficients."""
    if analysed.num_frames < LEAST_FRAMES:
        return
    motion = analysed.motion
    jaw = motion.poses.reshape(-1, 55, 3)[:, JOINT_INDEX["jaw"]].astype(np.float64)
    jaw_deg = float(np.degrees(jaw.std(axis=0).max()))
    unit = float(motion.expressions.std(axis=0).max())
    jaw_unit = 0.0
    if motion.expression_basis == "arkit52":
        jaw_unit = float(motion.expressions[:, blendshape_columns("jawOpen")].std(axis=0).max())
    is_jaw_still = jaw_deg < STILL_JAW_DEG and jaw_unit < STILL_COEFFICIENT
    if is_jaw_still and unit < STILL_COEFFICIENT:
        message = "The face never moves, neither jaw nor expression."
        if not (jaw.any() or motion.expressions.any()):
            message = "The motion has no face: jaw and expressions are zero in every frame."
    elif is_jaw_still:
        message = "The jaw never moves, though the expression does."
    elif unit < STILL_COEFFICIENT:
        value = "all zero" if not motion.expressions.any() else "the same in every frame"
        message = f"The expressions are {value}; only the jaw moves."
    else:
        return
    numbers = {"jaw_deviation_deg": jaw_deg, "expression_deviation": unit}
    yield Finding(message, numbers)


def copied_face(analysed: AnalysedMotion) -> Iterator[Finding]:
    """Detect frames of expressions that are bit-identical to the reference's, at whatever time."""
    if analysed.reference is None:
        return
    own, theirs = analysed.motion.expressions, analysed.reference.motion.expressions
    recorded = {row.tobytes() for row in theirs if row.any()}
    is_copy = np.array([row.tobytes() in recorded for row in own])
    share = float(is_copy.mean())
    if share <= COPIED_SHARE or own.std(axis=0).max() < STILL_COEFFICIENT:
        return
    yield Finding(
        f"In {100 * share:.0f} % of the frames the expressions are bit-identical to those of a "
        "frame of the reference: they were copied from it.",
        {"copied_share": share},
        limit_ratio=share / COPIED_SHARE,
    )
