"""The wording of a study, from `questions.toml`."""

from __future__ import annotations

import functools
import tomllib
from pathlib import Path
from typing import Any

from app.study.design.key import Question

QUESTIONS = Path(__file__).with_name("questions.toml")
CHOICE_VALUES = ("left", "right", "tie")
ATTENTION_QUESTION = "attention"


@functools.cache
def wording() -> dict[str, Any]:
    """All sentences that a participant reads."""
    return tomllib.loads(QUESTIONS.read_text("utf-8"))


def questions_of(protocol: str) -> tuple[Question, ...]:
    """What each trial of the protocol asks."""
    return tuple(Question(**item) for item in wording()["protocols"][protocol]["questions"])
