"""Estimates from a draft's motion: axes, units, hand reference, seams of samples, and rate."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from conventions.joints import HANDS, JOINT_INDEX, LEFT_HAND, RIGHT_HAND
from conventions.rates import FPS
from model.formats.motion_draft import MotionDraft, resample_to_30_fps
from model.formats.reading import AXES, METRES, ImportedMotion, Kind, axis_vector
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, remove_lag
from model.motion.tracks import Tracks, track_points
from model.storage.npz import MotionError

_LEFT_RELAXED = (
    *((-0.005, 0.045, -0.209), (0, 0, -0.349), (0, 0, -0.157)),
    *((-0.002, 0.011, -0.297), (0, 0, -0.401), (0, 0, -0.175)),
    *((0.019, -0.11, -0.349), (0, 0, -0.384), (0, 0, -0.175)),
    *((0.008, -0.044, -0.349), (0, 0, -0.419), (0, 0, -0.192)),
    *((0.367, 0.248, -0.131), (0.026, 0.185, -0.073), (0, 0.23, -0.098)),
)
MEAN_HANDS_SUBSTITUTE: Float[np.ndarray, "30 3"] = np.concatenate(
    [np.array(_LEFT_RELAXED), np.array(_LEFT_RELAXED) * (1, -1, -1)]
)
"""Axis-angle (30, 3) of our own relaxed hands, a substitute for the licensed mean hand pose."""
_UNIT = {axis: axis_vector(axis) for axis in AXES}
_UPRIGHT = {
    "y": Rotation.identity(),
    "-y": Rotation.from_euler("x", 180, degrees=True),
    "z": Rotation.from_euler("x", -90, degrees=True),
    "-z": Rotation.from_euler("x", 90, degrees=True),
    "x": Rotation.from_euler("z", 90, degrees=True),
    "-x": Rotation.from_euler("z", -90, degrees=True),
}
"""Rotations of each up axis to y."""
_FORWARD_DEG = {"z": 0, "x": -90, "-z": 180, "-x": 90}
"""Rotations about y of each forward axis to z (degrees)."""
CURL_FLAT, CURL_OFFSET = 0.18, 0.08
"""Mean bend of long fingers (rad) above which hands are relative to the flat hand (recordings .22
and more), and below which they are relative to the mean hand pose."""
MAX_FOOT_SLIDE_M_S = 0.8
"""Median speed of the slower foot that no motion in metres reaches (worst published one: .4)."""
FAR = 20.0
"""Distance from the origin (m) that no recording reaches, but coordinates in centimetres do."""
_MAX_INSPECTED_FRAMES = 1800
"""Number of first frames by which feet are judged."""
LOWEST_FPS, HIGHEST_FPS = 12.0, 240.0
_FILLED_IN = (
    f"; interpolated to {FPS} fps with a cubic spline, so the motion has nothing above %g Hz, and "
    f"its jerk and high frequencies cannot be compared with motion recorded at {FPS} fps"
)
_SAMPLES = range(2, 21)
_JUMP = 2.5


def finish_import(
    draft: MotionDraft, mean_hands: Float[np.ndarray, "30 3"] | None = None
) -> ImportedMotion:
    """Convert a draft to our conventions, with all that was assumed.

    ``mean_hands`` is the mean hand pose of the licensed body, if there is one. Raises MotionError
    for rates that cannot be resampled, and impossible values from the user.
    """
    _split_joined_samples(draft)
    _hands(draft, mean_hands)
    _units(draft)
    _up_and_facing(draft)
    if not LOWEST_FPS <= draft.fps <= HIGHEST_FPS:
        raise MotionError(
            f"{draft.name} has {draft.fps:g} frames per second; the frame rate must be from "
            f"{LOWEST_FPS:g} to {HIGHEST_FPS:g} (if the file states a wrong one, use --assume "
            "rate=N)."
        )
    motion = resample_to_30_fps(draft.motion(), draft.fps)
    if abs(draft.fps - FPS) >= 0.01:
        what = (
            f"; resampled to {FPS} fps" if draft.fps > FPS - 1.0 else _FILLED_IN % (draft.fps / 2)
        )
        draft.assumptions = [
            replace(each, reason=each.reason + what) if each.kind == "rate" else each
            for each in draft.assumptions
        ]
    if draft.fps <= FPS - 1.0:
        draft.missing_parts.add("detail")
    motion = _shift_by_lag(draft, motion)
    by_user = {each.kind for each in draft.assumptions if each.confidence == "user"} | {"frames"}
    for kind in sorted(draft.overrides.keys() - by_user):
        draft.assume(
            cast(Kind, kind),
            draft.overrides[kind],
            "set by you but ignored, because it does not apply to this file",
            "user",
        )
    return ImportedMotion(
        motion, tuple(draft.assumptions), draft.name, frozenset(draft.missing_parts)
    )


def _shift_by_lag(draft: MotionDraft, motion: Motion) -> Motion:
    """Shift the motion by the lag that the user states."""
    override = draft.overrides.get("lag")
    if override is None:
        return motion
    try:
        moved = remove_lag(motion, float(override))
    except (ValueError, OverflowError) as error:
        raise MotionError(f"{draft.name}: --assume lag={override}: {error}") from error
    draft.assume("lag", override, "set by you; the motion was shifted by this many seconds", "user")
    return moved


def _split_joined_samples(draft: MotionDraft) -> None:
    """Detect samples of one clip that were joined, by jumps of the body at equal distances."""
    poses = draft.poses[:, :22].reshape(len(draft.poses), -1)
    jumps = np.linalg.norm(np.diff(poses, axis=0), axis=1)
    for count in reversed(_SAMPLES):
        length = len(poses) // count
        if length * count != len(poses) or length < 8:
            continue
        joins = np.arange(1, count) * length - 1
        rest = np.delete(jumps, joins)
        if jumps[joins].min() > _JUMP * np.percentile(rest, 99) and jumps[joins].min() > 0.1:
            break
    else:
        return
    choice = draft.overrides.get("motion", "all")
    numbers = tuple(str(number) for number in range(1, count + 1))
    reason = f"the body jumps every {length} frames: {count} samples seem to be concatenated"
    if choice in numbers:
        draft.select_frames(slice(length * (int(choice) - 1), length * int(choice)))
        draft.assume(
            "motion", choice, f"set by you, one of {count} samples", "user", (*numbers, "all")
        )
    else:
        draft.assume("motion", "all", reason, "unsure", numbers)


def mean_finger_bend(poses: Float[np.ndarray, "T 55 3"]) -> float:
    """Compute the mean bend of the long fingers (rad), of hands that are not all zero."""
    hands = ((LEFT_HAND, -1.0), (RIGHT_HAND, 1.0))
    bends = [sign * poses[:, list(hand[:12]), 2] for hand, sign in hands if poses[:, hand].any()]
    return float(np.mean(bends)) if bends else 0.0


def _hands(draft: MotionDraft, mean_hands: Float[np.ndarray, "30 3"] | None) -> None:
    """Decide whether hands are relative to the flat hand or the mean hand pose."""
    override = draft.overrides.get("hands")
    hands = draft.poses[:, list(HANDS)]
    if "hands" in draft.missing_parts or (draft.is_metric_y_up and override is None):
        return
    bend, moves = mean_finger_bend(draft.poses), bool(np.abs(hands).max(initial=0.0) > 1e-5)
    thumbs = float(draft.poses[:, [LEFT_HAND[12], RIGHT_HAND[12]], 0].mean())
    if override is not None:
        value, reason, confidence = override, "set by you", "user"
    elif draft.hand_reference_prior == "usually mean":
        is_flat = bend > CURL_FLAT and moves
        value = "flat" if is_flat else "mean"
        confidence = "unsure" if bend > CURL_OFFSET and moves else "likely"
        reason = (
            f"fingers bend by {bend:z.2f} rad, as if relative to the flat hand, although hands in"
            " files of this layout are usually relative to the mean hand pose"
            if is_flat
            else "hands in files of this layout are usually relative to the mean hand pose, and "
            "the bend of the fingers is consistent with it"
        )
    elif draft.hand_reference_prior == "unknown" and moves and bend < CURL_OFFSET and thumbs < 0.05:
        value, confidence = "mean", "unsure"
        reason = (
            f"fingers bend by only {bend:z.2f} rad, too little for hands relative to a flat hand"
        )
    elif not moves:
        draft.missing_parts.add("hands")
        draft.assume(
            "hands", "flat", "the fingers never move", "likely", ("mean",), is_own_convention=True
        )
        return
    else:
        value, confidence = "flat", "sure" if bend > CURL_FLAT else "likely"
        reason = f"fingers bend by {bend:z.2f} rad"
    if value == "mean":
        offset = MEAN_HANDS_SUBSTITUTE if mean_hands is None else mean_hands
        draft.poses = draft.poses.copy()
        draft.poses[:, list(HANDS)] += offset
        if mean_hands is None:
            draft.missing_parts.add("finger_angles")
            reason += (
                "; the relaxed hand pose of this program is used as the mean (--body uses the "
                "licensed mean hand pose)"
            )
    draft.assume(
        "hands",
        value,
        reason,
        confidence,
        ("flat", "mean"),
        is_own_convention=value == "flat" and not override,
    )


def _units(draft: MotionDraft) -> None:
    """Decide the units by the height of the pelvis and the scale at which feet do not slide."""
    if draft.trans is None or draft.is_metric_y_up:
        return
    override = draft.overrides.get("units")
    if override is not None:
        draft.trans = draft.trans * METRES[override]
        draft.assume("units", override, "set by you", "user", tuple(METRES))
        return
    still = MotionDraft(draft.name, {}, draft.poses[:_MAX_INSPECTED_FRAMES]).motion()
    feet = _tracks(still).joints[:, [JOINT_INDEX["left_foot"], JOINT_INDEX["right_foot"]]]
    trans = draft.trans[:_MAX_INSPECTED_FRAMES]

    def slide(scale: float) -> float:
        """Return the median speed of the slower foot (m/s)."""
        if len(trans) < 2:
            return 0.0
        steps = np.linalg.norm(np.diff(feet + scale * trans[:, None], axis=0), axis=-1)
        return float(np.median(steps.min(axis=1)) * draft.fps)

    far = float(np.abs(np.median(trans, axis=0)).max())
    is_still = np.ptp(trans, axis=0).max() < 1e-6
    stands = slide(1.0) < max(MAX_FOOT_SLIDE_M_S, 2 * slide(0.0))  # or its legs alone go as fast
    if far < FAR and (is_still or stands):
        unit, confidence, reason = "m", "sure", "feet do not slide at this scale"
    elif not is_still and stands:
        unit, confidence = "m", "unsure"
        reason = f"the body is {far:.0f} m from the origin, but at this scale feet do not slide"
    else:
        steps = np.linalg.norm(np.diff(trans, axis=0), axis=-1)
        speed = float(np.median(steps) * draft.fps) if len(steps) else 0.0
        odd = {
            unit: _implausibility(METRES[unit] * far, METRES[unit] * speed) for unit in ("cm", "mm")
        }
        unit = min(odd, key=lambda each: odd[each])
        confidence = "likely" if abs(odd["cm"] - odd["mm"]) > 1.0 else "unsure"
        reason = (
            f"in metres the body would be {far:.0f} m from the origin and its feet would slide at "
            f"{slide(1.0):.1f} m/s"
        )
    if unit != "m":
        draft.trans = draft.trans * METRES[unit]
    draft.assume(
        "units", unit, reason, confidence, ("m", "cm", "mm"), unit == "m" and confidence == "sure"
    )


def _implausibility(far_m: float, speed_m_s: float) -> float:
    """Return how implausible a pelvis's distance and speed are for a person."""
    return abs(np.log(max(far_m, 0.3))) + abs(np.log(max(speed_m_s, 1e-4) / 0.08))


def _tracks(motion: Motion) -> Tracks:
    return track_points(motion, open_body_skeleton())


def uprightness(motion: Motion) -> dict[str, float]:
    """Compute how upright a body is along each axis, -1 to 1, by spine, head, shanks and soles."""
    some = motion.part(np.arange(0, motion.num_frames, max(1, motion.num_frames // 100)))
    tracks = _tracks(some)

    def mean_bone(start: str, end: str) -> np.ndarray:
        bone = tracks.joints[:, JOINT_INDEX[end]] - tracks.joints[:, JOINT_INDEX[start]]
        return (bone / np.maximum(np.linalg.norm(bone, axis=-1, keepdims=True), 1e-9)).mean(axis=0)

    spine = mean_bone("pelvis", "neck")
    head = tracks.R_world_joint[:, JOINT_INDEX["head"], :, 1].mean(axis=0)
    shanks = (mean_bone("left_ankle", "left_knee") + mean_bone("right_ankle", "right_knee")) / 2
    feet = tracks.R_world_joint[:, [JOINT_INDEX["left_ankle"], JOINT_INDEX["right_ankle"]], :, 1]
    up = (2 * spine + head + shanks + feet.mean(axis=(0, 1))) / 5
    return {axis: float(up @ unit) for axis, unit in _UNIT.items()}


def _up_and_facing(draft: MotionDraft) -> None:
    if "up" in draft.applied_override_kinds:
        return
    scores = uprightness(draft.motion())
    ranked = sorted(scores, key=lambda axis: -scores[axis])
    best, second = ranked[0], ranked[1]
    up = draft.overrides.get("up", best)
    margin = scores[best] - scores[second]
    if "up" in draft.overrides:
        reason, confidence = "set by you", "user"
    elif draft.is_metric_y_up and best == "y":
        reason, confidence = "the rest pose stands along this axis", "sure"
    else:
        reason = "the body (spine, head, shanks, feet) is upright along this axis"
        reason += "; rotated to y" if up != "y" else ""
        confidence = "unsure" if margin < 0.2 else "likely" if margin < 0.5 else "sure"
    if up != "y":
        _turn(draft, _UPRIGHT[up])
    is_own_convention = up == "y" and confidence in ("sure", "likely")
    if up != "y" or all(each.kind != "up" for each in draft.assumptions):
        draft.assume("up", up, reason, confidence, tuple(ranked), is_own_convention)
    _facing(draft)


def _facing(draft: MotionDraft) -> None:
    tracks = _tracks(
        MotionDraft(draft.name, {}, draft.poses[:: 1 + len(draft.poses) // 600]).motion()
    )
    hips = tracks.joints[:, JOINT_INDEX["left_hip"]] - tracks.joints[:, JOINT_INDEX["right_hip"]]
    ahead = np.cross(hips, (0.0, 1.0, 0.0))[:, [0, 2]]
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
    x, z = ahead.mean(axis=0)
    degrees = float(np.degrees(np.arctan2(x, z)))
    quarter = {0: "z", 90: "x", 180: "-z", -180: "-z", -90: "-x"}[round(degrees / 90) * 90]
    override = draft.overrides.get("facing")
    if override is not None:
        if override in _FORWARD_DEG:
            _turn(draft, Rotation.from_euler("y", _FORWARD_DEG[override], degrees=True))
        draft.assume("facing", override, "set by you", "user", (*_FORWARD_DEG, "as-is"))
    elif abs(degrees) > 60 and np.hypot(x, z) > 0.9 and quarter != "z":
        _turn(draft, Rotation.from_euler("y", _FORWARD_DEG[quarter], degrees=True))
        reason = f"the hips always face {degrees:.0f}° away from z; rotated to z"
        draft.assume("facing", quarter, reason, "likely", (*_FORWARD_DEG, "as-is"))
    elif all(each.kind != "facing" for each in draft.assumptions):
        is_z = quarter == "z" and np.hypot(x, z) > 0.9
        value, reason = (
            ("z", f"the hips face within {abs(degrees):.0f}° of it on average")
            if is_z
            else ("as-is", "the hips face no single direction")
        )
        draft.assume(
            "facing", value, reason, "sure", (*_FORWARD_DEG, "as-is"), is_own_convention=True
        )


def _turn(draft: MotionDraft, turn: Rotation) -> None:
    """Rotate the whole body, and its position (`trans` plus the pelvis's rest position)."""
    draft.poses = draft.poses.copy()
    draft.poses[:, 0] = (turn * Rotation.from_rotvec(draft.poses[:, 0])).as_rotvec()
    rest = open_body_skeleton().rest_joints[0].double().numpy()
    trans = np.zeros((len(draft.poses), 3)) if draft.trans is None else draft.trans
    draft.trans = turn.apply(trans + rest) - rest
