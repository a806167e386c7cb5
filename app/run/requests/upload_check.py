"""A file held against what a run will want of it, before anyone asks for the run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from zipfile import is_zipfile

from app.errors import RunError, sentence_of
from app.run.requests.request import OnEvent, ShouldCancel
from conventions.names import printable

PACKED = (".zip", ".tar.gz", ".tgz", ".tar")
"""Endings of archives of many files."""
NO_ZIP = "{name} is no readable zip; pack it again."

UploadKind = Literal["speech", "reference", "motion", "sounds", "motions", "transcript", "plan"]
"""What a file is meant to be: references and motions are any file that can be read; of
motions and sounds a zip may hold many."""


@dataclass(frozen=True)
class Given:
    """Files that somebody has put in a field."""

    kind: UploadKind
    paths: Sequence[Path]
    max_speech_s: float


def refusal_of(
    given: Given,
    on_event: OnEvent = lambda event: None,
    should_cancel: ShouldCancel = lambda: False,
) -> str:
    """Why the first of these files that cannot be used cannot be, in one sentence; empty where all
    can."""
    for path in given.paths:
        try:
            _read(given.kind, path, given.max_speech_s)
        except Exception as error:
            sentence = sentence_of(error)
            if sentence is None:
                raise
            return sentence
    return ""


def _read(kind: UploadKind, path: Path, max_speech_s: float) -> None:
    match kind:
        case "motions" | "sounds" if path.name.lower().endswith(PACKED):
            if path.suffix.lower() == ".zip" and not is_zipfile(path):
                raise RunError(NO_ZIP.format(name=printable(path.name)))
        case "speech" | "sounds":
            from model.speech.audio import SpeechLimits, load_speech

            load_speech(path, SpeechLimits(max_s=max_speech_s))
        case "reference" | "motion" | "motions":
            from model.formats.read import read_any_motion
            from model.storage.npz import MotionError

            try:
                read_any_motion(path)
            except MotionError as error:
                if kind != "motions" or "--assume" not in str(error):  # else the form can say it
                    raise
        case "transcript":
            from model.speech.transcript import read_words

            read_words(path)
        case "plan":
            from model.plan.files import read_plan_file

            read_plan_file(path)
