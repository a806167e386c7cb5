"""Folders of motion files beside each other: each measure with an interval over clips.

Files are paired by name. Each clip is measured by one process, as it is, and its numbers are kept
in ``clips``, so that a run that was stopped goes on where it was. Intervals say how much the mean
would vary with other clips of the same kind, not with other seeds or speakers.
"""

from __future__ import annotations

import csv
import json
import multiprocessing
import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from app.errors import RunError
from app.findings.measure_rows import MEASURES
from app.run.request import REFERENCE_NAME

ENDINGS = (".npz", ".npy", ".bvh")
HEADER = (
    *("measure", "unit", "system", "clips", "mean", "low", "high"),
    *("difference_to", "difference", "difference_low", "difference_high"),
)


@dataclass(frozen=True)
class ManyRequest:
    """Which folders to measure, beside what."""

    folders: tuple[Path, ...]
    out: Path
    reference: Path | None = None
    fps: float | None = None
    rotations: Any = None
    processes: int | None = None
    """All cores by default."""


@dataclass(frozen=True)
class ManyResult:
    """What was written, and must be said."""

    files: tuple[Path, ...]
    notes: tuple[str, ...]
    clips: tuple[str, ...]


def diagnose_folders(
    request: ManyRequest, on_progress: Callable[[float], None] = lambda share: None
) -> ManyResult:
    """Measure all clips that every folder has, and leave ``many.csv``, ``many.json`` and
    ``sheet.md`` in ``request.out``.

    Raises:
        RunError: where folders have no clip in common, or a folder is none.
        MotionError: for a file that cannot be read; clips measured so far are kept.
    """
    folders = _named_folders(request)
    files = {name: _files(folder) for name, folder in folders.items()}
    clips = sorted(set.intersection(*(set(found) for found in files.values())))
    if not clips:
        raise RunError(f"No file name is in all of {', '.join(files)}; clips are paired by name.")
    notes = [
        f"{name}: {len(found) - len(clips)} of {len(found)} files have no partner of that name."
        for name, found in files.items()
        if len(found) > len(clips)
    ]
    kept = request.out / "clips"
    kept.mkdir(parents=True, exist_ok=True)
    tasks = {clip: {name: found[clip] for name, found in files.items()} for clip in clips}
    waiting = [clip for clip in clips if not _is_known(kept / f"{clip}.json", tasks[clip], request)]
    if len(waiting) < len(clips):
        notes.append(f"{len(clips) - len(waiting)} clips had been measured before and were kept.")
    # A forked process would share torch's threads; a new one imports them.
    context = multiprocessing.get_context("spawn")
    workers = min(request.processes or os.cpu_count() or 1, max(1, len(waiting)))
    with ProcessPoolExecutor(workers, mp_context=context, initializer=_one_thread) as pool:
        running = [
            pool.submit(_measure_clip, tasks[clip], request, kept / f"{clip}.json")
            for clip in waiting
        ]
        try:
            for done, future in enumerate(as_completed(running), start=1):
                future.result()
                on_progress(done / len(running))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    numbers = [json.loads((kept / f"{clip}.json").read_text()) for clip in clips]
    written = _write(request.out, list(files), clips, numbers)
    return ManyResult(written, tuple(notes), tuple(clips))


def _named_folders(request: ManyRequest) -> dict[str, Path]:
    folders = {folder.resolve().name: folder for folder in request.folders}
    if len(folders) < len(request.folders) or REFERENCE_NAME in folders:
        raise RunError("Two folders have the same name, or one is called 'reference'; rename one.")
    if request.reference is not None:
        folders[REFERENCE_NAME] = request.reference
    wrong = next((folder for folder in folders.values() if not folder.is_dir()), None)
    if wrong is not None:
        raise RunError(f"{wrong} is no folder; give folders only, or files only.")
    return folders


def _files(folder: Path) -> dict[str, Path]:
    return {path.stem: path for path in sorted(folder.iterdir()) if path.suffix in ENDINGS}


def _one_thread() -> None:
    import torch

    torch.set_num_threads(1)


def _stamp(files: dict[str, Path], request: ManyRequest) -> dict[str, Any]:
    """What a kept clip's numbers depend on."""
    said = [request.fps, request.rotations]
    of_files = {}
    for name, path in files.items():
        found = path.stat()
        of_files[name] = [path.name, found.st_size, found.st_mtime_ns]
    return {"said": said, "files": of_files}


def _is_known(path: Path, files: dict[str, Path], request: ManyRequest) -> bool:
    """Whether a clip's numbers are there, whole, and of these very files."""
    try:
        return json.loads(path.read_text()).get("stamp") == _stamp(files, request)
    except (OSError, ValueError):
        return False


def _measure_clip(files: dict[str, Path], request: ManyRequest, out: Path) -> None:
    """All systems of one clip beside its reference, over the frames that all have."""
    from model.formats.numbers import ReadOptions
    from model.formats.read import read_any_motion
    from model.measures.diagnostics import raw_evidence
    from model.measures.faults.table import find_faults
    from model.motion.motion import first_frames
    from model.motion.skeleton import open_body_skeleton
    from model.storage.files import written_atomically

    said = ReadOptions(request.fps, request.rotations)
    motions = {name: read_any_motion(path, said).motion for name, path in files.items()}
    shortest = min(motion.num_frames for motion in motions.values())
    reference = None
    content: dict[str, Any] = {"stamp": _stamp(files, request), "frames": shortest, "systems": {}}
    for name in sorted(motions, key=lambda name: name != REFERENCE_NAME):  # the reference first
        motion = first_frames(motions[name], shortest)
        evidence = raw_evidence(motion, open_body_skeleton(), reference)
        values = [row.read(evidence.raw) for row in MEASURES]
        content["systems"][name] = {
            "values": [
                None if value is None or not np.isfinite(value) else row.scale * float(value)
                for row, value in zip(MEASURES, values, strict=True)
            ],
            "findings": [finding.kind for finding in find_faults(evidence)],
        }
        if name == REFERENCE_NAME:
            reference = evidence
    with written_atomically(out) as temporary:
        Path(temporary).write_text(json.dumps(content, allow_nan=False) + "\n")


def interval(values: Sequence[float]) -> tuple[float, float, float]:
    """Mean over clips and its 95 % bootstrap interval; the mean alone for a single clip."""
    from model.evaluation.intervals import bootstrap

    found = bootstrap(values)
    return found.mean, found.low, found.high


def _write(
    out: Path, systems: list[str], clips: list[str], numbers: list[dict[str, Any]]
) -> tuple[Path, ...]:
    rows = list(_rows(systems, numbers))
    table, sheet, content = out / "many.csv", out / "sheet.md", out / "many.json"
    with table.open("w", newline="") as file:
        csv.writer(file).writerows([HEADER, *rows])
    kinds = {
        name: Counter(kind for each in numbers for kind in set(each["systems"][name]["findings"]))
        for name in systems
    }
    named = [dict(zip(HEADER, row, strict=True)) for row in rows]
    findings = {name: dict(found.most_common()) for name, found in kinds.items()}
    told = {"clips": clips, "measures": named, "clips_with_finding": findings}
    content.write_text(json.dumps(told, indent=1, allow_nan=False) + "\n")
    sheet.write_text(_sheet(systems, len(clips), named, findings))
    return table, content, sheet


def _rows(systems: list[str], numbers: list[dict[str, Any]]) -> Iterator[tuple[Any, ...]]:
    for place, measure in enumerate(MEASURES):
        values = {
            name: [each["systems"][name]["values"][place] for each in numbers] for name in systems
        }
        title = f"{measure.group}: {measure.title}"
        for name in systems:
            known = [value for value in values[name] if value is not None]
            if not known:
                continue
            yield (title, measure.unit, name, len(known), *interval(known), *[""] * 4)
            for other in systems[systems.index(name) + 1 :]:
                pairs = [
                    a - b
                    for a, b in zip(values[name], values[other], strict=True)
                    if a is not None and b is not None
                ]
                if pairs:
                    difference = (other, *interval(pairs))
                    yield (title, measure.unit, name, len(pairs), "", "", "", *difference)


def _sheet(
    systems: list[str],
    clips: int,
    rows: list[dict[str, Any]],
    findings: dict[str, dict[str, int]],
) -> str:
    """Means with their intervals, a star where the paired difference to the last is not chance."""
    last = systems[-1]
    lines = [
        f"# {clips} clips",
        "",
        "Mean over clips [95 % bootstrap interval over clips], as generated, never filtered. `*`:"
        f" the interval of the paired difference to {last} leaves out 0. Differences of all pairs"
        " are in `many.csv`.",
        "",
        "| measure | " + " | ".join(systems) + " |",
        "|---|" + "---|" * len(systems),
    ]
    for title in dict.fromkeys(row["measure"] for row in rows):
        own = [row for row in rows if row["measure"] == title]
        unit = own[0]["unit"]
        cells = []
        for name in systems:
            by_other = {row["difference_to"]: row for row in own if row["system"] == name}
            mean, apart = by_other.get(""), by_other.get(last)
            star = apart and (apart["difference_low"] > 0 or apart["difference_high"] < 0)
            told = "n/a"
            if mean is not None:
                told = f"{mean['mean']:.3g} [{mean['low']:.3g}, {mean['high']:.3g}]"
            cells.append(f"{told}*" if star else told)
        lines.append(f"| {title}{f' ({unit})' if unit else ''} | " + " | ".join(cells) + " |")
    kinds = sorted({kind for found in findings.values() for kind in found})
    if kinds:
        lines += [
            "",
            "| clips with | " + " | ".join(systems) + " |",
            "|---|" + "---|" * len(systems),
        ]
        for kind in kinds:
            counts = [str(findings[name].get(kind, 0)) for name in systems]
            lines.append(f"| {kind} | " + " | ".join(counts) + " |")
    return "\n".join(lines) + "\n"
