"""Validation of uploaded files, before a run is requested."""

from __future__ import annotations

import gzip
import io
import tarfile
import zlib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from zipfile import BadZipFile, is_zipfile

from app.errors import RunError, message_for_user
from app.run.requests.parts import MAX_PAGE_CLIPS
from conventions.names import printable
from model.speech.transcript import ENDINGS as WORD_ENDINGS
from model.storage.files import open_limited_zip

ARCHIVE_SUFFIXES = (".zip", ".tar.gz", ".tgz", ".tar")
"""Suffixes of archives."""
TOO_MANY_CLIPS = (
    "A run can have at most {limit} clips; {count} were given. Remove some, or use the command "
    "line."
)
TOO_LONG = (
    "These clips last {count:.1f} minutes in total; the limit of a run is {limit:g} minutes. "
    "Remove some, or use the command line."
)
NO_ZIP = "{name} is not a readable zip; pack it again."

FileKind = Literal["motions", "sounds", "transcript"]
UploadKind = FileKind | Literal["speech", "reference", "motion", "plan", "files", "clips"]
"""Intended use of an upload. References and motions are any motion file; motions and sounds may be
an archive of many; files are motions, sounds or transcripts, by their names."""
MOTIONS, WORDS = (".npz", ".npy", ".bvh"), tuple(each.lower() for each in WORD_ENDINGS)
SOUNDS = (".wav", ".flac", ".mp3", ".ogg", ".opus", ".m4a", ".aac", ".webm")
_MAX_LIST_BYTES = 300_000
"""Maximum size (bytes) of the directory at the end of a zip that is read."""
_MAX_START_BYTES = 1 << 22
"""Number of uncompressed bytes at the start of a tar in which names are searched."""
_UNREADABLE = (
    *(OSError, EOFError, ValueError, NotImplementedError, BadZipFile, zlib.error),
    *(tarfile.TarError, OverflowError, RecursionError),
)


def file_kind(path: Path) -> FileKind:
    """Return the kind of a file by its name, and of an archive by names in it; others are sounds.

    Nothing is unpacked.
    """
    name = path.name.lower()
    if name.endswith(ARCHIVE_SUFFIXES):
        inside = [each.lower() for each in _names_in(path)]
        has_motions = any(each.endswith(MOTIONS) for each in inside)
        has_sounds = any(each.endswith(SOUNDS) for each in inside)
        return "sounds" if has_sounds and not has_motions else "motions"
    if name.endswith(WORDS):
        return "transcript"
    return "motions" if name.endswith(MOTIONS) else "sounds"


def _names_in(path: Path) -> list[str]:
    """Return the file names in an archive, as far as its start or a short directory lists them."""
    names: list[str] = []
    with suppress(*_UNREADABLE):
        if path.suffix.lower() == ".zip":
            with open_limited_zip(path, _MAX_LIST_BYTES) as archive:
                return archive.namelist()
        is_plain = path.suffix.lower() == ".tar"
        with path.open("rb") if is_plain else gzip.open(path) as file:
            start = file.read(_MAX_START_BYTES)
        with tarfile.open(fileobj=io.BytesIO(start), mode="r:") as tar:
            names += (member.name for member in tar)
    return names


@dataclass(frozen=True)
class Upload:
    """Files in an upload field, and their intended use."""

    kind: UploadKind
    paths: Sequence[Path]
    max_speech_s: float


def rejection_reason(upload: Upload, *_: object) -> str:
    """Return why the first unusable file cannot be used, in one sentence; empty if all can."""
    try:
        if upload.kind == "clips":
            checked_total_s(upload.paths, upload.max_speech_s)
            return ""
        for path in upload.paths:
            kind = file_kind(path) if upload.kind == "files" else upload.kind
            _read(kind, path, upload.max_speech_s)
    except Exception as error:
        sentence = message_for_user(error)
        if sentence is None:
            raise
        return sentence
    return ""


def checked_total_s(speeches: Sequence[Path], max_total_s: float) -> float:
    """Check and return the total length (s) of clips; raises RunError or SpeechError."""
    from model.speech.audio import SpeechReadOptions, load_speech

    if len(speeches) > MAX_PAGE_CLIPS:
        raise RunError(TOO_MANY_CLIPS.format(limit=MAX_PAGE_CLIPS, count=len(speeches)))
    lengths = [
        load_speech(path, SpeechReadOptions(max_s=max_total_s)).duration_s for path in speeches
    ]
    if sum(lengths) > max_total_s:
        raise RunError(TOO_LONG.format(limit=max_total_s / 60, count=sum(lengths) / 60))
    return sum(lengths)


def _read(kind: UploadKind, path: Path, max_speech_s: float) -> None:
    match kind:
        case "motions" | "sounds" if path.name.lower().endswith(ARCHIVE_SUFFIXES):
            if path.suffix.lower() == ".zip" and not is_zipfile(path):
                raise RunError(NO_ZIP.format(name=printable(path.name)))
        case "speech" | "sounds":
            from model.speech.audio import SpeechReadOptions, load_speech

            load_speech(path, SpeechReadOptions(max_s=max_speech_s))
        case "reference" | "motion" | "motions":
            from model.formats.read import read_any_motion
            from model.storage.npz import MotionError

            try:
                read_any_motion(path)
            except MotionError as error:
                if kind != "motions" or "--assume" not in str(error):  # else: a field of the form
                    raise
        case "transcript":
            from model.speech.transcript import read_words_file

            read_words_file(path)
        case "plan":
            from model.plan.files import read_plan_file

            read_plan_file(path)
