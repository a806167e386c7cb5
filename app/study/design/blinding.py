"""Blind ids of videos and trials, and the test whether visible orders follow the method.

Within each scene (one clip from one view) the values of its videos are ranked. If they were
unrelated to the method, every assignment of systems within a scene would be equally likely; a
permutation test gives the probability of the observed orders.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from app.study.design.key import AttentionRule, ExpectedAnswer, Stimulus, StudyKey, Trial, Video
from app.study.design.plan import ATTENTION_QUESTION, StudyPlan, protocol_questions
from app.study.design.trials import Design

NOT_RENDERED = "not made yet"
"""Placeholder of a video's sha256 until the video is finished."""
SIGNIFICANCE_LEVEL = 0.01
"""Probability below which an order counts as a leak; the export draws ids until it is above."""
_DRAWS, _BATCH = 20_000, 2_000


def make_key(plan: StudyPlan, design: Design) -> StudyKey:
    """Make the key of a study without finished videos, with new random ids.

    Ids in an order that follows the method by chance are drawn again. Videos are sorted by id, so
    that their order reveals nothing; trials are in the order of the design.
    """
    names: dict[Stimulus, str] = {}
    while not names or blind_id_leaks(names):
        names = dict(zip(design.stimuli, _distinct(len(design.stimuli), 8), strict=True))
    trials = _distinct(len(design.trials), 4)
    questions = protocol_questions(plan.protocol)
    question_ids = tuple(question.id for question in questions)
    return StudyKey(
        study_id=secrets.token_hex(8),
        title=plan.title,
        protocol=plan.protocol,
        systems=tuple(system.name for system in plan.conditions),
        questions=questions,
        videos={
            blind: Video(**vars(stimulus), sha256=NOT_RENDERED)
            for stimulus, blind in sorted(names.items(), key=lambda item: item[1])
        },
        trials={
            name: Trial(
                kind=trial.kind,
                clip=trial.clip,
                videos=tuple(sorted(names[stimulus] for stimulus in trial.stimuli)),
                questions=(ATTENTION_QUESTION,) if trial.required_answer else question_ids,
                expected=ExpectedAnswer(ATTENTION_QUESTION, trial.required_answer)
                if trial.required_answer
                else None,
            )
            for name, trial in zip(trials, design.trials, strict=True)
        },
        lists={
            number: tuple(trials[page.trial_index] for page in pages)
            for number, pages in enumerate(design.lists)
        },
        attention_rule=AttentionRule(design.max_failed(plan)),
        num_participants_planned=plan.participants,
        video_s=plan.video_s,
        panel_id_names=plan.panel_id_names,
    )


def _distinct(count: int, num_bytes: int) -> list[str]:
    names: dict[str, None] = {}
    while len(names) < count:
        names[secrets.token_hex(num_bytes)] = None
    return list(names)


def lists_with_ids(design: Design, key: StudyKey) -> list[list[tuple[str, list[str]]]]:
    """Return the pages of each list: trial id and ids of its videos (none for checks)."""
    trials, names = tuple(key.trials), stimulus_ids(key)
    return [
        [(trials[page.trial_index], [names[each] for each in page.stimuli]) for page in pages]
        for pages in design.lists
    ]


def stimulus_ids(key: StudyKey) -> dict[Stimulus, str]:
    """Return the blind ids by stimulus."""
    return {
        Stimulus(video.system, video.clip, video.speech_clip, video.view): blind
        for blind, video in key.videos.items()
    }


def agreement_p_value(scenes: Sequence[Mapping[str, float]]) -> float:
    """Compute the probability under chance of orders that agree over scenes as much as these.

    The statistic is Friedman's: the sum over systems of their squared rank totals. Up to `_DRAWS`
    arrangements are enumerated; of more, as many are sampled. One scene alone gives 1, as all of
    its orders are equally likely. Each scene has a value by system, all with the same systems.
    """
    from scipy import stats  # takes a second to import and is seldom needed by the page

    if len(scenes) < 2:
        return 1.0
    systems = sorted(scenes[0])
    ranks = np.array([stats.rankdata([scene[name] for name in systems]) for scene in scenes])

    def agreement(*by_system: Float[np.ndarray, " ..."], axis: int) -> np.ndarray:
        return np.sum([np.square(each.sum(axis=axis)) for each in by_system], axis=0)

    test = stats.permutation_test(
        tuple(ranks.T),
        agreement,
        permutation_type="samples",
        vectorized=True,
        n_resamples=_DRAWS,
        batch=_BATCH,
        alternative="greater",
        random_state=0,  # pyright: ignore[reportCallIssue]  # `rng` from scipy 1.15 on
    )
    return float(test.pvalue)


def blind_id_leaks(ids: Mapping[Stimulus, str]) -> list[str]:
    """Return one sentence for each way in which the sorted ids suggest the method."""
    place = {blind_id: float(rank) for rank, blind_id in enumerate(sorted(ids.values()))}
    return value_leaks({stimulus: place[each] for stimulus, each in ids.items()}, "file name")


def value_leaks(values: Mapping[Stimulus, float], noun: str) -> list[str]:
    """Return a sentence for each way in which a value's order suggests method or speech match."""
    ways: list[tuple[str, Callable[[Stimulus], object], Callable[[Stimulus], str]]] = [
        ("reveals the system", lambda s: (s.clip, s.view, s.speech_clip), lambda s: s.system),
        (
            "reveals which speech is matched",
            lambda s: (s.clip, s.view, s.system),
            lambda s: str(s.has_own_speech),
        ),
    ]
    tells = []
    for way, scene_of, label_of in ways:
        scenes: dict[object, dict[str, float]] = {}
        for stimulus, value in values.items():
            scenes.setdefault(scene_of(stimulus), {})[label_of(stimulus)] = value
        chance = agreement_p_value([scene for scene in scenes.values() if len(scene) > 1])
        if chance < SIGNIFICANCE_LEVEL:
            tells.append(f"{noun}: sorting the videos by {noun} {way} (p = {chance:.2g})")
    return tells
