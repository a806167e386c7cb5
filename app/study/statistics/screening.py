"""Whose answers count: finished, and attentive by the rule that the key states."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from app.study.design.fields import is_number
from app.study.design.key import Expected, Key
from app.study.design.links import doubt_of
from app.study.statistics.answers import Participant
from app.study.statistics.plausibility import doubts

SLIDER_TOLERANCE = 5
"""How far from the number asked for a slider may stand: a thumb on a phone covers as much."""


@dataclass(frozen=True)
class Dropped:
    """A participant whose answers do not count, and why as the end of a sentence."""

    participant: Participant
    why: str


@dataclass(frozen=True)
class Screened:
    """Participants who count and those who do not."""

    kept: tuple[Participant, ...]
    dropped: tuple[Dropped, ...]
    set_aside: tuple[Dropped, ...] = ()
    """Finished and attentive, but not by a link of theirs, where the study has links, or not as
    anyone answers (`app.study.statistics.plausibility`)."""


def screen(participants: Iterable[Participant], key: Key) -> Screened:
    """Keep who finished, failed at most `Key.max_failed` attention checks and is plausible.

    A half-finished list unbalances order and sides, and whoever leaves early may leave because of
    what was seen; so the half-finished are listed, not mixed in. A check that a finished
    participant did not answer is failed.
    """
    kept: list[Participant] = []
    dropped: list[Dropped] = []
    for participant in participants:
        failed = failed_checks(participant, key)
        if participant.finished is None:
            trials = len({answer.trial for answer in participant.answers})
            whole = len(key.lists[participant.list_number])
            dropped.append(Dropped(participant, f"not finished ({trials} of {whole} trials)"))
        elif failed > key.max_failed:
            dropped.append(
                Dropped(participant, f"attention checks: {failed} failed, {key.max_failed} allowed")
            )
        else:
            kept.append(participant)
    why = _link_doubts(kept, key)
    why |= doubts([one for one in kept if one.id not in why], key)
    return Screened(
        kept=tuple(participant for participant in kept if participant.id not in why),
        dropped=tuple(dropped),
        set_aside=tuple(Dropped(one, why[one.id]) for one in kept if one.id in why),
    )


def _link_doubts(participants: Iterable[Participant], key: Key) -> dict[str, str]:
    """By participant why they did not come by a link of their own. Of several by one link, the one
    who finished first did."""
    found: dict[str, str] = {}
    used: dict[str, Participant] = {}
    for one in sorted(participants, key=lambda one: one.finished or one.started):
        why = doubt_of(key, one.link, one.list_number)
        if why is None and key.link_secret is not None and one.link is not None:
            first = used.setdefault(one.link, one)
            why = f"the link was used by {first.source} before" if first is not one else None
        if why is not None:
            found[one.id] = why
    return found


def failed_checks(participant: Participant, key: Key) -> int:
    """How many attention checks of the participant's list were not answered as asked."""
    given = {answer.trial: answer.value for answer in participant.answers}
    return sum(
        not _is_as_asked(given.get(trial_id), expected, key)
        for trial_id in key.lists[participant.list_number]
        if (expected := key.trials[trial_id].expected) is not None
    )


def _is_as_asked(value: object, expected: Expected, key: Key) -> bool:
    if isinstance(expected.value, str):
        return value == expected.value
    tolerance = SLIDER_TOLERANCE if key.protocol == "rating" else 0
    return is_number(value) and abs(value - expected.value) <= tolerance
