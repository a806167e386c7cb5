"""Faults of a motion, named, each with a sentence made from its numbers.

Everything is read from the raw measures of `model.measures.measures`, so that each finding can be
checked
against ``diagnostics.json``. Thresholds leave clean motion alone: beside each stands what the two
recorded BEAT2 clips and procedural clips reach, whole and in stretches of 10 s ("clean").
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from model.measures.results import Measures, as_json
from model.motion.skeleton import JOINT_NAMES
from model.motion.timing import FPS
from model.motion.tracks import point_words

NOISE_DEG = 0.4
"""Of `joint_rotation_noise_deg`; clean: at most 0.26. Noise of 0.01 rad shows as 0.58."""
NAMED_JOINTS = 3
SEAM_CHANCE = 1e-3
"""Of `recurring_jerk`; clean: at least 0.0026 in 3,540 whole clips and stretches of 10 s."""
FOOT_SLIDE_M_S = 0.15
"""Clean: at most 0.10, and 0.07 over a whole clip."""
FINGERS_OUTSIDE = 0.02
"""Of all frames and finger joints; clean: at most 0.005, and 0.001 over a whole clip."""
JOINT_OUTSIDE = 0.2
"""Of the frames of one finger joint; clean: at most 0.01 over a whole clip."""
HAND_STILL = 0.5
"""Of all frames; clean: 0, because living fingers are never still for a thirtieth of a second."""
SWAPPED_ERROR_RATIO = 0.6
"""Error with the sides changed over the error as it is. Motions of the same speech that have
nothing to do with each other give about 1, a swapped copy 0."""
ELBOWS_BACKWARDS = 0.5
"""Of all frames, on both sides; clean: 0."""
STILL_M_S = 1e-3
"""Mean speed of the fastest joint under which nothing moves."""


@dataclass(frozen=True)
class Finding:
    """One fault of a motion."""

    kind: str
    """One of ``still``, ``joint_noise``, ``seams``, ``period``, ``foot_slide``, ``swapped_sides``,
    ``frozen_hand`` and ``finger_range``."""
    sentence: str
    numbers: dict[str, Any]
    """What the sentence was made from, by the keys of ``diagnostics.json``."""

    def as_json(self) -> dict[str, Any]:
        return {"kind": self.kind, **as_json(self.numbers), "sentence": self.sentence}


def find_faults(raw: Measures, point: str) -> list[Finding]:
    """Faults of one motion; none for clean motion.

    Left and right taken for each other are found beside a reference of the same speech. Without
    one only a swap of the joints' names shows, because then both elbows bend backwards; a whole
    mirror image is as good a motion as any.

    Args:
        raw: measures of the unfiltered motion.
        point: what its ``tip_`` measures follow.
    """
    if raw.positions.joint_speed_m_s.max() < STILL_M_S:
        return [Finding("still", "Nothing moves in this motion.", {})]
    searches: tuple[Callable[[], list[Finding]], ...] = (
        lambda: _joint_noise(raw, point),
        lambda: _seams(raw),
        lambda: _period(raw),
        lambda: _foot_slide(raw),
        lambda: _swapped_sides(raw),
        lambda: _frozen_hands(raw),
        lambda: _finger_range(raw),
    )
    return [finding for search in searches for finding in search()]


def _joint_noise(raw: Measures, point: str) -> list[Finding]:
    measured = raw.rotations.joint_rotation_noise_deg.tolist()
    noise = {
        name: value for name, value in zip(JOINT_NAMES, measured, strict=True) if value > NOISE_DEG
    }
    if not noise:
        return []
    worst = sorted(noise, key=lambda name: -noise[name])[:NAMED_JOINTS]
    listed = _listed([f"{point_words(name)} ({noise[name]:.1f}°)" for name in worst])
    if len(noise) > len(worst):
        sentence = f"{len(noise)} of {len(JOINT_NAMES)} joints shake, most of all {listed}."
    else:
        sentence = f"The {listed} {'shakes' if len(noise) == 1 else 'shake'} from frame to frame."
    numbers: dict[str, Any] = {"noise_deg": noise}
    attribution = raw.point.tip_jerk_attribution
    shares = dict(zip(attribution.joints, np.nan_to_num(attribution.share).tolist(), strict=True))
    blamed = max(shares, key=lambda name: shares[name], default=None)
    if blamed in noise and shares[blamed] > 0.1:
        numbers |= {"attributed_joint": blamed, "attributed_share": shares[blamed]}
        sentence += (
            f" Smoothing the {point_words(blamed)} alone takes {shares[blamed]:.0%} of the jerk of"
            f" the {point_words(point)} away."
        )
    return [Finding("joint_noise", sentence, numbers)]


def _seams(raw: Measures) -> list[Finding]:
    found, advance = raw.seams.recurring_jerk, raw.seams.folded_on_frames
    if advance is None or found.chance > SEAM_CHANCE:
        return []
    return [
        Finding(
            "seams",
            f"The body jumps every {advance} frames ({advance / FPS:.2f}"
            f" s), at frame {found.phase_frame} of each window: its jerk there is"
            f" {found.ratio:.1f} times the usual.",
            {
                "window_advance_frames": advance,
                "phase_frame": found.phase_frame,
                "jerk_ratio": found.ratio,
            },
        )
    ]


def _period(raw: Measures) -> list[Finding]:
    """Jerk that comes again after another number of frames than the windows that are known."""
    period, windows = raw.seams.period, raw.seams.folded_on_frames
    if period is None or (windows != period.frames and windows and period.frames % windows == 0):
        return []
    if windows == period.frames and _seams(raw):
        return []
    verb = "jerk" if period.part == "legs" else "jerks"
    if period.kind == "pulses":
        how = f"{period.peak_over_usual:.1f} times the usual at frame {period.phase_frame} of each"
    else:
        how = f"{period.peak_over_least:.1f} times as high at one of them as at another"
    return [
        Finding(
            "period",
            f"The {period.part} {verb} anew every {period.frames} frames"
            f" ({period.frames / FPS:.2f} s): jerk is {how}, {period.periods} times over (by chance"
            f" once in {_one_in(period.chance)} clips).",
            {
                "period_frames": period.frames,
                "part": period.part,
                "phase_frame": period.phase_frame,
                "peak_over_usual": period.peak_over_usual,
                "peak_over_least": period.peak_over_least,
                "chance": period.chance,
            },
        )
    ]


def _one_in(chance: float) -> str:
    number = 1 / max(chance, 1e-300)
    return "over a million" if number > 1e6 else f"{float(f'{number:.1g}'):,.0f}"


def _foot_slide(raw: Measures) -> list[Finding]:
    slide = raw.posture.foot_slide_m_s
    if not slide > FOOT_SLIDE_M_S:
        return []
    return [
        Finding(
            "foot_slide",
            f"Feet on the ground slide at {100 * slide:.0f} cm/s on average; recorded"
            f" clips stay under {100 * FOOT_SLIDE_M_S:.0f} cm/s.",
            {"foot_slide_m_s": slide},
        )
    ]


def _swapped_sides(raw: Measures) -> list[Finding]:
    if raw.errors is not None:
        errors = raw.errors.rotation_error_by_sides_deg
        is_mirrored = errors.mirrored <= errors.swapped
        error = errors.mirrored if is_mirrored else errors.swapped
        if error >= SWAPPED_ERROR_RATIO * errors.as_is:
            return []
        how = "as a mirror image" if is_mirrored else "joint by joint"
        return [
            Finding(
                "swapped_sides",
                f"Left and right seem swapped {how}: upper body and hands are"
                f" {errors.as_is:.0f}° from the reference, and {error:.0f}° once swapped"
                " back.",
                {
                    "way": "mirrored" if is_mirrored else "swapped",
                    "error_deg": errors.as_is,
                    "error_swapped_deg": error,
                },
            )
        ]
    backwards = raw.ranges.elbow_backwards_share
    share = min(backwards.left, backwards.right)
    if share <= ELBOWS_BACKWARDS:
        return []
    return [
        Finding(
            "swapped_sides",
            "Left and right joints seem swapped: both elbows bend backwards in at"
            f" least {share:.0%} of the frames.",
            {"way": "swapped", "elbow_backwards_share": backwards},
        )
    ]


def _frozen_hands(raw: Measures) -> list[Finding]:
    return [
        Finding(
            "frozen_hand",
            f"The fingers of the {side} hand are frozen in {share:.0%} of the frames.",
            {"side": side, "still_share": share},
        )
        for side, share in vars(raw.rotations.fingers_still_share).items()
        if share > HAND_STILL
    ]


def _finger_range(raw: Measures) -> list[Finding]:
    share = raw.ranges.finger_angle_outside_share
    by_joint = raw.ranges.finger_angle_outside_by_joint
    worst = sorted(by_joint, key=lambda name: -by_joint[name])[:NAMED_JOINTS]
    if share <= FINGERS_OUTSIDE and by_joint[worst[0]] <= JOINT_OUTSIDE:
        return []
    listed = _listed(
        [f"{point_words(name)} ({by_joint[name]:.0%})" for name in worst if by_joint[name]]
    )
    return [
        Finding(
            "finger_range",
            f"Fingers bend as no human hand can in {share:.1%} of frames and joints;"
            f" most often the {listed}.",
            {
                "outside_share": share,
                "joints": {name: by_joint[name] for name in worst if by_joint[name]},
            },
        )
    ]


def _listed(items: list[str]) -> str:
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"
