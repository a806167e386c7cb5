"""How evenly sides, order and lists came out among the participants who count."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.study.design.key import Key
from app.study.statistics.answers import Participant


@dataclass(frozen=True)
class SystemBalance:
    """Where one system was seen."""

    system: str
    shown_first: float
    """Share of its showings in which it stood first (leftmost)."""
    mean_place: float
    """Mean place of its trials on the list, 0 = first trial, 1 = last; even is 0.5."""


@dataclass(frozen=True)
class Balance:
    systems: tuple[SystemBalance, ...]
    lists_used: int
    lists_planned: int
    most_of_one_list: int
    """Participants on the list that most worked on."""


def balance_reached(participants: Sequence[Participant], key: Key) -> Balance:
    """Counted over the answers that count, attention checks aside.

    In matched trials every video is of one system, so being first says nothing and is 1.
    """
    first: dict[str, list[bool]] = {name: [] for name in key.systems}
    places: dict[str, list[float]] = {name: [] for name in key.systems}
    for participant in participants:
        trials = key.lists[participant.list_number]
        place_of = {trial: place for place, trial in enumerate(trials)}
        for answer in participant.answers:
            if key.trials[answer.trial].expected is not None:
                continue
            place = place_of[answer.trial] / max(1, len(trials) - 1)
            systems = [key.videos[video].system for video in answer.shown]
            for system in set(systems):
                first[system].append(systems[0] == system)
                places[system].append(place)
    used = Counter(participant.list_number for participant in participants)
    return Balance(
        systems=tuple(
            SystemBalance(name, float(np.mean(first[name])), float(np.mean(places[name])))
            for name in key.systems
            if first[name]
        ),
        lists_used=len(used),
        lists_planned=len(key.lists),
        most_of_one_list=max(used.values(), default=0),
    )
