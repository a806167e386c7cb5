"""Published protocols of sets of clips, and how much the protocol alone changes a number.

The sums of each clip are stored next to its record; those of sets and of bootstrap draws are added
from them. With expected values, the sums are stored once more for each variation of the rule: other
pieces, frame rate and skeleton, and no translation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from app.findings.metric_table import format_three_digits
from conventions.names import REFERENCE_NAME
from model.evaluation.tables import bootstrap_indices, percentile_interval
from model.metrics.protocols.clip import Clip, ProtocolInputs, Sums
from model.metrics.protocols.formulas import FORMULAS
from model.metrics.protocols.table import PROTOCOLS
from model.motion.kinematics import RestSkeleton, open_body_skeleton
from model.motion.motion import Motion, first_frames
from model.motion.tracks import track_points
from model.storage.escaping import escape_markdown
from model.storage.files import written_atomically

DRAWS = 200
PLAIN = ""
"""Variation that is none."""
PIECE_FRAMES, TALLER = 300, 1.1
Expected = tuple[tuple[str, float], ...]
"""Names of metrics or protocols with the values that a paper reports."""


def _at_15_fps(motion: Motion) -> Motion:
    """Return a motion of which every second frame is the mean of its neighbours."""
    arrays = {}
    for name in ("poses", "trans", "expressions"):
        values = getattr(motion, name).copy()
        values[1:-1:2] = (values[:-2:2] + values[2::2])[: len(values[1:-1:2])] / 2
        arrays[name] = values
    return replace(motion, **arrays)


@dataclass(frozen=True)
class ProtocolVariation:
    """Change of the rule of which the effect is measured."""

    transform: Callable[[Motion], Motion] = lambda motion: motion
    skeleton_scale: float = 1.0
    """Size of the skeleton."""


PROTOCOL_VARIATIONS: Mapping[str, ProtocolVariation] = {
    PLAIN: ProtocolVariation(),
    "first 10 s of each clip": ProtocolVariation(lambda motion: first_frames(motion, PIECE_FRAMES)),
    "sampled at 15 frames per second": ProtocolVariation(_at_15_fps),
    "without translation": ProtocolVariation(
        lambda motion: replace(motion, trans=np.zeros_like(motion.trans))
    ),
    "skeleton 10 % larger": ProtocolVariation(skeleton_scale=TALLER),
}


def _pairs_of(name: str) -> list[tuple[str, str]]:
    """Return the ids and values that a name of a metric stands for."""
    return [
        (record.id, value)
        for record in PROTOCOLS.values()
        if name in record.metric_names
        for value in record.value_units or ()
        if name == value or len(record.value_units or ()) == 1
    ]


def apply_variation(motion: Motion, name: str) -> tuple[Motion, RestSkeleton]:
    """Return the motion and the skeleton of a variation."""
    bones, scale = open_body_skeleton(), PROTOCOL_VARIATIONS[name].skeleton_scale
    skeleton = RestSkeleton(bones.rest_joints * scale, bones.tip_offsets * scale)
    return PROTOCOL_VARIATIONS[name].transform(motion), skeleton


def make_varied_clip(
    motion: Motion, inputs: ProtocolInputs, variation: str, recorded: Clip | None = None
) -> Clip:
    """Make the clip of a motion under a variation of the rule, as ``recorded`` is."""
    here, skeleton = apply_variation(motion, variation)
    return inputs.make_clip(here, track_points(here, skeleton), recorded)


def sums_path(record_path: Path) -> Path:
    """Return the path of a clip's sums, next to its record."""
    return record_path.with_suffix(".sums.npz")


def save_sums(record_path: Path, sums: Mapping[tuple[str, str], Mapping[str, Sums]]) -> None:
    """Write the sums of one clip by system and variation, atomically next to its record."""
    arrays: dict[str, Any] = {
        "|".join((variation, protocol, key, system)): value
        for (system, variation), by_protocol in sums.items()
        for protocol, each in by_protocol.items()
        for key, value in each.items()
    }
    with written_atomically(sums_path(record_path)) as part:
        np.savez(part, **arrays)


def mean_sums(samples: Sequence[Mapping[str, Sums]]) -> dict[str, Sums]:
    """Average the sums of the samples of one clip, of the protocols that all have."""
    shared = set.intersection(*(set(each) for each in samples))
    return {
        name: {
            key: np.mean([each[name][key] for each in samples], axis=0) for key in samples[0][name]
        }
        for name in samples[0]
        if name in shared
    }


class PublishedMetrics:
    """Values of all published protocols over sets of clips, with their bootstrap draws."""

    def __init__(self, records: Sequence[Path]) -> None:
        count = len(records)
        drawn = [np.bincount(each, minlength=count) for each in bootstrap_indices(count, DRAWS)]
        self._draws = np.array([np.ones(count), *drawn])
        # Sums by variation, protocol, system and key, and the clips that have them.
        self._sums: dict[tuple[str, str, str], dict[str, Any]] = {}
        self.clips: dict[tuple[str, str, str], int] = {}
        for place, record in enumerate(records):
            with np.load(sums_path(record), allow_pickle=False) as file:
                for name in file.files:
                    variation, protocol, key, system = name.split("|", 3)
                    where = variation, protocol, system
                    drawn = np.multiply.outer(self._draws[:, place], file[name])
                    sums = self._sums.setdefault(where, {})
                    sums[key] = sums.get(key, 0.0) + drawn
                    self.clips[where] = self.clips.get(where, 0) + (key == next(iter(sums)))

    def value_and_draws(
        self, protocol: str, system: str, variation: str = PLAIN
    ) -> dict[str, np.ndarray]:
        """Return arrays by name: the value of all clips, then those of the draws, NaN if empty."""
        draws = [self._evaluate(protocol, system, variation, k) for k in range(len(self._draws))]
        return {key: np.array([each.get(key, np.nan) for each in draws]) for key in draws[0]}

    def values(self, protocol: str, system: str, variation: str) -> dict[str, float]:
        """Return the value of all clips by name."""
        return self._evaluate(protocol, system, variation, 0)

    def _evaluate(self, protocol: str, system: str, variation: str, draw: int) -> dict[str, float]:
        sums = self._sums.get((variation, protocol, system))
        if sums is None:
            return {}
        return FORMULAS[protocol].evaluate({key: each[draw] for key, each in sums.items()})

    def rows(self, systems: Sequence[str]) -> Iterator[tuple[Any, ...]]:
        """Yield table rows (`app.run.batch.table.HEADER`) of values and paired differences."""
        for protocol, record in PROTOCOLS.items():
            if record.is_own_metric:
                continue
            values = {name: self.value_and_draws(protocol, name) for name in systems}
            for key, unit in (record.value_units or {}).items():
                values_of_metric = {name: each[key] for name, each in values.items() if key in each}
                clips = {name: self.clips[PLAIN, protocol, name] for name in values_of_metric}
                yield from interval_rows(
                    (f"{protocol}/{key}", unit), values_of_metric, clips, protocol
                )


def interval_rows(
    head: tuple[str, str],
    values: Mapping[str, Float[np.ndarray, " draws"]],
    clips: Mapping[str, int],
    protocol: str,
) -> Iterator[tuple[Any, ...]]:
    """Yield table rows (`app.run.batch.table.HEADER`) of systems and of their differences.

    ``values`` has by system the value of all clips, and those of the bootstrap draws.
    """
    names = list(values)
    for place, name in enumerate(names):
        own = (*head, name, clips[name])
        yield (*own, *_interval(values[name]), *[""] * 4, protocol)
        for other in names[place + 1 :]:
            apart = _interval(values[name] - values[other])
            yield (*own, "", "", "", other, *apart, protocol)


def _interval(values: Float[np.ndarray, " draws"]) -> tuple[float, float, float]:
    drawn = values[1:][~np.isnan(values[1:])]
    limits = percentile_interval(values[0], drawn if len(drawn) else values[:1])
    return limits.mean, limits.low, limits.high


def protocol_comparison_lines(
    systems: Sequence[str], values: Mapping[tuple[str, str, str, str], float], expected: Expected
) -> list[str]:
    """Format how much the protocol alone changes the metrics that several protocols measured.

    Args:
        values: values by system, protocol, name and variation.
        expected: values in papers; their metrics are also listed if only one protocol has them.

    Returns:
        Lines of Markdown; none if there is nothing to compare.
    """
    rows: list[tuple[str, ...]] = []
    groups = {name: _pairs_of(name) for name, _ in expected}
    for record in PROTOCOLS.values():
        family = record.id.partition("/")[0]
        if family in record.metric_names:
            groups.setdefault(family, _pairs_of(family))
    for name, pairs in groups.items():
        reported = dict(expected).get(name)
        shown = PROTOCOL_VARIATIONS if reported is not None else (PLAIN,)
        for system in systems:
            own = [
                (protocol, variation, values[system, protocol, key, variation])
                for protocol, key in pairs
                for variation in shown
                if (system, protocol, key, variation) in values
            ]
            if system == REFERENCE_NAME or (reported is None and len(own) < 2):
                continue
            plain = {protocol: value for protocol, variation, value in own if variation == PLAIN}
            first = next(iter(plain.values()))
            for place, (protocol, variation, value) in enumerate(own):
                change = value - (first if variation == PLAIN else plain[protocol])
                change_text = f"{change:+.3g}" if abs(change) > 1e-9 * abs(value) else "0"
                gap = ["" if reported is None else f"{value - reported:+.3g}"] if expected else []
                rule = protocol if variation == PLAIN else f"{protocol}, {variation}"
                cells = (
                    name,
                    escape_markdown(system),
                    rule,
                    format_three_digits(value),
                    change_text if place else "",
                    *gap,
                )
                rows.append(cells)
    if not rows:
        return []
    head = ["metric", "system", "protocol", "value", "change"]
    head += ["difference from the expected value"] if expected else []
    papers = ", ".join(f"{name} {value:g}" for name, value in expected)
    return [
        "",
        "The table shows how much the protocol alone changes the value of a metric on the same "
        "motion. Each protocol is compared with the first one, and each variation of a protocol "
        "with that protocol." + (f" Expected: {papers}." if papers else ""),
        "",
        *(f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *rows)),
    ]
