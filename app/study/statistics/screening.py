"""Inclusion of participants: finished, attentive by the key's rule, and with plausible answers.

This proves no forgery, and careful ones pass, so results are shown with and without the doubtful.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from app.study.design.key import ExpectedAnswer, StudyKey
from app.study.statistics.answers import TIE, Answer, Participant, is_number
from conventions.names import pluralise

FALLBACK_VIDEO_S = 0.5
"""Shortest video (s), used if the key does not have their duration."""
TOLERANCE = 0.9
"""Factor on minimum times, as browsers' clocks are coarse."""
MAX_FAST_SHARE = 0.1
"""Share of trials that may be answered before their videos end, as after a reload."""
MIN_SAME_SIDE_ANSWERS = 10
"""Fewest answers at the same position that, with other evidence of inattention, are implausible:
sides are balanced on every list. Ties have no position.
"""
MIN_COPIED_ANSWERS = 5
"""Fewest answers with times equal to the millisecond that count as a copy of another file."""
SLIDER_TOLERANCE = 5
"""Largest distance of a slider from a check's number: a thumb on a phone covers as much."""


@dataclass(frozen=True)
class ExcludedParticipant:
    """Excluded participant, and the reason as the end of a sentence."""

    participant: Participant
    reason: str


@dataclass(frozen=True)
class ScreeningResult:
    """Participants in three disjoint groups: included, excluded and implausible."""

    included: tuple[Participant, ...]
    excluded: tuple[ExcludedParticipant, ...] = ()
    implausible: tuple[ExcludedParticipant, ...] = ()
    """Finished and attentive participants with implausible answers, with the panel id of another
    one, or, if the study has links, without a valid link of their own."""


def screen(participants: Iterable[Participant], key: StudyKey) -> ScreeningResult:
    """Include plausible participants that finished and failed at most `StudyKey.max_failed` checks.

    An unfinished list unbalances order and sides, and participants may leave because of what they
    saw; so they are listed, not mixed in. An unanswered check of a finished participant is failed.
    """
    included: list[Participant] = []
    excluded: list[ExcludedParticipant] = []
    for one in participants:
        failed = failed_checks(one, key)
        if one.finished is None:
            trials, whole = {answer.trial for answer in one.answers}, key.lists[one.list_number]
            excluded.append(
                ExcludedParticipant(one, f"not finished ({len(trials)} of {len(whole)} trials)")
            )
        elif failed > key.max_failed:
            why = f"attention checks: {failed} failed, {key.max_failed} allowed"
            excluded.append(ExcludedParticipant(one, why))
        else:
            included.append(one)
    doubted = _link_doubts(included, key)
    doubted |= _panel_doubts([one for one in included if one.id not in doubted], key)
    doubted |= implausibility_reasons([one for one in included if one.id not in doubted], key)
    return ScreeningResult(
        included=tuple(one for one in included if one.id not in doubted),
        excluded=tuple(excluded),
        implausible=tuple(
            ExcludedParticipant(one, doubted[one.id]) for one in included if one.id in doubted
        ),
    )


def failed_checks(participant: Participant, key: StudyKey) -> int:
    """Count the failed attention checks of the participant's list; no answer is a failure."""
    values = {answer.trial: answer.value for answer in participant.answers}
    checks = {trial: key.trials[trial].expected for trial in key.lists[participant.list_number]}
    return sum(
        not _is_expected(values.get(trial), expected, key)
        for trial, expected in checks.items()
        if expected is not None
    )


def _is_expected(value: object, expected: ExpectedAnswer, key: StudyKey) -> bool:
    if isinstance(expected.value, str):
        return value == expected.value
    tolerance = SLIDER_TOLERANCE if key.protocol == "rating" else 0
    return is_number(value) and abs(value - expected.value) <= tolerance  # type: ignore[operator]


def _link_doubts(participants: Sequence[Participant], key: StudyKey) -> dict[str, str]:
    """Return by participant why the link is not valid.

    If a link was used repeatedly with different answers, none counts: its owner can write any time.
    """
    reasons: dict[str, str] = {}
    used: dict[str, list[Participant]] = defaultdict(list)
    for one in participants:
        if (why := key.link_error(one.link_token, one.list_number)) is not None:
            reasons[one.id] = why
        elif key.link_secret is not None and one.link_token is not None:
            used[one.link_token].append(one)
    for first, *others in used.values():
        are_copies = all(_content(one) == _content(first) for one in others)
        for one in others if are_copies else (first, *others) if others else ():
            other = others[0] if one is first else first
            reasons[one.id] = f"its link was also used for {other.file_name}"
    return reasons


def _panel_doubts(participants: Sequence[Participant], key: StudyKey) -> dict[str, str]:
    """Return by participant why they repeat another one: the same panel id, finished later."""
    reasons: dict[str, str] = {}
    first: dict[str, Participant] = {}
    own = key.panel_id_names[0] if key.panel_id_names else ""
    for one in sorted(participants, key=lambda one: one.finished or one.started):
        if (value := one.panel_values.get(own)) is not None:
            earlier = first.setdefault(value, one)
            if earlier is not one:
                name = earlier.file_name
                reasons[one.id] = f"the same {own} as {name}, which was finished earlier"
    return reasons


def implausibility_reasons(participants: Sequence[Participant], key: StudyKey) -> dict[str, str]:
    """Return by participant why the answers are implausible; no entry for the others."""
    reasons = {}
    sources: dict[tuple, str] = {}
    for one in participants:
        why = _implausibility(one, key)
        if len(one.answers) >= MIN_COPIED_ANSWERS:
            first = sources.setdefault(_content(one), one.file_name)
            if first != one.file_name:
                why = why or f"the same answers and response times as {first}"
        if why:
            reasons[one.id] = why
    return reasons


def _implausibility(participant: Participant, key: StudyKey) -> str | None:
    finished, started = participant.finished, participant.started
    if finished is not None and finished < started:
        return "the end time is before the start time"
    judged = [
        one
        for one in participant.answers
        if key.trials[one.trial].expected is None and one.unplayable_video is None
    ]
    spent = {one.trial: one.page_ms / 1000 for one in judged}
    lasts = {one.trial: (key.video_s or FALLBACK_VIDEO_S) * len(one.videos) for one in judged}
    hasty = sum(spent[trial] < TOLERANCE * lasts[trial] for trial in spent)
    if hasty > MAX_FAST_SHARE * len(spent):
        return f"{hasty} of {len(spent)} trials answered in less time than the videos last"
    if finished is not None:
        spent_s, whole_s = sum(spent.values()), (finished - started).total_seconds()
        if whole_s < TOLERANCE * spent_s:
            return f"{spent_s:.0f} s spent on trials, but only {whole_s:.0f} s from start to end"
    place = {trial: number for number, trial in enumerate(key.lists[participant.list_number])}
    order = [place[answer.trial] for answer in participant.answers]
    if order != sorted(order):
        return "answers in a different order than the trials of the list"
    # Equal answers may be honest; they alone exclude no participant.
    failed = failed_checks(participant, key)
    places = {_place(answer) for answer in judged}
    if (
        len(judged) >= MIN_SAME_SIDE_ANSWERS
        and len(places) == 1
        and None not in places
        and (failed or hasty)
    ):
        evidence = [pluralise(failed, "attention check") + " failed"] if failed else []
        evidence += (
            [f"{hasty} of {len(spent)} trials answered in less time than the videos last"]
            if hasty
            else []
        )
        return f"the same screen position chosen in every trial; also {', '.join(evidence)}"
    return None


def _place(answer: Answer) -> object:
    """Return the answer as a position on the screen; None for a tie, which has no position."""
    if isinstance(answer.value, dict):
        ratings = [answer.value.get(video) for video in answer.videos]
        return tuple(ratings) if len(set(ratings)) > 1 else None
    if isinstance(answer.value, list):
        return tuple(answer.videos.index(video) for video in answer.value)
    return None if answer.value == TIE else answer.videos.index(answer.value)


def _content(participant: Participant) -> tuple:
    return tuple((a.trial, a.question, str(a.value), a.page_ms) for a in participant.answers)
