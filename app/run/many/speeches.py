"""One run for each of several clips, shared out over processes or a cluster.

Each run's folder is that of a single run; ``clip.json`` comes last of all and says that the others
are whole. Started again, the same command goes on with what has none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from app.errors import RunError, sentence_of
from app.findings.verdict import jerk_over_clips, verdict_over_clips
from app.run.many.record import is_kept, keep, read_records, stamp_of
from app.run.many.table import Above, numbers_of, write_tables
from app.run.output.result_folder import held_folder, remove_unfinished
from app.run.output.run_folder import read_run
from app.run.requests.request import Ask, Done
from conventions.names import REFERENCE_NAME, printable
from model.generation.clip_noise import clip_seed
from processes.job import Job
from processes.pool import JobPool

LIST_ENDING = ".txt"
ENDINGS = (".wav", ".flac", ".mp3", ".ogg", ".opus", ".m4a", ".aac", ".webm")
RECORD = "clip.json"


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


def generate_many(
    ask: Ask,
    pool: JobPool,
    on_done: Callable[[Path, float], None] = lambda folder, share: None,
) -> ManyRuns:
    """Do an ``ask`` for each piece of speech, as `do_clips`; arguments and errors as there and of
    `asks_of`."""
    return do_clips(asks_of(ask), ask.out, pool, on_done)


def asks_of(ask: Ask) -> dict[str, Ask]:
    """One for each piece of speech, by the name of its file, as its folder has it. Each has noise
    of its own, the same for all systems; its seed stands in its provenance.

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
    plans = _plans(ask.plan, speeches)
    style = ask.style and ask.style.absolute()
    ask = replace(ask, weights=ask.weights.absolute(), style=style)
    return {
        clip: replace(
            ask,
            speech=speech,
            out=(ask.out / clip).absolute(),
            seed=clip_seed(ask.seed, clip),
            plan=plans.get(clip),
        )
        for clip, speech in speeches.items()
    }


def do_clips(
    asks: Mapping[str, Ask],
    out: Path,
    pool: JobPool,
    on_done: Callable[[Path, float], None] = lambda folder, share: None,
    do: Callable[[str, Ask], Done] | None = None,
) -> ManyRuns:
    """Do a run for each clip, in its own folder in ``out``, and leave there the tables over all
    that are done, with the verdict over them.

    Args:
        on_done: told the folder of each run as it is there, and the share done.
        do: does one in this process; by default whoever works does `app.run.pipeline.do`.

    Raises:
        CancelledRun: where ``do`` said so.
        JobsError: if those who work are lost; what is done is kept.
    """
    records = {clip: ask.out / RECORD for clip, ask in asks.items()}
    jobs = []
    for clip, ask in asks.items():
        stamp = _stamp(ask)
        done = partial(is_kept, records[clip], stamp)
        jobs.append(Job(clip, done, partial(_do_clip, clip, ask, records[clip], stamp, do)))
    kept = sum(job.is_done() for job in jobs)
    num_done = kept

    def tell(clip: str) -> None:
        nonlocal num_done
        num_done += 1
        on_done(asks[clip].out, num_done / len(jobs))

    with held_folder(out):
        failed = {clip: _sentence(error) for clip, error in pool.do_all(jobs, tell).items()}
        clips = [clip for clip in asks if clip not in failed]
        files: tuple[Path, ...] = ()
        notes: list[str] = []
        if clips:
            runs = [read_run(asks[clip].out) for clip in clips]
            verdict = verdict_over_clips(
                runs[0].point, jerk_over_clips(run.numbers for run in runs)
            )
            notes += [] if verdict is None else [verdict.text]
            numbers = read_records({clip: records[clip] for clip in clips})
            names = list(numbers[clips[0]]["systems"])
            above = Above(notes, failed)
            files = write_tables(out, names, clips, list(numbers.values()), above=above)
    return ManyRuns(tuple(clips), kept, failed, files, tuple(notes))


def find_speeches(source: Path) -> dict[str, Path]:
    """By the name that each one's results get: that of its file.

    Args:
        source: a folder of sound files, or a text file with one path a line, relative to it.

    Raises:
        RunError: if there is none, one is missing, or two have the same name.
    """
    if source.is_dir():
        found = [path for path in sorted(source.iterdir()) if path.suffix.lower() in ENDINGS]
        if not found:
            raise RunError(f"{source} has no sound file ({', '.join(ENDINGS)}).")
    else:
        found = _listed(source)
    speeches: dict[str, Path] = {}
    for path in found:
        name = printable(path.stem)
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
    known = {ending.lower() for ending in PLAN_ENDINGS}
    found = {
        path.stem: path.absolute()
        for path in sorted(folder.iterdir())
        if path.suffix.lower() in known
    }
    missing = [clip for clip in clips if clip not in found]
    if missing:
        raise RunError(f"{folder} lacks plans of {len(missing)} clips; the first is {missing[0]}.")
    return found


def _stamp(ask: Ask) -> dict[str, Any]:
    """Of everything that decides what a run's files hold; not of where they lie."""
    bare = replace(ask, speech=ask.speech and Path(ask.speech.name), out=Path(), weights=Path())
    asked = asdict(replace(bare, plan=None, style=None))
    read = {"speech": ask.speech, "plan": ask.plan, "style": ask.style}
    files = {name: path for name, path in read.items() if path is not None}
    files |= {path.name: path for path in sorted(ask.weights.glob("*.safetensors"))}
    return stamp_of(files if ask.body is None else files | {"body": ask.body}, asked)


def _do_clip(
    clip: str,
    ask: Ask,
    record: Path,
    stamp: dict[str, Any],
    do: Callable[[str, Ask], Done] | None,
) -> None:
    from app.run import pipeline

    record.unlink(missing_ok=True)  # of other files, which are about to go
    remove_unfinished(ask.out)
    result = pipeline.do(ask) if do is None else do(clip, ask)
    diagnostics = result.diagnostics
    motions = dict(diagnostics.systems)
    if diagnostics.reference is not None:
        motions[REFERENCE_NAME] = diagnostics.reference
    systems = {
        name: numbers_of(versions.raw, diagnostics.findings.get(name, ()))
        for name, versions in motions.items()
    }
    keep(record, stamp, {"frames": result.num_frames, "systems": systems})


def _sentence(error: Exception) -> str:
    sentence = sentence_of(error)
    if sentence is None:
        raise error
    return sentence
