"""How the body stands: up, on the floor, with feet that hold."""

import numpy as np

from model.faults.evidence import Evidence
from model.faults.finding import Finding, clock, most_in_a_second, stretches_of
from model.measures.posture import FEET, FLOATING_M, SINKING_M
from model.measures.smoothness import derivative_magnitudes

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


def lying(evidence: Evidence) -> list[Finding]:
    tilt = evidence.raw.posture.spine_tilt_deg
    if not tilt.mean > LYING_DEG:
        return []
    return [
        Finding(
            "lying",
            f"The spine is tilted by {tilt.mean:.0f}° on average: the body lies, or the file's up"
            " is not y (z-up files are about 90° off).",
            {"spine_tilt_deg": tilt.mean},
            excess=tilt.mean / LYING_DEG,
        )
    ]


def lifted(evidence: Evidence) -> list[Finding]:
    """The usual height of the lower foot beside the reference's."""
    if evidence.reference is None:
        return []
    apart = evidence.floor_m - evidence.reference.floor_m
    if abs(apart) <= LIFT_M:
        return []
    where = "above" if apart > 0 else "below"
    return [
        Finding(
            "lifted",
            f"The feet stand {100 * abs(apart):.0f} cm {where} the reference's; recorded clips of"
            " one speaker agree to a centimetre.",
            {"height_m": apart},
            excess=abs(apart) / LIFT_M,
        )
    ]


def feet_slide(evidence: Evidence) -> list[Finding]:
    slide = evidence.raw.posture.foot_slide_m_s
    if not slide > FOOT_SLIDE_M_S:
        return []
    feet = evidence.tracks.joints[:, list(FEET)] * (1.0, 0.0, 1.0)
    contact = evidence.raw.posture.foot_contact_share
    few = f" (on the ground in {contact:.0%} of the frames only)" if contact < CONTACT_SHARE else ""
    return [
        Finding(
            "foot_slide",
            f"Feet on the ground slide at {100 * slide:.0f} cm/s on average{few}; recorded"
            f" clips stay under {100 * FOOT_SLIDE_M_S:.0f} cm/s.",
            {"foot_slide_m_s": slide, "contact_share": contact},
            excess=slide / FOOT_SLIDE_M_S,
            worst_frame=most_in_a_second(derivative_magnitudes(feet, 1).mean(axis=1)),
        )
    ]


def feet_float(evidence: Evidence) -> list[Finding]:
    """Both feet in the air, over the height at which the lower one usually is."""
    above = evidence.lower_foot_m - evidence.floor_m
    contact = evidence.raw.posture.foot_contact_share
    runs = [r for r in stretches_of(above > FLOATING_M) if r[1] - r[0] + 1 >= FLOATING_FRAMES]
    if not runs and contact >= CONTACT_SHARE:
        return []
    worst = int(above.argmax())
    found = (
        f"Both feet leave the floor by up to {100 * above[worst]:.0f} cm, at {clock(worst)}"
        if runs
        else "The feet hardly ever keep to one floor"
    )
    return [
        Finding(
            "floating",
            f"{found}; a foot is on the ground in {contact:.0%} of the frames, in recorded clips"
            " in 97% and more.",
            {
                "height_m": float(above[worst]),
                "contact_share": contact,
                "floating_share": evidence.raw.posture.foot_floating_share,
            },
            excess=max(float(above[worst]) / FLOATING_M, CONTACT_SHARE / max(contact, 0.01)),
            worst_frame=worst,
            stretches=tuple(runs),
        )
    ]


def feet_sink(evidence: Evidence) -> list[Finding]:
    below = evidence.floor_m - evidence.lower_foot_m
    is_below = below > SINKING_M
    if is_below.sum() < SINKING_FRAMES:
        return []
    worst = int(below.argmax())
    share = float(np.mean(is_below))
    return [
        Finding(
            "through_floor",
            f"A foot goes {100 * below[worst]:.0f} cm through the floor at {clock(worst)}, and"
            f" deeper than {100 * SINKING_M:.0f} cm in {share:.1%} of the frames (the floor is"
            " where the lower foot usually stands).",
            {"depth_m": float(below[worst]), "share": share},
            excess=float(below[worst]) / SINKING_M,
            worst_frame=worst,
            stretches=stretches_of(is_below),
        )
    ]
