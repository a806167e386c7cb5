"""Table of all fault detectors."""

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace

from model.faults import glitches, posture, range_checks
from model.faults.analysis import MEASURED, SEEN, WRONG, Evidence, Finding, by_gravity


@dataclass(frozen=True)
class Fault:
    """A kind of fault with its detector."""

    kind: str
    gravity: int
    search: Callable[[Evidence], Iterable[Finding]]
    """Detector; no findings for clean motion, or if its inputs are missing."""
    needs: str = ""
    """Required input besides the motion: ``reference`` or ``speech``; empty for most."""
    explains: tuple[str, ...] = ()
    """Kinds that follow from this one and are not reported together with it."""
    of: tuple[str, ...] = ()
    """Parts of a motion file (`formats.read.Part`) without any of which it is not used."""


SNAP = "snap"
FAULTS: tuple[Fault, ...] = (
    Fault("identical", WRONG, glitches.identical, "reference", ("copied_face",)),
    Fault("frozen", WRONG, posture.freezes, explains=("copied_frames",)),
    Fault(
        "lying",
        WRONG,
        posture.lying,
        explains=("lifted", "floating", "through_floor", "foot_slide"),
    ),
    Fault("swapped_sides", WRONG, posture.swapped_sides),
    Fault("lifted", WRONG, posture.lifted, "reference", of=("place",)),
    Fault("time_shift", WRONG, glitches.shifted_reference, "reference"),
    Fault("time_shift", WRONG, glitches.shifted_speech, "speech"),
    Fault("pops", SEEN, glitches.pops),
    Fault(SNAP, SEEN, glitches.snaps),
    Fault("rotation_noise", MEASURED, glitches.rotation_noise, of=("detail",)),
    Fault("seams", SEEN, glitches.seams),
    Fault("period", MEASURED, glitches.period, of=("detail",)),
    Fault("copied_frames", SEEN, glitches.copied_frames),
    Fault("skipped_frames", SEEN, glitches.skipped_frames),
    Fault(
        "stretched_rate",
        SEEN,
        glitches.stretched_rate,
        explains=("period", "copied_frames"),
        of=("detail",),
    ),
    Fault("foot_slide", SEEN, posture.feet_slide, of=("place", "legs")),
    Fault("floating", SEEN, posture.feet_float, of=("place", "legs")),
    Fault("through_floor", SEEN, posture.feet_sink, of=("place", "legs")),
    Fault("still_translation", SEEN, posture.translation_never_changes, of=("place",)),
    Fault("frozen_hand", SEEN, posture.frozen_hands, of=("hands",)),
    Fault("finger_range", SEEN, posture.finger_range, of=("hands", "finger_angles")),
    Fault("hand_in_body", SEEN, posture.hand_in_body),
    Fault("still_face", SEEN, posture.still_face, of=("face",)),
    Fault("copied_face", SEEN, posture.copied_face, "reference", of=("face",)),
    Fault("jerk", SEEN, range_checks.JERK.search, explains=("high_frequency",), of=("detail",)),
    Fault("high_frequency", SEEN, range_checks.HIGH_FREQUENCY.search, of=("detail",)),
    Fault("amplitude", MEASURED, range_checks.AMPLITUDE.search),
    Fault("speed", MEASURED, range_checks.SPEED.search),
)
STILL = Fault("still", WRONG, posture.nothing_moves)
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


def _found(fault: Fault, evidence: Evidence) -> list[Finding]:
    return [
        replace(finding, kind=fault.kind, gravity=fault.gravity)
        for finding in fault.search(evidence)
    ]


def without(findings: Iterable[Finding], lacks: Collection[str]) -> list[Finding]:
    """Return the findings without those on parts that the motion file lacks."""
    unsaid = {fault.kind for fault in FAULTS if set(fault.of) & set(lacks)}
    return [finding for finding in findings if finding.kind not in unsaid]
