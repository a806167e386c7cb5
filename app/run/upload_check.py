"""A file held against what a run will want of it, before anyone asks for the run."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from zipfile import is_zipfile

from app.errors import RunError, sentence_of
from app.run.ask import MAX_CLIPS
from conventions.names import printable

PACKED = (".zip", ".tar.gz", ".tgz", ".tar")
"""Endings of archives of many files."""
TOO_MANY_CLIPS = "At most {limit} clips go into one run; {count} were given."
TOO_LONG = (
    "The clips of one run may last {limit:g} minutes together; these last {count:.1f}. Leave some "
    "out, or use the command line."
)
NO_ZIP = "{name} is no readable zip; pack it again."

FileKind = Literal["motions", "sounds", "transcript"]
UploadKind = FileKind | Literal["speech", "reference", "motion", "plan", "files", "clips"]
"""What a file is meant to be: references and motions are any file that can be read; of
motions and sounds a zip may hold many; files are whichever of these each is."""
MOTIONS, WORDS, SOUNDS = (".npz", ".npy", ".bvh"), (".textgrid", ".txt"), (".wav", ".mp3", ".flac")
_MAX_LIST_BYTES = 300_000
"""Of the list of files at the end of a zip that is looked at."""


def kind_of(path: Path) -> FileKind:
    """What a file is, as its name tells, or of a zip the names in it; nothing is unpacked."""
    name = path.name.lower()
    if name.endswith(PACKED):
        with suppress(OSError), path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - _MAX_LIST_BYTES))
            name += file.read().decode("latin-1").lower() if path.suffix.lower() == ".zip" else ""
        has_motions = any(ending in name for ending in MOTIONS)
        has_sounds = any(part in name for part in (*SOUNDS, "speech", "audio", "sound"))
        return "sounds" if has_sounds and not has_motions else "motions"
    if name.endswith(WORDS):
        return "transcript"
    return "motions" if name.endswith(MOTIONS) else "sounds"


@dataclass(frozen=True)
class Given:
    """Files that somebody has put in a field."""

    kind: UploadKind
    paths: Sequence[Path]
    max_speech_s: float


def refusal_of(given: Given, *_: object) -> str:
    """Why the first of these files that cannot be used cannot be, in one sentence; empty where all
    can."""
    try:
        if given.kind == "clips":
            check_clips(given.paths, given.max_speech_s)
            return ""
        for path in given.paths:
            kind = kind_of(path) if given.kind == "files" else given.kind
            _read(kind, path, given.max_speech_s)
    except Exception as error:
        sentence = sentence_of(error)
        if sentence is None:
            raise
        return sentence
    return ""


def check_clips(speeches: Sequence[Path], max_s: float) -> None:
    """
    Raises:
        RunError: where they are too many, or together too long, for one run.
        SpeechError: where one cannot be used.
    """
    from model.speech.audio import SpeechLimits, load_speech

    if len(speeches) > MAX_CLIPS:
        raise RunError(TOO_MANY_CLIPS.format(limit=MAX_CLIPS, count=len(speeches)))
    lengths = [load_speech(path, SpeechLimits(max_s=max_s)).duration_s for path in speeches]
    if sum(lengths) > max_s:
        raise RunError(TOO_LONG.format(limit=max_s / 60, count=sum(lengths) / 60))


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
