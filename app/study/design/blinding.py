"""Random names for everything that participants can see, and the key that undoes them."""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from dataclasses import dataclass, replace

from app.errors import RunError
from app.study.design.key import Expected, Key, Trial, Video
from app.study.design.plan import ATTENTION_QUESTION, Plan, questions_of
from app.study.design.tells import order_tells
from app.study.design.trials import Design, Page, Stimulus

NOT_MADE = "not made yet"
"""In place of a video's sha256 while the export has not finished."""


@dataclass(frozen=True)
class Blinding:
    """The ids of one study."""

    study: str
    videos: Mapping[Stimulus, str]
    trials: tuple[str, ...]
    """In the order of `Design.trials`."""


def draw_blinding(design: Design) -> Blinding:
    """New ids from the system's source of randomness.

    Orders of names that would suggest the method, as chance may give them, are drawn again.
    """
    while True:
        blinding = Blinding(
            study=secrets.token_hex(8),
            videos=dict(zip(design.stimuli, _distinct(len(design.stimuli), 8), strict=True)),
            trials=tuple(_distinct(len(design.trials), 4)),
        )
        if not order_tells(blinding.videos):
            return blinding


def blind_lists(design: Design, blinding: Blinding) -> list[list[tuple[str, list[str]]]]:
    """Of each list its pages: the trial and the videos that it shows, none where it is a check."""

    def blind(page: Page) -> tuple[str, list[str]]:
        return blinding.trials[page.trial], [blinding.videos[each] for each in page.shown]

    return [[blind(page) for page in pages] for pages in design.lists]


def make_key(plan: Plan, design: Design, blinding: Blinding, sha256: Mapping[str, str]) -> Key:
    """The key. Videos are listed by id, so that their order says nothing.

    Args:
        sha256: by blind id, of those videos that are made.
    """
    questions = questions_of(plan.protocol)
    asked = tuple(question.id for question in questions)
    return Key(
        study=blinding.study,
        title=plan.title,
        protocol=plan.protocol,
        systems=tuple(system.name for system in plan.systems),
        questions=questions,
        videos={
            blind: Video(**vars(stimulus), sha256=sha256.get(blind, NOT_MADE))
            for stimulus, blind in sorted(blinding.videos.items(), key=lambda item: item[1])
        },
        trials={
            trial_id: Trial(
                kind=trial.kind,
                clip=trial.clip,
                videos=tuple(sorted(blinding.videos[stimulus] for stimulus in trial.stimuli)),
                questions=(ATTENTION_QUESTION,) if trial.press else asked,
                expected=Expected(ATTENTION_QUESTION, trial.press) if trial.press else None,
            )
            for trial_id, trial in zip(blinding.trials, design.trials, strict=True)
        },
        lists={
            number: tuple(blinding.trials[page.trial] for page in pages)
            for number, pages in enumerate(design.lists)
        },
        max_failed=plan.max_failed,
        participants=plan.participants,
        video_s=plan.length_s,
    )


def blinding_of(key: Key, plan: Plan, design: Design) -> Blinding:
    """The ids that an earlier run of the same plan has given.

    Raises:
        RunError: if the key belongs to another design.
    """
    videos = {
        Stimulus(video.system, video.clip, video.speech, video.view): blind
        for blind, video in key.videos.items()
    }
    blinding = Blinding(key.study, videos, tuple(key.trials))
    is_same = set(videos) == set(design.stimuli) and len(key.trials) == len(design.trials)
    if is_same:
        made_anew = make_key(plan, design, blinding, {})
        is_same = made_anew == replace(
            key,
            videos={name: replace(video, sha256=NOT_MADE) for name, video in key.videos.items()},
            link_secret=None,
        )
    if not is_same:
        raise RunError(
            "The folder holds the key of another plan; export to a new folder, or put the plan "
            "back as it was."
        )
    return blinding


def _distinct(count: int, num_bytes: int) -> list[str]:
    names: dict[str, None] = {}
    while len(names) < count:
        names[secrets.token_hex(num_bytes)] = None
    return list(names)
