"""Numbers as a test says them; the others are those of a motion of one frame, nearly all NaN."""

from dataclasses import replace
from typing import Any

from model.diagnostics import GLOBALDIFF_WINDOWS, Diagnostics, RawAndFiltered, diagnose
from model.metrics.results import MotionMetrics
from model.motion.kinematics import open_body_skeleton
from tests.helpers import smooth_motion_example

_FRAME = smooth_motion_example(1)
BLANK = diagnose({"a": _FRAME}, open_body_skeleton(), reference=_FRAME).systems["a"].raw


def measured(**numbers: Any) -> MotionMetrics:
    """Measures by their names in ``diagnostics.json``; errors only where one is given."""
    groups: dict[str, Any] = {"errors": None}
    for name, group in vars(BLANK).items():
        own = {key: numbers.pop(key) for key in list(numbers) if hasattr(group, key)}
        if own:
            groups[name] = replace(group, **own)
    assert not numbers
    return replace(BLANK, **groups)


def both(**numbers: Any) -> RawAndFiltered:
    """The same raw and filtered."""
    return RawAndFiltered(measured(**numbers), measured(**numbers))


def diagnostics_of(
    reference: RawAndFiltered | None = None, **systems: RawAndFiltered
) -> Diagnostics:
    return Diagnostics(
        tracked_point="right_middle",
        tracked_point_source="rigid",
        windows=GLOBALDIFF_WINDOWS,
        num_frames={},
        notes=[],
        findings={},
        reference=reference,
        systems=systems,
    )
