"""Small studies and answers for the tests."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from app.study.design.fields import Fields
from app.study.design.key import Expected, Key, Question, Trial, Video, write_key
from app.study.simulate import RaterModel, World, answers_file
from app.study.statistics.answers import Participant, participant_of
from app.study.statistics.votes import Votes

SYSTEMS = ("local", "global", "rival")
STRENGTHS = {"local": 0.0, "global": 1.0, "rival": -0.8}
LEFT_CHECK = Trial(
    "attention", "no clip", ("clip0-local", "clip0-global"), ("c",), Expected("c", "left")
)
QUESTIONS = {
    "pairwise": Question("realism", "Which moves more like a real person?", "choice"),
    "matched": Question("match", "Which fits the speech better?", "choice"),
    "ranking": Question("realism", "Which moves most like a real person?", "ranking"),
    "rating": Question("realism", "How much like a real person?", "slider"),
}
SHOWN = {
    "pairwise": (("local", "global"), ("global", "rival"), ("rival", "local")),
    "matched": tuple((name, f"{name}-mismatched") for name in SYSTEMS),
    "ranking": (SYSTEMS,),
    "rating": (SYSTEMS,),
}
KINDS = {"pairwise": "pair", "matched": "match", "ranking": "rank", "rating": "rate"}


def made_key(protocol: str = "pairwise", num_clips: int = 4, num_lists: int = 4) -> Key:
    """Three systems, two attention checks of which one may fail."""
    clips = [f"clip{number}" for number in range(num_clips)]
    videos = {}
    for clip in clips:
        for name in SYSTEMS:
            speech = None if protocol == "pairwise" else clip
            videos[f"{clip}-{name}"] = Video(name, clip, speech, "front", "0" * 64)
            videos[f"{clip}-{name}-mismatched"] = Video(name, clip, "else", "front", "0" * 64)
    question = QUESTIONS[protocol]
    trials = {
        f"{clip}/{number}": Trial(
            KINDS[protocol], clip, tuple(f"{clip}-{name}" for name in shown), (question.id,)
        )
        for clip in clips
        for number, shown in enumerate(SHOWN[protocol])
    }
    trials |= {"check0": LEFT_CHECK, "check1": LEFT_CHECK}
    return Key(
        study="0123456789abcdef",
        title="Three <systems> & a study",
        protocol=protocol,
        systems=SYSTEMS,
        questions=(question,),
        videos=videos,
        trials=trials,
        lists={number: tuple(trials) for number in range(num_lists)},
        max_failed=1,
        participants=num_lists,
    )


def made_world(key: Key, model: RaterModel | None = None, seed: int = 0) -> World:
    """Raters of known strengths."""
    return World(key, STRENGTHS, model or RaterModel(lapse=0), np.random.default_rng(seed))


def made_files(key: Key, count: int, model: RaterModel | None = None) -> list[dict[str, Any]]:
    """What so many raters send."""
    world = made_world(key, model)
    return [answers_file(world, rater) for rater in range(count)]


def made_participants(key: Key, count: int, model: RaterModel | None = None) -> list[Participant]:
    """The same, read."""
    files = made_files(key, count, model)
    return [participant_of(Fields(content), key, "made.json")[0] for content in files]


def made_votes(rows: list[tuple[int, int, int, float]], clip: int = 0) -> Votes:
    """Votes from (rater, left, right, score)."""
    rater, left, right, score = (np.array(column) for column in zip(*rows, strict=True))
    nowhere = np.full(len(rows), clip)
    return Votes(rater, nowhere, left, right, score.astype(float), np.zeros(len(rows), bool))


def written_study(folder: Path, key: Key, files: list[dict[str, Any]]) -> tuple[Path, Path]:
    """Key and answers on disk: path of the key, folder of the answers."""
    researcher = folder / "study" / "researcher_only"
    answers = folder / "answers"
    researcher.mkdir(parents=True)
    answers.mkdir()
    write_key(key, researcher / "key.json")
    for content in files:
        (answers / f"{content['participant']}.json").write_text(json.dumps(content))
    return researcher / "key.json", answers
