"""Pairing of the files of several sets by clip and sample.

Samples are named ``ID_sample3``, ``sample2/ID`` or ``ID/3``, speakers are folders, and results of
EMAGE's code have ``res_`` and ``_output``. The name of a clip is that of its file, with as many
parent folders as it takes to distinguish the clips of each set.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePath, PurePosixPath

from app.errors import RunError
from conventions.names import safe_file_stem
from model.formats.parameters import files_with_motion_names

GENERATED, RECORDED = "res_", "gt_"
"""File name prefixes of results and of recordings, by EMAGE's code and its successors."""
EMAGE_OUTPUT_SUFFIX = "_output"
"""File name suffix of results of its newer code."""
_SAMPLE = re.compile(
    r"^(?P<clip>.+?)(?:[_.-](?:sample|seed|run)[_-]?|\.s)(?P<sample>\d{1,4})$", re.I
)
_FOLDER = re.compile(r"^(?:sample|seed|run)s?[_-]?(?P<sample>\d{1,4})$", re.I)
_BARE = re.compile(r"^(?:(?:sample|seed|run)[_-]?)?(?P<sample>\d{1,4})$", re.I)
SampleFiles = dict[str, Path]
"""Files of one clip by sample; the key of a single one is empty."""


@dataclass(frozen=True)
class _PairedFile:
    path: Path
    parts: tuple[str, ...]
    """Parent folders and name of the clip."""
    sample: str = ""


def pair_files(
    folders: Mapping[str, tuple[Path, tuple[str, ...]]], recorded: Iterable[str] = ()
) -> dict[str, dict[str, SampleFiles]]:
    """Pair the files of several sets, by set, clip and sample.

    Args:
        folders: folder and suffixes of each set.
        recorded: sets whose ``gt_`` files are used, if there are others; they have no samples.

    Raises:
        RunError: if two files have the same name.
    """
    recorded = set(recorded)
    files = {
        name: _files(folder, RECORDED if name in recorded else GENERATED, endings)
        for name, (folder, endings) in folders.items()
    }
    clip_names = {each.parts[-1] for paths in files.values() for each in paths if not each.sample}
    numbers_are_clips = any(map(_is_numbered, (f for one in recorded for f in files.get(one, ()))))
    files = {
        name: paths if name in recorded else _of_folders(paths, clip_names, numbers_are_clips)
        for name, paths in files.items()
    }
    deepest = max((len(each.parts) for paths in files.values() for each in paths), default=1)
    for depth in range(1, deepest + 1):
        clips = {name: _clips(paths, depth) for name, paths in files.items()}
        if all(twice is None for _, twice in clips.values()):
            break
    for name, (_, twice) in clips.items():
        if twice is not None:
            folder = folders[name][0]
            one, other = (path.relative_to(folder) for path in twice)
            raise RunError(
                f"Two files of {name} have the same clip name {_read(twice[0], one).parts[-1]!r}: "
                f"{one} and {other}. Rename one."
            )
    return {name: paths for name, (paths, _) in clips.items()}


def no_common_clips_error(files: Mapping[str, Mapping[str, SampleFiles]]) -> RunError:
    """Return the error for sets without a common clip, naming some clips of each."""
    some = "; ".join(
        f"{name} has, for example, {', '.join(sorted(clips)[:3])}" if clips else f"{name} has none"
        for name, clips in files.items()
    )
    return RunError(
        f"No clip is in all sets ({', '.join(files)}). Clips are paired by file name: {some}."
    )


def first_sample_file(samples: SampleFiles) -> Path:
    """Return the file of the first sample."""
    return samples[min(samples, key=lambda sample: (len(sample), sample))]


def shorten_list(names: Iterable[str]) -> str:
    """Format a few of many names."""
    names = sorted(names)
    more = f" and {len(names) - 5} more" if len(names) > 5 else ""
    return ", ".join(names[:5]) + more


def _files(folder: Path, kind: str, endings: tuple[str, ...]) -> list[_PairedFile]:
    """Find the files of a set; of results and recordings side by side, those of one kind."""
    files = [
        (path, name)
        for path, name in files_with_motion_names(folder)
        if is_visible_with_suffix(endings, name)
    ]
    if any(name.name.startswith(kind) for _, name in files):
        files = [(path, name) for path, name in files if name.name.startswith(kind)]
    return [_read(path, name) for path, name in files]


def is_visible_with_suffix(endings: tuple[str, ...], path: PurePath) -> bool:
    """Check whether a file has one of these suffixes, and is not hidden."""
    return path.suffix.lower() in endings and not is_hidden(path)


def is_hidden(path: PurePath) -> bool:
    """Check whether a path is hidden, or made by macOS."""
    return any(part.startswith((".", "__MACOSX")) for part in path.parts)


def _read(path: Path, inside: Path) -> _PairedFile:
    stem = inside.stem.removeprefix(GENERATED).removeprefix(RECORDED)
    stem = stem.removesuffix(EMAGE_OUTPUT_SUFFIX) or stem
    folders = [safe_file_stem(part) for part in inside.parent.parts]
    if named := _SAMPLE.match(stem):
        return _PairedFile(path, (*folders, safe_file_stem(named["clip"])), named["sample"])
    samples = [place for place, part in enumerate(folders) if _FOLDER.match(part)]
    if samples:
        sample = folders.pop(samples[-1])
        return _PairedFile(path, (*folders, safe_file_stem(stem)), _number(_FOLDER, sample))
    return _PairedFile(path, (*folders, safe_file_stem(stem)))


def _is_numbered(file: _PairedFile) -> bool:
    """Check whether a file in a folder is named only by a number."""
    return not file.sample and len(file.parts) > 1 and bool(_BARE.match(file.parts[-1]))


def _of_folders(
    files: list[_PairedFile], clip_names: set[str], numbers_are_clips: bool
) -> list[_PairedFile]:
    """Convert files named by a number to samples of the clip that their folder is named after.

    There must be such a clip, or else all files are named so and no recording is.
    """
    all_are = not numbers_are_clips and all(map(_is_numbered, files))
    return [
        _PairedFile(each.path, each.parts[:-1], _number(_BARE, each.parts[-1]))
        if _is_numbered(each) and (all_are or each.parts[-2] in clip_names)
        else each
        for each in files
    ]


def _number(pattern: re.Pattern[str], text: str) -> str:
    match = pattern.match(text)
    assert match is not None
    return match["sample"]


def _clips(
    files: list[_PairedFile], depth: int
) -> tuple[dict[str, SampleFiles], tuple[Path, Path] | None]:
    """Return clips by names of ``depth`` parts, and two files that these do not distinguish."""
    clips: dict[str, SampleFiles] = {}
    for each in files:
        clip = str(PurePosixPath(*each.parts[-depth:]))
        samples = clips.setdefault(clip, {})
        other = samples.get(each.sample, each.path)
        if (other.parent, other.stem) != (each.path.parent, each.path.stem):
            return clips, (other, each.path)
        samples[each.sample] = each.path
    return clips, None
