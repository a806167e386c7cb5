"""``python -m tools.corpus.report --data DIR [--real DIR] [--out FILE]``: the corpus in figures.

Writes a Markdown page with the statistics of the speakers beside those of real clips, how well the
corpus is told from real motion and speech from other speech, and a picture of gestures beside it.
"""

import logging
import sys
from pathlib import Path

from model.storage.files import written_atomically
from tools.command import called
from tools.corpus.build import MANIFEST, CorpusError, read_manifest
from tools.corpus.people.rig import open_body_rig
from tools.corpus.report.drawing import draw_gestures
from tools.corpus.report.measuring import (
    ClipFile,
    MeasuredClip,
    ReportError,
    list_clips,
    measure_clips,
)
from tools.corpus.report.page import report_page


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
    if clips < 1:
        raise ReportError(f"--clips must be at least 1; found {clips}.")
    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    rig = open_body_rig()
    chosen = _first_of_each_speaker(list_clips(data), clips)
    real_clips: list[MeasuredClip] = []
    if real is not None:
        real_clips = measure_clips(list_clips(real)[:clips], rig, "Measuring real clips")
    speakers: dict[str, list[MeasuredClip]] = {}
    for clip in measure_clips(chosen, rig, "Measuring the corpus"):
        speakers.setdefault(clip.speaker, []).append(clip)
    manifest = data / MANIFEST
    seed = int(read_manifest(manifest)["seed"]) if manifest.is_file() else None
    draw_gestures(rig, out.parent / "figures" / "corpus_gestures.png")
    with written_atomically(out) as path:
        path.write_text(report_page(speakers, real_clips, seed), encoding="utf-8")


def _first_of_each_speaker(clips: list[ClipFile], count: int) -> list[ClipFile]:
    """Grouped by speaker, in the order of their first clips."""
    by_speaker: dict[str, list[ClipFile]] = {}
    for clip in clips:
        by_speaker.setdefault(clip.speaker, []).append(clip)
    return [clip for group in by_speaker.values() for clip in group[:count]]


def main(arguments: list[str] | None = None) -> int:
    program = "tools.corpus.report"
    return called(write_report, program, arguments, ReportError, CorpusError, OSError)


if __name__ == "__main__":
    sys.exit(main())
