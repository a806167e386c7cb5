"""How the body stands, and joints where no person's are."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from conventions.joints import JOINT_INDEX
from conventions.names import listed
from model.faults.evidence import Evidence, Finding, clock, most_in_a_second, stretches_of
from model.measures.joints import FINGER_JOINT_NAMES
from model.measures.posture import FEET, FLOATING_M, SINKING_M, WRISTS
from model.measures.smoothness import derivative_magnitudes
from model.motion.tracks import point_words

LYING_DEG = 45.0
"""Mean tilt of the spine; clean: 12 at most."""
LIFT_M = 0.08
"""Between the heights of the lower foot, motion and reference; clips of one speaker: 0.001."""
FOOT_SLIDE_M_S = 0.15
"""Clean: at most 0.12, and 0.07 over a whole clip."""
FLOATING_FRAMES = 8
SINKING_FRAMES = 2
CONTACT_SHARE = 0.35
"""Clean: at least 0.52 in a stretch of 10 s, 0.97 over a whole clip."""


def lying(evidence: Evidence) -> Iterator[Finding]:
    tilt = evidence.raw.posture.spine_tilt_deg
    if not tilt.mean > LYING_DEG:
        return
    yield Finding(
        f"The spine is tilted by {tilt.mean:.0f}° on average: the body lies, or the file's up"
        " is not y; --assume up=z reads z-up files.",
        {"spine_tilt_deg": tilt.mean},
        excess=tilt.mean / LYING_DEG,
    )


def lifted(evidence: Evidence) -> Iterator[Finding]:
    """The usual height of the lower foot beside the reference's."""
    if evidence.reference is None:
        return
    apart = evidence.floor_m - evidence.reference.floor_m
    if abs(apart) <= LIFT_M:
        return
    where = "above" if apart > 0 else "below"
    yield Finding(
        f"The feet stand {100 * abs(apart):.0f} cm {where} the reference's; recorded clips of"
        " one speaker agree to a centimetre.",
        {"height_m": apart},
        excess=abs(apart) / LIFT_M,
    )


def feet_slide(evidence: Evidence) -> Iterator[Finding]:
    slide = evidence.raw.posture.foot_slide_m_s
    if not slide > FOOT_SLIDE_M_S:
        return
    feet = evidence.tracks.joints[:, list(FEET)] * (1.0, 0.0, 1.0)
    contact = evidence.raw.posture.foot_contact_share
    is_rare = contact < CONTACT_SHARE
    few = f" (on the ground in {100 * contact:.0f} % of the frames only)" if is_rare else ""
    yield Finding(
        f"Feet on the ground slide at {100 * slide:.0f} cm/s on average{few}; recorded"
        f" clips stay under {100 * FOOT_SLIDE_M_S:.0f} cm/s.",
        {"foot_slide_m_s": slide, "contact_share": contact},
        excess=slide / FOOT_SLIDE_M_S,
        worst_frame=most_in_a_second(derivative_magnitudes(feet, 1).mean(axis=1)),
    )


def feet_float(evidence: Evidence) -> Iterator[Finding]:
    """Both feet in the air, over the height at which the lower one usually is."""
    above = evidence.lower_foot_m - evidence.floor_m
    contact = evidence.raw.posture.foot_contact_share
    runs = [r for r in stretches_of(above > FLOATING_M) if r[1] - r[0] + 1 >= FLOATING_FRAMES]
    if not runs and contact >= CONTACT_SHARE:
        return
    worst = int(above.argmax())
    found = (
        f"Both feet leave the floor by up to {100 * above[worst]:.0f} cm, at {clock(worst)}"
        if runs
        else "The feet hardly ever keep to one floor"
    )
    yield Finding(
        f"{found}; a foot is on the ground in {100 * contact:.0f} % of the frames, in recorded"
        " clips in 97 % and more.",
        {
            "height_m": float(above[worst]),
            "contact_share": contact,
            "floating_share": evidence.raw.posture.foot_floating_share,
        },
        excess=max(float(above[worst]) / FLOATING_M, CONTACT_SHARE / max(contact, 0.01)),
        worst_frame=worst,
        stretches=tuple(runs),
    )


def feet_sink(evidence: Evidence) -> Iterator[Finding]:
    below = evidence.floor_m - evidence.lower_foot_m
    is_below = below > SINKING_M
    if is_below.sum() < SINKING_FRAMES:
        return
    worst = int(below.argmax())
    share = float(np.mean(is_below))
    yield Finding(
        f"A foot goes {100 * below[worst]:.0f} cm through the floor at {clock(worst)}, and"
        f" deeper than {100 * SINKING_M:.0f} cm in {100 * share:.1f} % of the frames (the floor is"
        " where the lower foot usually stands).",
        {"depth_m": float(below[worst]), "share": share},
        excess=float(below[worst]) / SINKING_M,
        worst_frame=worst,
        stretches=stretches_of(is_below),
    )


FINGERS_OUTSIDE = 0.02
"""Of all frames and finger joints; clean: at most 0.005, and 0.001 over a whole clip."""
JOINT_OUTSIDE = 0.2
"""Of the frames of one finger joint; clean: at most 0.01 over a whole clip."""
NAMED = 3
ELBOWS_BACKWARDS = 0.5
"""Of all frames, on both sides; clean: 0."""
SWAPPED_ERROR_RATIO = 0.6
"""Error with the sides changed over the error as it is. Motions of the same speech that have
nothing to do with each other give about 1, a swapped copy 0."""
INSIDE_M = 0.06
"""Of a wrist, knuckle or fingertip from the line through pelvis, spine and neck, which is 10 cm
and more under the skin in front; clean: at least 0.099."""
INSIDE_FRAMES = 3
_SPINE = ("pelvis", "spine1", "spine2", "spine3", "neck")
_KNUCKLES = ("left_middle1", "right_middle1")


def finger_range(evidence: Evidence) -> Iterator[Finding]:
    share = evidence.raw.ranges.finger_angle_outside_share
    by_joint = evidence.raw.ranges.finger_angle_outside_by_joint
    worst = sorted(by_joint, key=lambda name: -by_joint[name])[:NAMED]
    if share <= FINGERS_OUTSIDE and by_joint[worst[0]] <= JOINT_OUTSIDE:
        return
    assert set(by_joint) == set(FINGER_JOINT_NAMES)
    named = listed(
        [f"{point_words(name)} ({100 * by_joint[name]:.0f} %)" for name in worst if by_joint[name]]
    )
    yield Finding(
        f"Fingers bend as no human hand can in {100 * share:.1f} % of frames and joints;"
        f" most often the {named}.",
        {
            "outside_share": share,
            "joints": {name: by_joint[name] for name in worst if by_joint[name]},
        },
        excess=max(share / FINGERS_OUTSIDE, by_joint[worst[0]] / JOINT_OUTSIDE),
    )


def hand_in_body(evidence: Evidence) -> Iterator[Finding]:
    joints = evidence.tracks.joints
    knuckles = [*WRISTS, *(JOINT_INDEX[name] for name in _KNUCKLES)]
    hands = np.concatenate([joints[:, knuckles], evidence.tracks.fingertips], axis=1)
    nearest = np.full(hands.shape[:2], np.inf)
    for lower, upper in pairwise(_SPINE):
        start = joints[:, None, JOINT_INDEX[lower]]
        bone = joints[:, None, JOINT_INDEX[upper]] - start
        along = ((hands - start) * bone).sum(-1) / np.maximum((bone**2).sum(-1), 1e-12)
        off = hands - start - np.clip(along, 0.0, 1.0)[..., None] * bone
        nearest = np.minimum(nearest, np.linalg.norm(off, axis=-1))
    distance = nearest.min(axis=1)
    is_inside = distance < INSIDE_M
    if is_inside.sum() < INSIDE_FRAMES:
        return
    worst = int(distance.argmin())
    place = int(nearest[worst].argmin())
    is_left = place % 2 == 0 if place < len(knuckles) else place - len(knuckles) < 5
    side = "left" if is_left else "right"
    yield Finding(
        f"The {side} hand goes into the body at {clock(worst)}: it is"
        f" {100 * distance[worst]:.0f} cm from the spine's line, in {is_inside.sum()} frames.",
        {"side": side, "distance_m": float(distance[worst]), "frames": int(is_inside.sum())},
        excess=INSIDE_M / max(float(distance[worst]), 0.005),
        worst_frame=worst,
        stretches=stretches_of(is_inside),
    )


def swapped_sides(evidence: Evidence) -> Iterator[Finding]:
    """Beside a reference of the same speech. Without one only a swap of the joints' names shows,
    because then both elbows bend backwards; a whole mirror image is as good a motion as any."""
    if evidence.raw.errors is not None:
        errors = evidence.raw.errors.rotation_error_by_sides_deg
        is_mirrored = errors.mirrored <= errors.swapped
        error = errors.mirrored if is_mirrored else errors.swapped
        if error >= SWAPPED_ERROR_RATIO * errors.as_is:
            return
        how = "as a mirror image" if is_mirrored else "joint by joint"
        yield Finding(
            f"Left and right seem swapped {how}: upper body and hands are"
            f" {errors.as_is:.0f}° from the reference, and {error:.0f}° once swapped"
            " back.",
            {
                "way": "mirrored" if is_mirrored else "swapped",
                "error_deg": errors.as_is,
                "error_swapped_deg": error,
            },
            excess=SWAPPED_ERROR_RATIO * errors.as_is / max(error, 0.1),
        )
        return
    backwards = evidence.raw.ranges.elbow_backwards_share
    share = min(backwards.left, backwards.right)
    if share <= ELBOWS_BACKWARDS:
        return
    yield Finding(
        "Left and right joints seem swapped: both elbows bend backwards in at"
        f" least {100 * share:.0f} % of the frames.",
        {"way": "swapped", "elbow_backwards_share": backwards},
        excess=share / ELBOWS_BACKWARDS,
    )
