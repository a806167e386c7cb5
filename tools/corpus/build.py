"""Building of the corpus (``python -m tools.corpus``): the list of clips and their making."""

import errno
import json
import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from tqdm import tqdm

from model.storage.files import WriteError
from processes.job import Job, JobsError
from processes.pool import JobPool
from tools.command import run_cli
from tools.corpus import clip
from tools.corpus.people.rig import open_body_rig
from tools.corpus.people.speaker import SPEAKERS, Speaker, VoiceError, require_flite
from tools.corpus.words.grammar import Split

FORMAT = 3  # raised whenever the same seed gives other bytes
MANIFEST = "corpus.json"
CLIP_S = 60.0
MAX_HOURS = 1000.0


class CorpusError(ValueError):
    """Error for a corpus that cannot be made, with the reason and the way out."""


@dataclass(frozen=True)
class ClipJob:
    """Job of making one clip; picklable, with everything that a worker needs."""

    root: Path
    seed: int
    index: int
    clip_s: float
    speaker: Speaker
    split: Split

    @property
    def clip_id(self) -> str:
        return f"{self.speaker.number}_{self.speaker.name}_0_{self.index}_{self.index}"

    def is_done(self) -> bool:
        return clip.clip_paths(self.root, self.clip_id).all_exist()


def main(arguments: list[str] | None = None) -> int:
    return run_cli(build_corpus, "tools.corpus", arguments, CorpusError, VoiceError)


def build_corpus(out: Path, hours: float, seed: int, workers: int = os.cpu_count() or 1) -> None:
    """Make a corpus of speech and co-speech motion in BEAT2's layout.

    The same hours and seed give the same bytes with any number of workers. A folder of the same
    seed is continued, also with more hours than before.

    Args:
        out: Folder of the corpus.
        hours: Length of the corpus; clips last about a minute each.
        seed: Random seed; the same seed gives the same bytes.
        workers: Number of processes.

    Raises:
        CorpusError: for bad numbers, a folder of another corpus, or a full disk.
        VoiceError: where flite is missing or fails.
    """
    if not 0 < hours <= MAX_HOURS:
        raise CorpusError(f"--hours must be above 0 and at most {MAX_HOURS:g}; found {hours:g}.")
    if seed < 0:
        raise CorpusError(f"--seed must be 0 or more; found {seed}.")
    if workers < 1:
        raise CorpusError(f"--workers must be at least 1; found {workers}.")
    require_flite()
    jobs = plan_jobs(out, hours, seed)
    try:
        _claim_folder(out, seed, jobs[0].clip_s)
        _make_clips(jobs, workers)
        rows = [(job.clip_id, job.split) for job in jobs]
        clip.write_bytes(out / clip.SPLIT_TABLE, clip.split_table(rows).encode())
    except KeyboardInterrupt:
        raise CorpusError("Interrupted; the same command continues where it stopped.") from None
    except WriteError as error:
        is_full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        need = " An hour takes about 230 MB; the same command continues." if is_full else ""
        raise CorpusError(f"{error}{need}") from error


def plan_jobs(root: Path, hours: float, seed: int) -> list[ClipJob]:
    """List the clips in order: speakers alternate, held-out speakers in every third round.

    In each block of ten rounds a speaker has eight training clips, one validation and one test
    clip; the held-out speakers have test clips only.
    """
    count = max(1, round(hours * 3600 / CLIP_S))
    clip_s = min(CLIP_S, hours * 3600)
    jobs: list[ClipJob] = []
    turn = 0
    while len(jobs) < count:
        for place, speaker in enumerate(SPEAKERS):
            if speaker.held_out and turn % 3 != 2:
                continue
            split = "test" if speaker.held_out else _split_for(turn, place)
            if len(jobs) < count:
                jobs.append(ClipJob(root, seed, len(jobs), clip_s, speaker, split))
        turn += 1
    return jobs


def _split_for(turn: int, place: int) -> Split:
    slot = (turn + 3 * place) % 10
    return "val" if slot == 4 else "test" if slot == 9 else "train"


def _claim_folder(root: Path, seed: int, clip_s: float) -> None:
    """Check that a folder is empty or holds this corpus, and mark an empty one."""
    manifest = root / MANIFEST
    wanted = {"format": FORMAT, "seed": seed, "clip_s": clip_s}
    if manifest.is_file():
        existing = read_manifest(manifest)
        if existing["format"] != FORMAT:
            raise CorpusError(
                f"{root} holds a corpus of format {existing['format']}, and this version makes"
                f" format {FORMAT}; choose another folder."
            )
        if existing != wanted:
            raise CorpusError(
                f"{root} holds another corpus ({_describe(existing)}; requested: "
                f"{_describe(wanted)}); choose another folder, or the same seed to continue that "
                "one."
            )
    elif root.is_dir() and any(root.iterdir()):
        raise CorpusError(f"{root} is not empty and holds no corpus; choose another folder.")
    else:
        clip.write_bytes(manifest, (json.dumps(wanted, indent=1) + "\n").encode())


def read_manifest(path: Path) -> dict[str, int | float]:
    """Read format, seed and clip length from a corpus's manifest."""
    try:
        manifest = json.loads(path.read_text())
        return {key: manifest[key] for key in ("format", "seed", "clip_s")}
    except (ValueError, TypeError, KeyError) as error:
        raise CorpusError(f"{path} is not readable; choose another folder.") from error


def _describe(manifest: dict) -> str:
    return ", ".join(f"{key} {value}" for key, value in manifest.items())


def _make_clips(jobs: list[ClipJob], workers: int) -> None:
    done = sum(job.is_done() for job in jobs)
    pieces = [Job(job.clip_id, job.is_done, partial(make_job, job)) for job in jobs]
    with tqdm(total=len(jobs), initial=done, unit="clip", desc="Corpus", delay=1) as bar:
        try:
            failed = JobPool(workers).run_all(pieces, lambda _: bar.update())
        except JobsError as error:
            raise CorpusError(str(error)) from error
    for error in failed.values():
        raise error


def make_job(job: ClipJob) -> None:
    clip.write_clip(job.root, job.clip_id, make_clip_of_job(job))


def make_clip_of_job(job: ClipJob) -> clip.CorpusClip:
    seed = [job.seed, job.index]
    length_s = job.clip_s * (0.87 + 0.26 * ((job.index * 0.618) % 1.0))
    return clip.make_clip(open_body_rig(), job.speaker, job.split, length_s, seed)
