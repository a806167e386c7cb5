"""Table of all fault detectors."""

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace

from conventions.joints import FACE, HANDS, JOINT_INDEX, BodyPart
from model.faults import analysis, glitches, posture, range_checks
from model.faults.analysis import IMPOSSIBLE, MEASURABLE, VISIBLE, AnalysedMotion, Finding


@dataclass(frozen=True)
class FaultCheck:
    """A kind of fault with its detector."""

    kind: str
    severity: int
    detect: Callable[[AnalysedMotion], Iterable[Finding]]
    """Detector; no findings for clean motion, or if its inputs are missing."""
    required_input: str = ""
    """Required input besides the motion: ``reference`` or ``speech``; empty for most."""
    implies_kinds: tuple[str, ...] = ()
    """Kinds that follow from this one and are not reported together with it."""
    required_parts: tuple[str, ...] = ()
    """Parts of a motion file (`formats.read.Part`) without any of which it is not used."""


SNAP = "snap"
FAULTS: tuple[FaultCheck, ...] = (
    FaultCheck(
        "identical", IMPOSSIBLE, glitches.identical_to_reference, "reference", ("copied_face",)
    ),
    FaultCheck("frozen", IMPOSSIBLE, posture.frozen_upper_body, implies_kinds=("copied_frames",)),
    FaultCheck(
        "lying",
        IMPOSSIBLE,
        posture.lying_body,
        implies_kinds=("lifted", "floating", "through_floor", "foot_slide"),
    ),
    FaultCheck("swapped_sides", IMPOSSIBLE, posture.swapped_sides),
    FaultCheck(
        "lifted",
        IMPOSSIBLE,
        posture.height_offset_to_reference,
        "reference",
        required_parts=("place",),
    ),
    FaultCheck("time_shift", IMPOSSIBLE, glitches.shifted_copy_of_reference, "reference"),
    FaultCheck("time_shift", IMPOSSIBLE, glitches.speech_lag_or_drift, "speech"),
    FaultCheck("pops", VISIBLE, glitches.single_frame_pops),
    FaultCheck(SNAP, VISIBLE, glitches.joint_snaps),
    FaultCheck("rotation_noise", MEASURABLE, glitches.rotation_noise, required_parts=("detail",)),
    FaultCheck("seams", VISIBLE, glitches.window_seams),
    FaultCheck("period", MEASURABLE, glitches.other_periodic_jerk, required_parts=("detail",)),
    FaultCheck("copied_frames", VISIBLE, glitches.duplicate_frames),
    FaultCheck("skipped_frames", VISIBLE, glitches.skipped_frames),
    FaultCheck(
        "stretched_rate",
        VISIBLE,
        glitches.upsampled_rate,
        implies_kinds=("period", "copied_frames"),
        required_parts=("detail",),
    ),
    FaultCheck("foot_slide", VISIBLE, posture.feet_slide, required_parts=("place", "legs")),
    FaultCheck("floating", VISIBLE, posture.feet_float, required_parts=("place", "legs")),
    FaultCheck("through_floor", VISIBLE, posture.feet_sink, required_parts=("place", "legs")),
    FaultCheck(
        "still_translation", VISIBLE, posture.translation_never_changes, required_parts=("place",)
    ),
    FaultCheck("frozen_hand", VISIBLE, posture.frozen_hands, required_parts=("hands",)),
    FaultCheck(
        "finger_range",
        VISIBLE,
        posture.finger_joint_limits,
        required_parts=("hands", "finger_angles"),
    ),
    FaultCheck("hand_in_body", VISIBLE, posture.hand_penetration),
    FaultCheck("still_face", VISIBLE, posture.still_face, required_parts=("face",)),
    FaultCheck("copied_face", VISIBLE, posture.copied_face, "reference", required_parts=("face",)),
    FaultCheck(
        "jerk",
        VISIBLE,
        range_checks.JERK.detect,
        implies_kinds=("high_frequency",),
        required_parts=("detail",),
    ),
    FaultCheck(
        "high_frequency", VISIBLE, range_checks.HIGH_FREQUENCY.detect, required_parts=("detail",)
    ),
    FaultCheck("amplitude", MEASURABLE, range_checks.AMPLITUDE.detect),
    FaultCheck("speed", MEASURABLE, range_checks.SPEED.detect),
)
_PARTS: dict[str, BodyPart] = {"legs": "feet", "hands": "hands", "face": "face"}
"""Body part that shows a fault, by the part of a motion file that its detector needs."""
STILL = FaultCheck("still", IMPOSSIBLE, posture.still_motion)
"""Detector that runs first: if nothing moves, no other finding is reported."""


def find_faults(analysed: AnalysedMotion) -> list[Finding]:
    """Find the faults of one motion, the gravest first; none for clean motion."""
    still = _search_fault(STILL, analysed)
    if still:
        return still
    findings = [finding for fault in FAULTS for finding in _search_fault(fault, analysed)]
    kinds = {finding.kind for finding in findings}
    explained = {kind for fault in FAULTS if fault.kind in kinds for kind in fault.implies_kinds}
    return analysis.most_serious_first(
        finding for finding in findings if finding.kind not in explained
    )


def body_part(finding: Finding) -> BodyPart:
    """Return the body part that shows a finding: ``feet``, ``hands`` or ``face``, else empty."""
    joint = finding.numbers.get("joint", "")
    if joint.endswith(("_ankle", "_foot")):
        return "feet"
    is_of_fingertips = finding.kind == "jerk"
    if is_of_fingertips or joint.endswith("_wrist") or JOINT_INDEX.get(joint) in HANDS:
        return "hands"
    if JOINT_INDEX.get(joint) in FACE:
        return "face"
    needed = next((fault.required_parts for fault in FAULTS if fault.kind == finding.kind), ())
    parts: list[BodyPart] = [_PARTS[part] for part in needed if part in _PARTS]
    return parts[0] if parts else ""


def _search_fault(fault: FaultCheck, analysed: AnalysedMotion) -> list[Finding]:
    return [
        replace(finding, kind=fault.kind, severity=fault.severity)
        for finding in fault.detect(analysed)
    ]


def drop_findings_on_missing_parts(
    findings: Iterable[Finding], missing_parts: Collection[str]
) -> list[Finding]:
    """Return the findings without those on parts that the motion file lacks."""
    unsaid = {fault.kind for fault in FAULTS if set(fault.required_parts) & set(missing_parts)}
    return [finding for finding in findings if finding.kind not in unsaid]
