"""What the numbers of one run say of the paper's first claim, and what it takes to say more."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.findings.comparison import plain
from app.findings.points import point_title
from app.findings.samples import ALIKE, Samples, mean, number_of, ratio_of, values_by_system
from app.findings.sentences import jerk_of

if TYPE_CHECKING:
    from model.measures.diagnostics import Diagnostics

LOCAL = "globaldiff/local"
GLOBAL_RUNGS = ("globaldiff/global", "globaldiff/joint", "globaldiff/skeleton", "globaldiff/full")
PLAIN, FULL = GLOBAL_RUNGS[0], GLOBAL_RUNGS[-1]
"""Without the constraints of the paper, and with all of them."""
CLAIM = "global rotations jerk less than local ones"
ENOUGH_CLIPS = 10
"""With fewer, an interval over clips is too wide to tell systems apart that differ by a tenth."""


@dataclass(frozen=True)
class Verdict:
    """Two sentences above the videos."""

    numbers: str
    """The followed point's jerk in every system, and as recorded."""
    judgement: str
    """Whether the claim shows, and what would be needed; empty where nothing is compared."""

    @property
    def text(self) -> str:
        return f"{self.numbers} {self.judgement}".strip()


def verdict_of(diagnostics: Diagnostics) -> Verdict | None:
    """The verdict on a run, from the motion as generated; None where no jerk was measured."""
    jerk = values_by_system(diagnostics, jerk_of, "raw")
    if not jerk:
        return None
    names = short_names(jerk)
    told = ", ".join(f"{names[name]} {plain(mean(values))}" for name, values in jerk.items())
    recorded = number_of(diagnostics.reference, jerk_of, "raw")
    ending = "" if recorded is None else f"; recorded {plain(recorded)}"
    numbers = f"{point_title(diagnostics.point)} jerk in m/s³: {told}{ending}."
    sentences = [*_claim(jerk, names), *_worse(jerk, names), *_needed(jerk)]
    return Verdict(numbers, " ".join(sentences))


def short_names(systems: Iterable[str]) -> dict[str, str]:
    """Each system's name without its family, where that is a word and no other's too."""
    systems = list(systems)
    ends = [name.rsplit("/", 1)[-1] for name in systems]
    return {
        name: end if ends.count(end) == 1 and not end.isdigit() else name
        for name, end in zip(systems, ends, strict=True)
    }


def _claim(jerk: Mapping[str, Samples], names: Mapping[str, str]) -> list[str]:
    """Whether the rungs with global rotations jerk less than the one with local ones."""
    rungs = [name for name in GLOBAL_RUNGS if name in jerk]
    if LOCAL not in jerk or not rungs:
        return []
    showing = [name for name in rungs if _is_less(jerk[LOCAL], jerk[name])]
    if len(showing) == len(rungs):
        return [f"On this clip the paper's claim shows: {CLAIM}."]
    if not showing:
        return [f"On this clip the paper's claim, that {CLAIM}, does not show."]
    yes, no = (
        " and ".join(names[name] for name in rungs if (name in showing) == is_shown)
        for is_shown in (True, False)
    )
    return [f"On this clip the paper's claim, that {CLAIM}, shows with {yes}, not with {no}."]


def _worse(jerk: Mapping[str, Samples], names: Mapping[str, str]) -> list[str]:
    """Whether all constraints together jerk more than none of them."""
    if not {PLAIN, FULL} <= jerk.keys() or not _is_less(jerk[FULL], jerk[PLAIN]):
        return []
    return [f"Here {names[FULL]} jerks more than {names[PLAIN]}: its constraints did not help."]


def _is_less(local: Samples, other: Samples) -> bool:
    """By more than 5 %, and where there are several samples, by more than chance."""
    ratio = ratio_of(local, other)
    return ratio is not None and ratio.value >= ALIKE and not ratio.is_open


def _needed(jerk: Mapping[str, Samples]) -> list[str]:
    if len(jerk) < 2:
        return []
    samples = max(len(values) for values in jerk.values())
    seen = "one sample" if samples == 1 else f"{samples} samples"
    return [
        f"This is one clip, {seen} and one training of each: an example. To claim anything takes "
        f"several samples of {ENOUGH_CLIPS} clips or more, of systems trained from several seeds."
    ]
