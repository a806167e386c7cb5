"""Check of sets against the rules of the GENEA leaderboard: clips, formats, lengths, samples.

The leaderboard requires motion of every recording of BEAT2's English test set, as SMPL-X parameters
like BEAT2's, with the recording's length, and five samples of each from a probabilistic system.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from app.errors import RunError
from app.run.batch.archives import archive_stem, unpack_archives
from app.run.batch.pairing import SampleFiles, pair_files, shorten_list
from app.run.output.result_folder import ResultFolder
from conventions.names import REFERENCE_NAME, printable
from conventions.rates import FPS
from model.formats.read import ENDINGS, read_any_motion
from model.motion.motion import load_motion
from model.storage.files import file_sha256
from model.storage.npz import MotionError

SAMPLES = 5
SPLIT = "train_test_split.csv"
_MAX_FRAME_DIFFERENCE = 1


@dataclass(frozen=True)
class SubmissionReport:
    """Result of the check of one set."""

    messages: list[str]
    """Sentences for the user, the most severe first, or one if there is no problem."""
    missing_and_extra: list[str]
    """Missing and surplus clips."""
    is_valid: bool


def check_sets(
    folders: tuple[Path, ...], reference: Path | None, out: Path
) -> dict[str, SubmissionReport]:
    """Check sets against the leaderboard's rules, write ``check.md``, and return results by set.

    The reference is the recorded test clips, as a folder or archive, or BEAT2's folder with its
    test split. Raises RunError without it, for anything that is not a set, or a hostile archive.
    """
    if reference is None:
        raise RunError(
            "--check genea compares your clips' names and lengths with the recorded test clips; "
            "give those as well (--reference FOLDER: BEAT2's folder, or one with only the test "
            "clips)."
        )
    sets = [(path, ENDINGS) for path in (*folders, reference)]
    with ResultFolder(out) as results:
        opened = unpack_archives(sets, results.scratch("sets"))
        recorded = opened.get(reference, reference)
        named = {_name_of(path): opened.get(path, path) for path in folders}
        if len(named) < len(folders) or REFERENCE_NAME in named:
            raise RunError("Two sets have the same name, or one is called 'reference'; rename one.")
        for folder in (*named.values(), recorded):
            if not folder.is_dir():
                raise RunError(
                    f"--check needs a folder or archive of all clips of a system; {folder} is "
                    "neither."
                )
        checks = {name: _checked(name, folder, recorded) for name, folder in named.items()}
        lines = ["# Check against the rules of the GENEA leaderboard", ""]
        for each in checks.values():
            lines += [f"- {line}" for line in each.messages] + [
                f"  - {clip}" for clip in each.missing_and_extra
            ]
        results.new_path("check.md").write_text("\n".join(lines) + "\n", "utf-8")
        results.publish()
    return checks


def _name_of(path: Path) -> str:
    return printable(archive_stem(path) if path.is_file() else path.resolve().name)


def _of_test_split(clips: Mapping[str, SampleFiles], folder: Path) -> dict[str, Path]:
    """Return the recorded clips of the test split; without one, all."""
    split = next((each for each in (folder, folder.parent) if (each / SPLIT).is_file()), None)
    wanted = {clip: next(iter(samples.values())) for clip, samples in clips.items()}
    if split is not None:
        with (split / SPLIT).open(newline="", encoding="utf-8") as file:
            test = {row["id"] for row in csv.DictReader(file) if row.get("type") == "test"}
        wanted = {clip: path for clip, path in wanted.items() if clip in test}
    if not wanted:
        raise RunError(f"{folder} contains no recorded test clips ({', '.join(ENDINGS)}).")
    return wanted


def _checked(name: str, folder: Path, recorded: Path) -> SubmissionReport:
    sets = {name: (folder, ENDINGS), REFERENCE_NAME: (recorded, ENDINGS)}
    files_of = pair_files(sets, (REFERENCE_NAME,))
    present, wanted = files_of[name], _of_test_split(files_of[REFERENCE_NAME], recorded)
    counts = {clip: len(present[clip]) for clip in sorted(present.keys() & wanted.keys())}
    most = max(counts.values(), default=0)
    uneven = [clip for clip, count in counts.items() if count != most]
    missing, extra = sorted(wanted.keys() - present.keys()), sorted(present.keys() - wanted.keys())
    files: dict[str, list[str]] = {}
    for clip in counts:
        for file, why in _wrong_files(folder, present[clip], wanted[clip]).items():
            files.setdefault(why, []).append(file)
    problems = []
    if uneven:
        problems.append(f"clips with fewer than {most} samples: {shorten_list(uneven)}.")
    if most not in (0, 1, SAMPLES):
        problems.append(
            f"it has {most} samples per clip; a probabilistic system must submit {SAMPLES}, a "
            "deterministic one 1."
        )
    if missing:
        problems.append(f"missing clips ({len(missing)}): {shorten_list(missing)}.")
    if extra:
        problems.append(
            f"clips to remove, as they are not in the test set ({len(extra)}): "
            f"{shorten_list(extra)}."
        )
    problems += [f"{shorten_list(named)}: {why}" for why, named in files.items()]
    random = f", with {most} samples each," if most > 1 else ""
    right = f"all {len(counts)} clips{random} meet the leaderboard's rules."
    return SubmissionReport(
        [f"{name}: {sentence}" for sentence in problems or [right]],
        [*(f"Missing: {clip}" for clip in missing), *(f"Extra: {clip}" for clip in extra)],
        is_valid=not problems,
    )


def _wrong_files(folder: Path, samples: SampleFiles, recorded: Path) -> dict[str, str]:
    frames = read_any_motion(recorded).motion.num_frames
    wrong: dict[str, str] = {}
    names_by_digest: dict[str, str] = {}
    for path in samples.values():
        name = str(path.relative_to(folder))
        try:
            motion = load_motion(path)
        except MotionError as error:
            wrong[name] = str(error).replace(f"{path.name} ", "it ", 1)
            continue
        if abs(motion.num_frames - frames) > _MAX_FRAME_DIFFERENCE:
            wrong[name] = (
                f"{motion.num_frames} frames, but the recording has {frames} (at {FPS} frames per "
                "second)."
            )
        other = names_by_digest.setdefault(file_sha256(path), name)
        if other != name:
            wrong[name] = f"it is identical to {other}; samples must differ."
    return wrong
