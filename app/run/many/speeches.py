"""One run for each of several clips, shared out over processes or a cluster.

Each run's folder is that of a single run, and its `run.json` says at last of what it is whole.
Started again, the same command goes on with what is not.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from app.errors import RunError, sentence_of
from app.findings.verdict import verdict_of
from app.run.ask import Ask, Done, absolute
from app.run.many.pairing import ends_in
from app.run.many.table import write_tables
from app.run.output.result_folder import held_folder
from app.run.output.run_folder import RUN, RunRecord, read_run
from app.run.upload_check import SOUNDS
from conventions.names import REFERENCE_NAME, file_stem
from processes.job import Job
from processes.pool import JobPool

LIST_ENDING = ".txt"
ENDINGS = SOUNDS


@dataclass(frozen=True)
class ManyRuns:
    """What was written, and what could not be."""

    clips: tuple[str, ...]
    """Those that are there now."""
    kept: int
    """How many of them had been there before."""
    failed: dict[str, str]
    """A sentence by clip."""
    files: tuple[Path, ...]
    """The tables over all clips."""
    notes: tuple[str, ...] = ()
    """What they say together."""


def is_many(speech: Path) -> bool:
    """Whether a path stands for several pieces of speech."""
    return speech.is_dir() or speech.suffix.lower() == LIST_ENDING


def asks_of(ask: Ask) -> dict[str, Ask]:
    """One for each piece of speech, by the name of its file, as its folder has it.

    Args:
        ask: its speech is a folder of sound files, or a text file with one path a line.

    Raises:
        RunError: if nothing can be begun.
    """
    ask.check()
    if ask.reference is not None or ask.transcript is not None:
        raise RunError(
            "A reference and a transcript belong to one piece of speech; leave them out of a run "
            "over many, and compare with recordings by `python -m app diagnose`."
        )
    speeches = find_speeches(ask.speech or Path())
    plans, ask = _plans(ask.plan, speeches), absolute(ask)
    return {
        clip: replace(
            ask,
            speech=speech,
            out=ask.out / clip,
            plan=plans.get(clip),
        )
        for clip, speech in speeches.items()
    }


def do_clips(
    asks: Mapping[str, Ask],
    pool: JobPool,
    on_done: Callable[[Path, float], None] = lambda folder, share: None,
    do: Callable[[str, Ask], Done] | None = None,
) -> ManyRuns:
    """Do a run for each clip, in its own folder, and leave beside them the tables over all that are
    done, with the verdict over them.

    Args:
        on_done: told the folder of each run as it is there, and the share done.
        do: does one in this process; by default whoever works does `app.run.pipeline.do`.

    Raises:
        Cancelled: where ``do`` said so.
        JobsError: if those who work are lost; what is done is kept.
    """
    jobs, out = [], next(iter(asks.values())).out.parent
    for clip, ask in asks.items():
        stamp = _stamp(ask)
        done = partial(_is_done, ask.out, stamp)
        jobs.append(Job(clip, done, partial(_do_clip, clip, ask, stamp, do)))
    with held_folder(out):
        kept, failed = do_jobs(jobs, pool, lambda clip, share: on_done(asks[clip].out, share))
        clips = [clip for clip in asks if clip not in failed]
        files: tuple[Path, ...] = ()
        notes: list[str] = []
        if clips:
            runs = [read_run(asks[clip].out) for clip in clips]
            verdict = verdict_of(runs[0].point, [run.numbers for run in runs])
            notes += [] if verdict is None else [verdict.text]
            names = sorted(runs[0].numbers, key=lambda name: name == REFERENCE_NAME)
            numbers = dict(zip(clips, map(_kept, runs), strict=True))
            files, _ = write_tables(out, names, numbers, notes, failed)
    return ManyRuns(tuple(clips), kept, failed, files, tuple(notes))


def do_jobs(
    jobs: Sequence[Job], pool: JobPool, on_done: Callable[[str, float], None]
) -> tuple[int, dict[str, str]]:
    """How many of them had been done before, and why others cannot be.

    Args:
        on_done: told the name of each as it is done, and the share of all.
    """
    kept = done = sum(job.is_done() for job in jobs)

    def tell(name: str) -> None:
        nonlocal done
        done += 1
        on_done(name, done / len(jobs))

    return kept, {name: _sentence(error) for name, error in pool.do_all(jobs, tell).items()}


def find_speeches(source: Path) -> dict[str, Path]:
    """By the name that each one's results get: that of its file. Hidden files of a folder, such as
    macOS's ``._a.wav``, are left out.

    Args:
        source: a folder of sound files, or a text file with one path a line, relative to it.

    Raises:
        RunError: if there is none, one is missing, or two have the same name.
    """
    if source.is_dir():
        inside = sorted(path for path in source.iterdir() if path.is_file())
        found = [path for path in inside if ends_in(ENDINGS, Path(path.name))]
        if not found:
            raise RunError(f"{source} has no sound file ({', '.join(ENDINGS)}).")
    else:
        found = _listed(source)
    speeches: dict[str, Path] = {}
    for path in found:
        name = file_stem(path.stem)
        if name in speeches:
            raise RunError(
                f"{speeches[name]} and {path} would both be called {name!r}; rename one."
            )
        speeches[name] = path.absolute()
    return speeches


def _listed(source: Path) -> list[Path]:
    try:
        lines = [line.strip() for line in source.read_text("utf-8").splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise RunError(f"The list {source} cannot be read: {error}.") from error
    found = [source.parent / line for line in lines if line and line[0] != "#"]
    if not found:
        raise RunError(f"{source} names no sound file; it needs one path a line.")
    missing = [path for path in found if not path.is_file()]
    if missing:
        raise RunError(
            f"{source} names {len(missing)} files that are not there; the first is {missing[0]}."
        )
    return found


def _plans(folder: Path | None, clips: Iterable[str]) -> dict[str, Path]:
    """The plan of each clip: the file of its name.

    Raises:
        RunError: if it is no folder, or a clip has no plan.
    """
    from model.plan.files import ENDINGS as PLAN_ENDINGS

    if folder is None:
        return {}
    if not folder.is_dir():
        raise RunError(
            f"{folder} is no folder; many pieces of speech take a folder of plans, each named as "
            f"its speech ({', '.join(PLAN_ENDINGS)})."
        )
    known = tuple(ending.lower() for ending in PLAN_ENDINGS)
    found = {
        file_stem(path.stem): path.absolute()
        for path in sorted(folder.iterdir())
        if ends_in(known, Path(path.name))
    }
    missing = [clip for clip in clips if clip not in found]
    if missing:
        raise RunError(f"{folder} lacks plans of {len(missing)} clips; the first is {missing[0]}.")
    return found


def _stamp(ask: Ask) -> str:
    """Of everything that decides what a run's files hold; not of where they lie."""
    bare = replace(ask, speech=ask.speech and Path(ask.speech.name), out=Path(), weights=Path())
    asked = asdict(replace(bare, plan=None, style=None))
    read = {"speech": ask.speech, "plan": ask.plan, "style": ask.style}
    files = {name: path for name, path in read.items() if path is not None}
    files |= {path.name: path for path in sorted(ask.weights.glob("*.safetensors"))}
    return stamp_of(files if ask.body is None else files | {"body": ask.body}, asked)


def stamp_of(files: Mapping[str, Path], said: object) -> str:
    """Digest of what a clip's results depend on: files, by what they are, and what was asked."""
    of_files = {}
    for name, path in files.items():
        found = path.stat()
        of_files[name] = [path.name, found.st_size, found.st_mtime_ns]
    told = json.dumps({"said": said, "files": of_files}, default=str, sort_keys=True)
    return hashlib.sha256(told.encode()).hexdigest()


def _do_clip(
    clip: str,
    ask: Ask,
    stamp: str,
    do: Callable[[str, Ask], Done] | None,
) -> None:
    from app.run import pipeline

    (ask.out / RUN).unlink(missing_ok=True)  # of other files, which are about to go
    if do is None:
        pipeline.do(ask)
    else:
        do(clip, ask)
    record = read_run(ask.out)
    record.whole = stamp
    record.write(ask.out / RUN)


def _is_done(folder: Path, stamp: str) -> bool:
    try:
        return read_run(folder).whole == stamp
    except RunError:
        return False


def _kept(run: RunRecord) -> dict[str, Any]:
    """Of one clip, for the tables of all."""
    return {
        "systems": {
            name: {
                "numbers": of["raw"],
                "findings": [each.kind for each in run.findings if each.name == name],
            }
            for name, of in run.numbers.items()
        }
    }


def _sentence(error: Exception) -> str:
    sentence = sentence_of(error)
    if sentence is None:
        raise error
    return sentence
