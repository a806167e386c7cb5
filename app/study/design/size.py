"""What a study asks of its participants, and how many votes it brings, before any video is made."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from dataclasses import dataclass

from app.study.design.plan import Plan
from app.study.design.trials import Design

BEFORE_S, ANSWER_S, USUAL_LENGTH_S = 60.0, 8.0, 10.0
"""What reading and practice take, an answer, and a video of which the plan does not say it."""
_WHAT = {
    "pair": ("vote", "pair of systems"),
    "match": ("vote", "system"),
    "rank": ("ranking", "system"),
    "rate": ("rating", "system"),
}
"""By kind of trial: what a page gives, and to whom it is counted."""


@dataclass(frozen=True)
class StudySize:
    """Of all lists, if all participants finish."""

    minutes: int
    """What the longest list takes: each video once, and for each page the time of an answer."""
    num_pages: int
    """Of the longest list, attention checks among them."""
    kind: str
    """Of its trials."""
    fewest: int
    """Votes for the pair of systems, or the system, that is shown least often."""
    most: int

    def sentence(self) -> str:
        """For the researcher."""
        vote, whom = _WHAT[self.kind]
        count = f"{self.fewest}" if self.fewest == self.most else f"{self.fewest} to {self.most}"
        return (
            f"About {_counted(self.minutes, 'minute')} and {_counted(self.num_pages, 'page')} for "
            f"each participant; {count} {vote if self.most == 1 else vote + 's'} for each {whom} "
            "if all finish."
        )


def size_of(plan: Plan, design: Design) -> StudySize:
    """Count it from the design."""
    length_s = plan.length_s or USUAL_LENGTH_S
    seconds = max(
        sum(len(page.shown) * length_s + ANSWER_S for page in pages) for pages in design.lists
    )
    (kind,) = {trial.kind for trial in design.trials if trial.stimuli}
    num_shown = 2 if kind == "pair" else 1
    names = sorted(system.name for system in plan.systems)
    votes = Counter({group: 0 for group in itertools.combinations(names, num_shown)})
    for page in itertools.chain.from_iterable(design.lists):
        shown = sorted({stimulus.system for stimulus in page.shown})
        votes.update(itertools.combinations(shown, num_shown))
    return StudySize(
        minutes=math.ceil((BEFORE_S + seconds) / 60),
        num_pages=max(map(len, design.lists)),
        kind=kind,
        fewest=min(votes.values()),
        most=max(votes.values()),
    )


def _counted(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"
