"""The curves of the jitter sheet, taken out of the numbers of ``diagnostics.json``.

What was not measured, because a clip is too short or nothing moved, is NaN here and a gap in the
plot; a measure that a file does not have at all gives no curve.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from conventions.names import REFERENCE_NAME, Version
from renderer.figures.files import FigureError
from renderer.figures.style import MAX_SYSTEMS, SeriesStyle, styles_of

Curves = dict[str, tuple[np.ndarray, np.ndarray]]
"""Name to x and y, both (N,)."""

_GROUP_ENDS = ("_hip", "_collar", "index1", "middle1", "pinky1", "ring1", "thumb1")
"""A line through the joints begins anew at these: they do not follow on the joint before."""


@dataclass(frozen=True)
class JitterSheet:
    """What one sheet shows, as :func:`read_sheet` returns it."""

    measures: dict[str, Mapping[Version, Mapping[str, Any]]]
    """Name to the numbers as generated and filtered; the reference comes first."""
    joint_names: tuple[str, ...]
    point: str
    window_advance: int
    window_overlap: int

    @property
    def styles(self) -> dict[str, SeriesStyle]:
        return styles_of(self.measures, REFERENCE_NAME)

    def by_depth(self, kind: Version) -> Curves:
        """Bones from the pelvis, and the mean jerk of the joints there in m/s^3."""
        return self._curves(kind, "jerk_by_depth_m_s3")

    def by_phase(self, kind: Version) -> Curves:
        """Frame of the window, or of the period found, and mean jerk in m/s^3."""
        return self._curves(kind, "jerk_by_window_phase_m_s3")

    @property
    def periods(self) -> dict[str, tuple[int, str]]:
        """Where no windows are known: by name the period found, in frames, and the part of the
        body that shows it."""
        if self.window_advance:
            return {}
        found = {name: _of(m, "raw").get("period") for name, m in self.measures.items()}
        return {
            name: (int(period["frames"]), str(period["part"]))
            for name, period in found.items()
            if period
        }

    def by_joint(self, kind: Version) -> Curves:
        """Place in :meth:`joint_order`, and jerk in m/s^3; a gap of NaN wherever a limb ends."""
        order = self.joint_order
        curves = {}
        for name, (_, jerk) in self._curves(kind, "joint_jerk_m_s3").items():
            if len(jerk) == len(order):
                places = np.arange(len(order), dtype=float)
                starts = [place for place in places if self._begins_limb(order[int(place)])]
                at = np.searchsorted(places, starts)
                curves[name] = (
                    np.insert(places, at, np.nan),
                    np.insert(jerk[list(order)], at, np.nan),
                )
        return curves

    @property
    def joint_order(self) -> tuple[int, ...]:
        """The joints limb by limb: trunk and head, left leg, right leg, left arm, right arm."""
        return tuple(sorted(range(len(self.joint_names)), key=lambda j: _limb(self.joint_names[j])))

    def _begins_limb(self, joint: int) -> bool:
        return self.joint_names[joint].endswith(_GROUP_ENDS)

    def spectrum(self, kind: Version) -> Curves:
        """Frequency in Hz, and share of the point's velocity power in each bin in percent."""
        found = {}
        for name, measures in self.measures.items():
            spectrum = _of(measures, kind).get("tip_spectrum") or {}
            if spectrum.get("velocity_power") and spectrum.get("frequency_hz"):
                power = 100.0 * _array(spectrum["velocity_power"])
                found[name] = (_array(spectrum["frequency_hz"]), power)
        return _with_numbers(found)

    def attribution(self, kind: Version) -> Curves:
        """Place in :attr:`chain`, and relative drop of the point's jerk in percent."""
        found = {}
        for name, measures in self.measures.items():
            attribution = _of(measures, kind).get("tip_jerk_attribution") or {}
            joints = attribution.get("joints") or ()
            share: dict[str, float | None] = {}
            share.update(zip(joints, attribution.get("share") or (), strict=False))
            if share:
                drop = 100.0 * _array([share.get(joint) for joint in self.chain])
                found[name] = (np.arange(len(self.chain), dtype=float), drop)
        return _with_numbers(found)

    @property
    def chain(self) -> tuple[str, ...]:
        """The joints from the pelvis to the followed point; empty where no motion names them."""
        for measures in self.measures.values():
            for kind in ("raw", "savgol"):
                joints = (_of(measures, kind).get("tip_jerk_attribution") or {}).get("joints")
                if joints:
                    return tuple(joints)
        return ()

    def _curves(self, kind: Version, measure: str) -> Curves:
        values = {name: _of(m, kind).get(measure) for name, m in self.measures.items()}
        arrays = {name: _array(value) for name, value in values.items() if value}
        return _with_numbers(
            {name: (np.arange(len(y), dtype=float), y) for name, y in arrays.items()}
        )


def read_sheet(
    diagnostics: Mapping[str, Any], names: Sequence[str] | None = None, point: str = ""
) -> JitterSheet:
    """The numbers of some systems, and of the reference where there is one.

    Args:
        diagnostics: the content of a ``diagnostics.json``.
        names: systems to show; by default the first six.
        point: the followed point, for the titles; by default its name in the file.

    Raises:
        FigureError: if there are no systems or too many, or one of the names is none of them.
    """
    systems = diagnostics["systems"]
    names = list(systems)[:MAX_SYSTEMS] if names is None else list(names)
    if not 1 <= len(names) <= MAX_SYSTEMS:
        raise FigureError(f"The jitter sheet holds 1 to {MAX_SYSTEMS} systems; got {len(names)}.")
    unknown = [name for name in names if name not in systems]
    if unknown:
        raise FigureError(
            f"There are no numbers of {unknown[0]!r}; there are {', '.join(systems)}."
        )
    reference = diagnostics.get("reference")
    measures = {REFERENCE_NAME: reference} if reference else {}
    return JitterSheet(
        measures={**measures, **{name: systems[name] for name in names}},
        joint_names=tuple(diagnostics.get("joint_names") or ()),
        point=point or str(diagnostics.get("joint") or diagnostics.get("tip") or "followed point"),
        window_advance=int(diagnostics.get("window_advance_frames") or 0),
        window_overlap=int(diagnostics.get("window_overlap_frames") or 0),
    )


def _of(measures: Mapping[Version, Mapping[str, Any]], kind: Version) -> Mapping[str, Any]:
    return measures.get(kind) or {}


def _array(values: Sequence[float | None]) -> Float[np.ndarray, " N"]:
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def _with_numbers(curves: Curves) -> Curves:
    return {name: (x, y) for name, (x, y) in curves.items() if np.isfinite(y).any()}


def _limb(joint_name: str) -> tuple[int, int]:
    side, _, part = joint_name.partition("_")
    if side not in ("left", "right") or part.startswith("eye"):
        return 0, 0
    is_leg = part in ("hip", "knee", "ankle", "foot")
    return 1 if is_leg else 2, 0 if side == "left" else 1
