"""Which files of several sets are of one clip, and which are samples of it.

People write samples as ``ID_sample3``, ``sample2/ID`` or ``ID/3``, speakers as folders, and results
with EMAGE's ``res_`` and ``_output``. A clip is called by its file's name, with as many folders
before it as it takes to tell the clips of each set apart.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePath, PurePosixPath

from app.errors import RunError
from conventions.names import file_stem
from model.formats.parameters import motion_files

GENERATED, RECORDED = "res_", "gt_"
"""How EMAGE's code and those after it begin the names of results, and of the recordings beside."""
OUTPUT = "_output"
"""How the results of its newer code end."""
_SAMPLE = re.compile(
    r"^(?P<clip>.+?)(?:[_.-](?:sample|seed|run)[_-]?|\.s)(?P<sample>\d{1,4})$", re.I
)
_FOLDER = re.compile(r"^(?:sample|seed|run)s?[_-]?(?P<sample>\d{1,4})$", re.I)
_BARE = re.compile(r"^(?:(?:sample|seed|run)[_-]?)?(?P<sample>\d{1,4})$", re.I)
Samples = dict[str, Path]
"""Of one clip, by what tells them apart; of one alone by nothing."""


@dataclass(frozen=True)
class _Found:
    path: Path
    parts: tuple[str, ...]
    """Folders and name of the clip."""
    sample: str = ""


def paired_files(
    folders: Mapping[str, tuple[Path, tuple[str, ...]]], recorded: Iterable[str] = ()
) -> dict[str, dict[str, Samples]]:
    """By set and clip the files of its samples. The clips of all sets are called alike.

    Args:
        folders: by the name of the set, each with the endings of its files.
        recorded: sets whose ``gt_`` files are meant, where others lie beside; they hold no samples.

    Raises:
        RunError: where two files cannot be told apart.
    """
    recorded = set(recorded)
    files = {
        name: _files(folder, RECORDED if name in recorded else GENERATED, endings)
        for name, (folder, endings) in folders.items()
    }
    clip_names = {each.parts[-1] for found in files.values() for each in found if not each.sample}
    numbers_are_clips = any(
        map(_is_numbered, (f for name in recorded for f in files.get(name, ())))
    )
    files = {
        name: found if name in recorded else _of_folders(found, clip_names, numbers_are_clips)
        for name, found in files.items()
    }
    deepest = max((len(each.parts) for found in files.values() for each in found), default=1)
    for depth in range(1, deepest + 1):
        clips = {name: _clips(found, depth) for name, found in files.items()}
        if all(twice is None for _, twice in clips.values()):
            break
    for name, (_, twice) in clips.items():
        if twice is not None:
            folder = folders[name][0]
            one, other = (path.relative_to(folder) for path in twice)
            raise RunError(
                f"Two files of {name} would both be called {_read(twice[0], one).parts[-1]!r}: "
                f"{one} and {other}. Rename one."
            )
    return {name: found for name, (found, _) in clips.items()}


def no_pair(files: Mapping[str, Mapping[str, Samples]]) -> RunError:
    """Where sets share no clip; names some of each."""
    some = "; ".join(
        f"{name} has {', '.join(sorted(clips)[:3]) or 'none'}" for name, clips in files.items()
    )
    return RunError(
        f"No file name is in all of {', '.join(files)}; clips are paired by name: {some}."
    )


def first_of(samples: Samples) -> Path:
    """The file of the first sample."""
    return samples[min(samples, key=lambda sample: (len(sample), sample))]


def some_of(names: Iterable[str]) -> str:
    """A few of many names."""
    names = sorted(names)
    more = f" and {len(names) - 5} more" if len(names) > 5 else ""
    return ", ".join(names[:5]) + more


def _files(folder: Path, kind: str, endings: tuple[str, ...]) -> list[_Found]:
    """Where results and recordings lie side by side, those of the kind that is asked."""
    files = [(path, name) for path, name in motion_files(folder) if ends_in(endings, name)]
    if any(name.name.startswith(kind) for _, name in files):
        files = [(path, name) for path, name in files if name.name.startswith(kind)]
    return [_read(path, name) for path, name in files]


def ends_in(endings: tuple[str, ...], path: PurePath) -> bool:
    """Whether a file of a folder has one of these endings, and is not hidden."""
    return path.suffix.lower() in endings and not is_hidden(path)


def is_hidden(path: PurePath) -> bool:
    """Whether nobody means it who gives the folder."""
    return any(part.startswith((".", "__MACOSX")) for part in path.parts)


def _read(path: Path, inside: Path) -> _Found:
    stem = inside.stem.removeprefix(GENERATED).removeprefix(RECORDED)
    stem = stem.removesuffix(OUTPUT) or stem
    folders = [file_stem(part) for part in inside.parent.parts]
    if named := _SAMPLE.match(stem):
        return _Found(path, (*folders, file_stem(named["clip"])), named["sample"])
    samples = [place for place, part in enumerate(folders) if _FOLDER.match(part)]
    if samples:
        sample = folders.pop(samples[-1])
        return _Found(path, (*folders, file_stem(stem)), _number(_FOLDER, sample))
    return _Found(path, (*folders, file_stem(stem)))


def _is_numbered(found: _Found) -> bool:
    """Whether it is called by a number alone, in a folder."""
    return not found.sample and len(found.parts) > 1 and bool(_BARE.match(found.parts[-1]))


def _of_folders(files: list[_Found], clip_names: set[str], numbers_are_clips: bool) -> list[_Found]:
    """Files called by a number alone are samples of the clip that their folder is called after, if
    there is one, or if all files are called so and no recording is."""
    all_are = not numbers_are_clips and all(map(_is_numbered, files))
    return [
        _Found(each.path, each.parts[:-1], _number(_BARE, each.parts[-1]))
        if _is_numbered(each) and (all_are or each.parts[-2] in clip_names)
        else each
        for each in files
    ]


def _number(pattern: re.Pattern[str], text: str) -> str:
    match = pattern.match(text)
    assert match is not None
    return match["sample"]


def _clips(found: list[_Found], depth: int) -> tuple[dict[str, Samples], tuple[Path, Path] | None]:
    """By name of so many parts; and two files that such names cannot tell apart."""
    clips: dict[str, Samples] = {}
    for each in found:
        clip = str(PurePosixPath(*each.parts[-depth:]))
        samples = clips.setdefault(clip, {})
        other = samples.get(each.sample, each.path)
        if (other.parent, other.stem) != (each.path.parent, each.path.stem):
            return clips, (other, each.path)
        samples[each.sample] = each.path
    return clips, None
