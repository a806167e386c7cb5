"""Small studies and answers for the tests."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from app.study.design.key import (
    KIND_OF_PROTOCOL,
    AttentionRule,
    ExpectedAnswer,
    Question,
    StudyKey,
    Trial,
    Video,
    write_key,
)
from app.study.simulate import RaterModel, simulate_answers
from app.study.statistics.answers import Participant, drop_invalid_answers
from model.storage.json_validation import parse_json

SYSTEMS = ("local", "global", "rival")
STRENGTHS = {"local": 0.0, "global": 1.0, "rival": -0.8}
LEFT_CHECK = Trial(
    "attention", "no clip", ("clip0-local", "clip0-global"), ("c",), ExpectedAnswer("c", "left")
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


def made_key(protocol: Any = "pairwise", num_clips: int = 4, num_lists: int = 4) -> StudyKey:
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
            KIND_OF_PROTOCOL[protocol],
            clip,
            tuple(f"{clip}-{name}" for name in shown),
            (question.id,),
        )
        for clip in clips
        for number, shown in enumerate(SHOWN[protocol])
    }
    trials |= {"check0": LEFT_CHECK, "check1": LEFT_CHECK}
    return StudyKey(
        study_id="0123456789abcdef",
        title="Three <systems> & a study",
        protocol=protocol,
        systems=SYSTEMS,
        questions=(question,),
        videos=videos,
        trials=trials,
        lists={number: tuple(trials) for number in range(num_lists)},
        attention_rule=AttentionRule(1),
        num_participants_planned=num_lists,
    )


def made_files(
    key: StudyKey, count: int, model: RaterModel | None = None, seed: int = 0
) -> list[dict[str, Any]]:
    """What so many raters of known strengths send."""
    rng = np.random.default_rng(seed)
    return list(
        simulate_answers(
            key, STRENGTHS, count, model or RaterModel(check_failure_probability=0), rng
        )
    )


def made_participants(
    key: StudyKey, count: int, model: RaterModel | None = None, seed: int = 0
) -> list[Participant]:
    """The same, read."""
    files = made_files(key, count, model, seed)
    sent = [parse_json(json.dumps(content), Participant) for content in files]
    return [drop_invalid_answers(replace(one, file_name="made.json"), key)[0] for one in sent]


def made_votes(
    rows: list[tuple[int, str, str, float]], clip: str = "clip0", is_smooth: bool = False
) -> pd.DataFrame:
    """Votes from (rater, left, right, score)."""
    table = pd.DataFrame(rows, columns=["rater", "left", "right", "score"])
    return table.assign(clip=clip, is_smooth=is_smooth, weight=1.0)


def written_study(folder: Path, key: StudyKey, files: list[dict[str, Any]]) -> tuple[Path, Path]:
    """Key and answers on disk: path of the key, folder of the answers."""
    researcher = folder / "study" / "researcher_only"
    answers = folder / "answers"
    researcher.mkdir(parents=True)
    answers.mkdir()
    write_key(key, researcher / "key.json")
    for content in files:
        (answers / f"{content['participant']}.json").write_text(json.dumps(content))
    return researcher / "key.json", answers
