"""``python -m tools.corpus.report --data DIR [--real DIR] [--out FILE]``: the corpus in figures.

Writes a Markdown page with the statistics of the speakers beside those of real clips, how well the
corpus is told from real motion, and a picture of gestures beside it.
"""

import sys
from pathlib import Path

import pandas as pd
from tqdm import tqdm

from model.storage.files import written_atomically
from model.storage.npz import MotionError
from tools.command import called
from tools.corpus.build import MANIFEST, CorpusError, read_manifest
from tools.corpus.clip import MOTION, SPLIT_TABLE, ClipPaths, clip_paths
from tools.corpus.people.rig import Rig, open_body_rig
from tools.corpus.report.page import draw_gestures, report_page
from tools.corpus.report.realism import MeasuredClip, measure_clip


class ReportError(ValueError):
    """A report that cannot be made."""


def write_report(
    data: Path, real: Path | None = None, out: Path = Path("docs/corpus.md"), clips: int = 8
) -> None:
    """Describe a corpus in figures, on a page with a picture of its gestures beside it.

    Args:
        data: Corpus folder.
        real: Folder of real BEAT2 clips to compare with.
        out: The page.
        clips: Of each speaker, and real ones.
    """
    rig = open_body_rig()
    by_speaker: dict[str, list[str]] = {}
    found = list_clips(data)
    for clip_id in found:
        by_speaker.setdefault(clip_id.split("_")[1], []).append(clip_id)
    chosen = {each: found[each] for ids in by_speaker.values() for each in ids[:clips]}
    real_clips: list[MeasuredClip] = []
    if real is not None:
        first = dict(list(list_clips(real).items())[:clips])
        real_clips = measure_clips(first, rig, "Measuring real clips")
    measured = measure_clips(chosen, rig, "Measuring the corpus")
    manifest = data / MANIFEST
    seed = int(read_manifest(manifest)["seed"]) if manifest.is_file() else None
    draw_gestures(rig, out.parent / "figures" / "corpus_gestures.png")
    with written_atomically(out) as path:
        path.write_text(report_page(measured, real_clips, seed), encoding="utf-8")


def list_clips(root: Path) -> dict[str, ClipPaths]:
    """By id the clips in the table of splits that have motion.

    Raises:
        ReportError: if there are none.
    """
    table = root / SPLIT_TABLE
    ids = pd.read_csv(table, dtype=str)["id"] if table.is_file() else ()
    clips = {each: clip_paths(root, each) for each in ids}
    there = {each: paths for each, paths in clips.items() if paths.motion.is_file()}
    if not there:
        raise ReportError(f"{root} holds no clips in BEAT2's layout ({MOTION}, {SPLIT_TABLE}).")
    return there


def measure_clips(clips: dict[str, ClipPaths], rig: Rig, title: str) -> list[MeasuredClip]:
    """All of them, on a bar."""
    shown = tqdm(clips.items(), unit="clip", desc=title)
    return [measure_clip(clip_id, paths, rig) for clip_id, paths in shown]


def main(arguments: list[str] | None = None) -> int:
    program = "tools.corpus.report"
    return called(write_report, program, arguments, MotionError, ReportError, CorpusError, OSError)


if __name__ == "__main__":
    sys.exit(main())
