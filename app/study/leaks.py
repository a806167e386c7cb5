"""Leak test: checks that nothing accessible to participants reveals the method behind a video.

It reads the bundle as a participant could (files, bytes, MP4 boxes, times) and compares it with the
researcher's key. What can be equal must be equal; what must differ, such as names, is tested for an
order that follows the method (`app.study.design.blinding`).
"""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from app.errors import RunError
from app.study.design.blinding import NOT_RENDERED, blind_id_leaks, stimulus_ids, value_leaks
from app.study.design.key import KIND_OF_PROTOCOL, Stimulus, StudyKey, read_key
from app.study.design.plan import CHOICES, load_wording
from app.study.make import media
from app.study.make.bundle import (
    DATA,
    DATA_START,
    FREE_TEXTS,
    INDEX,
    SHARED_FILES,
    index_html,
    shared_wording,
)
from app.study.make.export_folders import ExportFolders
from model.storage.files import file_sha256

_ALLOWED_KEYS = {
    *("study", "sound", "minutes", "trials", "lists", "instruction", "questions", "words"),
    *("reasons", *FREE_TEXTS),
}
_VOCABULARY = {"kind", "press", "attention", *KIND_OF_PROTOCOL.values(), *CHOICES}
"""Words that a trial in the page's data may contain."""
_MIN_NAME_PART = 4
_SIZE_CHANCE = {"size": 0, "bit rate": 0, "unpadded size": 512, "compressed size": 64}
"""Bytes by which the videos of a scene may differ by chance, per measure.

The encoder misses its rate by a step of its quantiser in one key frame, which is much of a video of
half a second and nothing of one of ten; equally filled videos compress a little differently.
"""
_SIZE_SPREAD = {"size": 0.02, "bit rate": 0.02, "unpadded size": 0.1, "compressed size": 0.001}
"""Largest relative difference beyond chance, per measure.

Bytes without padding are those of the frames; compressed size shows other padding.
"""
_EQUAL = ("duration", "frames", "streams", "encoding", "file structure", "packet sizes")
"""Properties that must be equal in all videos of a scene."""
_MAX_FIRST_SHARE_ERROR = 0.1
_NEUTRAL_HANDLERS = {b"VideoHandler", b"SoundHandler"}
_METADATA_BOXES = {"udta", "meta", "uuid", "ilst", "mdta"}
_ENCODER_NOTES = (b"x264 - core", b"Lavf", b"Lavc")


@dataclass(frozen=True)
class ExportedStudy:
    """Export under test."""

    folders: ExportFolders
    key: StudyKey
    blind_ids: Mapping[Stimulus, str]
    """Blind ids by stimulus."""

    @cached_property
    def mp4_files(self) -> dict[Stimulus, media.Mp4]:
        """Parsed MP4 file of every video."""
        return {
            stimulus: media.read_mp4(self.folders.video(blind))
            for stimulus, blind in self.blind_ids.items()
        }

    @cached_property
    def measurements(self) -> pd.DataFrame:
        """Measurements of the videos, one row each."""
        rows = []
        for stimulus, blind in self.blind_ids.items():
            path, file = self.folders.video(blind), self.mp4_files[stimulus]
            picture = file.track("vide")
            if picture is None or picture.duration_s <= 0:
                raise RunError("A video of the bundle contains no frames.")
            stream = media.video_stream(path)
            rows.append(
                {
                    **vars(stimulus),
                    "stimulus": stimulus,
                    "size": file.num_bytes,
                    "bit rate": sum(picture.sample_sizes) / picture.duration_s,
                    "unpadded size": media.num_unpadded_bytes(stream),
                    "compressed size": len(zlib.compress(stream)),
                    "duration": str([track.duration_s for track in file.tracks]),
                    "frames": str([len(track.sample_sizes) for track in file.tracks]),
                    "streams": str([track.handler for track in file.tracks]),
                    "encoding": picture.codec_and_timing,
                    "file structure": str([box for box in file.box_types if box != "free"]),
                    "packet sizes": str(picture.sample_sizes),
                }
            )
        return pd.DataFrame(rows)

    @cached_property
    def page_data(self) -> dict[str, Any]:
        """JSON that the page's script reads."""
        text = (self.folders.bundle / DATA).read_text("utf-8")
        if not text.startswith(DATA_START):
            raise RunError(f"{DATA} was changed after the export.")
        try:
            return json.loads(text.removeprefix(DATA_START).rstrip().removesuffix(";"))
        except ValueError as error:
            raise RunError(
                f"{DATA} was changed after the export, or is damaged: {error}."
            ) from error


def find_leaks(folder: Path) -> list[str]:
    """Find what reveals the system in an export, and stray, missing or changed files.

    Returns one sentence for each leak. Raises RunError if the folder holds no finished export.
    """
    folders = ExportFolders(folder)
    if not folders.key.is_file():
        raise RunError(f"There is no study in {folder}: {folders.key} is missing.")
    key = read_key(folders.key)
    if any(video.sha256 == NOT_RENDERED for video in key.videos.values()):
        raise RunError(f"The export in {folder} is not finished; run `study export` again first.")
    study = ExportedStudy(folders, key, stimulus_ids(key))
    leaks = list(_stray_files(study))
    if leaks:  # missing or foreign files cannot be tested further
        return leaks
    return [leak for find in _CHECKS for leak in find(study)]


def _stray_files(study: ExportedStudy) -> Iterator[str]:
    """Yield files of the bundle that are unexpected, missing or changed after the export."""
    bundle = study.folders.bundle
    wanted = {INDEX, DATA, *SHARED_FILES, *(f"media/{name}.mp4" for name in study.key.videos)}
    files = {
        path.relative_to(bundle).as_posix()
        for path in bundle.rglob("*")
        if path.is_symlink() or not path.is_dir() or path != study.folders.media
    }
    for name in sorted(files - wanted):
        yield f"stray file: {name} is not part of the bundle."
    for name in sorted(wanted - files):
        yield f"missing file: {name} is part of the export, but not in the bundle."
    for name, video in study.key.videos.items():
        path = study.folders.video(name)
        if path.is_file() and file_sha256(path) != video.sha256:
            yield f"changed file: media/{name}.mp4 differs from the exported one."


def _names(study: ExportedStudy) -> Iterator[str]:
    for name in study.key.videos:
        if not re.fullmatch(r"[0-9a-f]{16}", name):
            yield f"file name: media/{name}.mp4 is not 16 random hexadecimal digits."
    yield from (f"{tell}." for tell in blind_id_leaks(study.blind_ids))


def _times(study: ExportedStudy) -> Iterator[str]:
    """Yield files with another time stamp: times would show the order of the systems."""
    bundle = study.folders.bundle
    for path in sorted(bundle.rglob("*")):
        if path.stat().st_mtime != media.FIXED_MTIME_S:
            yield (
                f"time stamp: the modification time of {path.relative_to(bundle)} differs; all "
                "files of the bundle must have the same one."
            )


def _metadata(study: ExportedStudy) -> Iterator[str]:
    secrets = [name for name in (*study.key.systems, *study.key.clips) if len(name) >= 6]
    for stimulus, file in study.mp4_files.items():
        name = f"media/{study.blind_ids[stimulus]}.mp4"
        telling = sorted(_METADATA_BOXES & set(file.box_types))
        if telling:
            yield f"metadata: {name} contains a `{telling[0]}` box, which may hold metadata."
        if file.has_timestamps:
            yield f"metadata: {name} contains its creation time."
        if set(file.handler_names) - _NEUTRAL_HANDLERS:
            names = b", ".join(file.handler_names).decode("latin-1")
            yield f"metadata: the tracks of {name} have unusual handler names ({names})."
        data = study.folders.video(study.blind_ids[stimulus]).read_bytes()
        for note in _ENCODER_NOTES:
            if note in data:
                yield f"metadata: {name} contains an encoder tag ({note.decode()})."
        for secret in secrets:
            if secret.encode().lower() in data.lower():
                yield f"metadata: {name} contains the name {secret!r}."


def _videos(study: ExportedStudy) -> Iterator[str]:
    """Yield differences within a scene, and orders of values over scenes that follow the method."""
    for _, scene in study.measurements.groupby(["clip", "view"]):
        clip = scene["clip"].iloc[0]
        for what in _EQUAL:
            if len(set(scene[what])) > 1:
                yield f"{what}: not the same in all videos of clip {clip!r}."
        for what, most in _SIZE_SPREAD.items():
            least, largest = min(scene[what]), max(scene[what])
            spread = (largest - least - _SIZE_CHANCE[what]) / max(least, 1)
            if spread > most:
                yield (
                    f"{what}: the videos of clip {clip!r} differ by {100 * spread:.3g} % (beyond a "
                    f"tolerance of {_SIZE_CHANCE[what]} bytes); at most {100 * most:g} % is "
                    "allowed."
                )
    for what in ("size", "bit rate", "unpadded size"):
        step = _SIZE_CHANCE[what]
        pairs = zip(study.measurements["stimulus"], study.measurements[what], strict=True)
        values = {stimulus: value // step if step else value for stimulus, value in pairs}
        yield from (f"{tell}." for tell in value_leaks(values, what))


def _sounds(study: ExportedStudy) -> Iterator[str]:
    """Yield videos with an unexpected audio stream, or with audio in a silent study."""
    streams: dict[str, set[str]] = {}
    for stimulus, blind in study.blind_ids.items():
        digest = media.audio_digest(study.folders.video(blind))
        if (digest is None) != (stimulus.speech_clip is None):
            state = "no sound" if digest is None else "sound in a study without sound"
            yield f"sound: media/{blind}.mp4 has {state}."
        elif digest is not None and stimulus.speech_clip is not None:
            track = study.mp4_files[stimulus].track("soun")
            stream = f"{digest} {track.codec_and_timing.hex() if track else ''}"
            streams.setdefault(stimulus.speech_clip, set()).add(stream)
    for speech, hashes in streams.items():
        if len(hashes) > 1:
            yield f"sound: the audio stream of clip {speech!r} differs between its videos."


def _lists(study: ExportedStudy) -> Iterator[str]:
    """Yield orders of ids or of videos on the screen that follow the method."""
    trials = list(study.page_data.get("trials", {}))
    if trials != sorted(trials):
        yield "JSON: the trials are not sorted by their random ids."
    excess: dict[tuple[str, bool], list[float]] = {}
    for page in (page for pages in study.page_data.get("lists", []) for page in pages):
        shown = page[1]
        for place, blind in enumerate(shown):
            video = study.key.videos.get(blind)
            if video is None:
                yield (
                    f"JSON: a participant's list of trials contains {str(blind)!r}, which is not a "
                    "video of the study."
                )
                continue
            cells = excess.setdefault((video.system, video.has_own_speech), [])
            cells.append((place == 0) - 1 / len(shown))
    for (system, _), cells in sorted(excess.items()):
        if abs(sum(cells)) > 1 + _MAX_FIRST_SHARE_ERROR * len(cells):
            num_first = sum(cell > 0 for cell in cells)
            yield (
                f"order on the screen: {system!r} is first in {num_first} of {len(cells)} trials; "
                f"a balanced order has about {num_first - sum(cells):.0f}."
            )


def _texts(study: ExportedStudy) -> Iterator[str]:
    """Yield names of systems and clips, addresses and unknown fields in the page's texts and data.

    The page's fixed files contain no word of a study and must equal those of this program.
    Sentences from `questions.toml` may contain any word. Everything else is searched: ids and
    structure for names and parts of names, the researcher's texts for whole names.
    """
    bundle, data = study.folders.bundle, study.page_data
    for name, source in SHARED_FILES.items():
        if (bundle / name).read_bytes() != source.read_bytes():
            yield f"page: {name} was changed; it differs from the version that the app exports."
    if (bundle / INDEX).read_text("utf-8") != index_html(data.get("title", ""), data.get("postTo")):
        yield f"page: {INDEX} was changed; it differs from the version that the app exports."
    for key in sorted(set(data) - _ALLOWED_KEYS):
        yield f"JSON: the page's data contain the unknown field `{key}`."
    standard = {**shared_wording(study.key.protocol), "reasons": load_wording()["reasons"]}
    parts = [data.get(key) for key in ("study", "trials", "lists")]
    parts += [data.get(key) for key in standard if data.get(key) not in (None, standard[key])]
    structure = "\n".join(sorted(set(_strings(parts)) - _VOCABULARY))
    names = {*study.key.systems, *study.key.clips}
    pieces = {part for name in names for part in re.split(r"[\s/_.,-]+", name)}
    for name in sorted(names | {part for part in pieces if len(part) >= _MIN_NAME_PART}):
        if _contains_word(structure, name):
            what = "the name" if name in names else "part of the name"
            yield (
                f"JSON: the page's data contain {name!r}, {what} of a system or clip; rename the "
                "system or clip, and export to a new folder."
            )
    for key in FREE_TEXTS:
        for name in (
            name for name in sorted(names) if _contains_word(str(data.get(key) or ""), name)
        ):
            what = "URL" if key == "postTo" else "text"
            yield (
                f"{what}: `{key}` contains {name!r}, the name of a system or clip; change the "
                "text, or rename the system or clip."
            )
    if re.search(r"https?:", structure):
        yield (
            "JSON: the page's data contain a URL, which could identify a system; remove it from "
            "the texts of the study."
        )


def _strings(value: Any) -> Iterator[str]:
    """Yield all strings and keys of a JSON value."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        yield from (key for key in value if isinstance(key, str))
        for item in value.values() if isinstance(value, dict) else value:
            yield from _strings(item)


def _contains_word(text: str, name: str) -> bool:
    """Check whether the name occurs in a text as a word, in any case."""
    return re.search(rf"(?<!\w){re.escape(name)}(?!\w)", text, re.IGNORECASE) is not None


_CHECKS = (_names, _times, _metadata, _videos, _sounds, _lists, _texts)
