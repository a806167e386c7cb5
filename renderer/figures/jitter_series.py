"""What the jitter sheet shows of each motion, and the curves made of it.

What was not measured, because a clip is too short or nothing moved, is NaN and a gap in the plot; a
motion of which nothing was measured has no curve.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from conventions.joints import JOINT_NAMES
from conventions.names import REFERENCE_NAME, Version
from renderer.figures.files import FigureError
from renderer.figures.style import MAX_SYSTEMS, SeriesStyle, styles_of

Curves = dict[str, tuple[np.ndarray, np.ndarray]]
"""Name to x and y, both (N,)."""

_GROUP_ENDS = ("_hip", "_collar", "index1", "middle1", "pinky1", "ring1", "thumb1")
"""A line through the joints begins anew at these: they do not follow on the joint before."""


@dataclass(frozen=True)
class Jitter:
    """Of one motion, as generated or filtered."""

    by_depth: Float[np.ndarray, " depths"]
    """Mean jerk of the joints so many bones from the pelvis, m/s^3."""
    by_joint: Float[np.ndarray, " 55"]
    """Jerk of each of the 55 joints, m/s^3."""
    spectrum: tuple[Float[np.ndarray, " bins"], Float[np.ndarray, " bins"]] | None
    """Frequencies in Hz, and the share of the followed point's velocity power at each."""
    chain: tuple[str, ...]
    """The joints from the pelvis to the followed point."""
    chain_drop: Float[np.ndarray, " chain"]
    """Of the point's jerk when that joint alone is smoothed; 1 is all of it."""
    by_phase: Float[np.ndarray, " frames"]
    """Mean jerk in m/s^3 for each frame of the window, or of the period found; empty without."""
    period: tuple[int, str] | None
    """Frames after which jerk comes again, and the part of the body that shows it."""


@dataclass(frozen=True)
class JitterSheet:
    """What one sheet shows.

    Raises:
        FigureError: if there are no systems or too many.
    """

    jitter: Mapping[str, Mapping[Version, Jitter]]
    """By name; the reference comes first where there is one."""
    point: str = "followed point"
    window_advance: int = 0
    """0 where windows are not known."""
    window_overlap: int = 0

    def __post_init__(self) -> None:
        num = len([name for name in self.jitter if name != REFERENCE_NAME])
        if not 1 <= num <= MAX_SYSTEMS:
            raise FigureError(f"The jitter sheet holds 1 to {MAX_SYSTEMS} systems; got {num}.")

    @property
    def styles(self) -> dict[str, SeriesStyle]:
        return styles_of(self.jitter, REFERENCE_NAME)

    def by_depth(self, kind: Version) -> Curves:
        """Bones from the pelvis, and the mean jerk of the joints there in m/s^3."""
        return _curves({name: each.by_depth for name, each in self._of(kind).items()})

    def by_phase(self, kind: Version) -> Curves:
        """Frame of the window, or of the period found, and mean jerk in m/s^3."""
        return _curves({name: each.by_phase for name, each in self._of(kind).items()})

    @property
    def periods(self) -> dict[str, tuple[int, str]]:
        """Where no windows are known: by name the period found, in frames, and the part of the
        body that shows it."""
        if self.window_advance:
            return {}
        return {name: each.period for name, each in self._of("raw").items() if each.period}

    def by_joint(self, kind: Version) -> Curves:
        """Place in `JOINT_ORDER`, and jerk in m/s^3; a gap of NaN wherever a limb ends."""
        places = np.arange(len(JOINT_ORDER), dtype=float)
        starts = [k for k, j in enumerate(JOINT_ORDER) if JOINT_NAMES[j].endswith(_GROUP_ENDS)]
        x = np.insert(places, starts, np.nan)
        return _with_numbers(
            {
                name: (x, np.insert(each.by_joint[list(JOINT_ORDER)], starts, np.nan))
                for name, each in self._of(kind).items()
            }
        )

    def spectrum(self, kind: Version) -> Curves:
        """Frequency in Hz, and share of the point's velocity power in each bin in percent."""
        spectra = {name: each.spectrum for name, each in self._of(kind).items()}
        return _with_numbers(
            {name: (found[0], 100.0 * found[1]) for name, found in spectra.items() if found}
        )

    def attribution(self, kind: Version) -> Curves:
        """Place in :attr:`chain`, and relative drop of the point's jerk in percent."""
        found = self._of(kind).items()
        return _curves({name: 100.0 * each.chain_drop for name, each in found})

    @property
    def chain(self) -> tuple[str, ...]:
        """The joints from the pelvis to the followed point."""
        return next((each.chain for each in self._of("raw").values() if each.chain), ())

    def _of(self, kind: Version) -> dict[str, Jitter]:
        return {name: versions[kind] for name, versions in self.jitter.items()}


def _curves(values: Mapping[str, np.ndarray]) -> Curves:
    return _with_numbers({name: (np.arange(len(y), dtype=float), y) for name, y in values.items()})


def _with_numbers(curves: Curves) -> Curves:
    return {name: (x, y) for name, (x, y) in curves.items() if np.isfinite(y).any()}


def _limb(joint_name: str) -> tuple[int, int]:
    side, _, part = joint_name.partition("_")
    if side not in ("left", "right") or part.startswith("eye"):
        return 0, 0
    is_leg = part in ("hip", "knee", "ankle", "foot")
    return 1 if is_leg else 2, 0 if side == "left" else 1


JOINT_ORDER = tuple(sorted(range(len(JOINT_NAMES)), key=lambda j: _limb(JOINT_NAMES[j])))
"""The joints limb by limb: trunk and head, left leg, right leg, left arm, right arm."""
