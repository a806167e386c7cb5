"""Table of all fault detectors."""

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace

from conventions.joints import FACE, HANDS, JOINT_INDEX, BodyPart
from model.faults import glitches, posture, range_checks
from model.faults.analysis import MEASURED, SEEN, WRONG, Evidence, Finding, by_gravity


@dataclass(frozen=True)
class FaultCheck:
    """A kind of fault with its detector."""

    kind: str
    gravity: int
    search: Callable[[Evidence], Iterable[Finding]]
    """Detector; no findings for clean motion, or if its inputs are missing."""
    needs: str = ""
    """Required input besides the motion: ``reference`` or ``speech``; empty for most."""
    explains: tuple[str, ...] = ()
    """Kinds that follow from this one and are not reported together with it."""
    required_parts: tuple[str, ...] = ()
    """Parts of a motion file (`formats.read.Part`) without any of which it is not used."""


SNAP = "snap"
FAULTS: tuple[FaultCheck, ...] = (
    FaultCheck("identical", WRONG, glitches.identical, "reference", ("copied_face",)),
    FaultCheck("frozen", WRONG, posture.freezes, explains=("copied_frames",)),
    FaultCheck(
        "lying",
        WRONG,
        posture.lying,
        explains=("lifted", "floating", "through_floor", "foot_slide"),
    ),
    FaultCheck("swapped_sides", WRONG, posture.swapped_sides),
    FaultCheck("lifted", WRONG, posture.lifted, "reference", required_parts=("place",)),
    FaultCheck("time_shift", WRONG, glitches.shifted_reference, "reference"),
    FaultCheck("time_shift", WRONG, glitches.shifted_speech, "speech"),
    FaultCheck("pops", SEEN, glitches.pops),
    FaultCheck(SNAP, SEEN, glitches.snaps),
    FaultCheck("rotation_noise", MEASURED, glitches.rotation_noise, required_parts=("detail",)),
    FaultCheck("seams", SEEN, glitches.seams),
    FaultCheck("period", MEASURED, glitches.period, required_parts=("detail",)),
    FaultCheck("copied_frames", SEEN, glitches.copied_frames),
    FaultCheck("skipped_frames", SEEN, glitches.skipped_frames),
    FaultCheck(
        "stretched_rate",
        SEEN,
        glitches.upsampled_rate,
        explains=("period", "copied_frames"),
        required_parts=("detail",),
    ),
    FaultCheck("foot_slide", SEEN, posture.feet_slide, required_parts=("place", "legs")),
    FaultCheck("floating", SEEN, posture.feet_float, required_parts=("place", "legs")),
    FaultCheck("through_floor", SEEN, posture.feet_sink, required_parts=("place", "legs")),
    FaultCheck(
        "still_translation", SEEN, posture.translation_never_changes, required_parts=("place",)
    ),
    FaultCheck("frozen_hand", SEEN, posture.frozen_hands, required_parts=("hands",)),
    FaultCheck(
        "finger_range", SEEN, posture.finger_range, required_parts=("hands", "finger_angles")
    ),
    FaultCheck("hand_in_body", SEEN, posture.hand_penetration),
    FaultCheck("still_face", SEEN, posture.still_face, required_parts=("face",)),
    FaultCheck("copied_face", SEEN, posture.copied_face, "reference", required_parts=("face",)),
    FaultCheck(
        "jerk",
        SEEN,
        range_checks.JERK.search,
        explains=("high_frequency",),
        required_parts=("detail",),
    ),
    FaultCheck(
        "high_frequency", SEEN, range_checks.HIGH_FREQUENCY.search, required_parts=("detail",)
    ),
    FaultCheck("amplitude", MEASURED, range_checks.AMPLITUDE.search),
    FaultCheck("speed", MEASURED, range_checks.SPEED.search),
)
_PARTS: dict[str, BodyPart] = {"legs": "feet", "hands": "hands", "face": "face"}
"""Body part that shows a fault, by the part of a motion file that its detector needs."""
STILL = FaultCheck("still", WRONG, posture.nothing_moves)
"""Detector that runs first: if nothing moves, no other finding is reported."""


def find_faults(evidence: Evidence) -> list[Finding]:
    """Find the faults of one motion, the gravest first; none for clean motion."""
    still = _found(STILL, evidence)
    if still:
        return still
    found = [finding for fault in FAULTS for finding in _found(fault, evidence)]
    kinds = {finding.kind for finding in found}
    explained = {kind for fault in FAULTS if fault.kind in kinds for kind in fault.explains}
    return by_gravity(finding for finding in found if finding.kind not in explained)


def body_part(finding: Finding) -> BodyPart:
    """Return the body part that shows a finding: ``feet``, ``hands`` or ``face``, else empty."""
    joint = finding.numbers.get("joint", "")
    if joint.endswith(("_ankle", "_foot")):
        return "feet"
    if joint.endswith("_wrist") or JOINT_INDEX.get(joint) in HANDS:
        return "hands"
    if JOINT_INDEX.get(joint) in FACE:
        return "face"
    needed = next((fault.required_parts for fault in FAULTS if fault.kind == finding.kind), ())
    return next((_PARTS[part] for part in needed if part in _PARTS), "")


def _found(fault: FaultCheck, evidence: Evidence) -> list[Finding]:
    return [
        replace(finding, kind=fault.kind, gravity=fault.gravity)
        for finding in fault.search(evidence)
    ]


def drop_missing_parts(findings: Iterable[Finding], lacks: Collection[str]) -> list[Finding]:
    """Return the findings without those on parts that the motion file lacks."""
    unsaid = {fault.kind for fault in FAULTS if set(fault.required_parts) & set(lacks)}
    return [finding for finding in findings if finding.kind not in unsaid]
