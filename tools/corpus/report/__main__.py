"""``python -m tools.corpus.report --data DIR [--real DIR] [--out FILE]``: the corpus in figures.

Writes a Markdown page with the statistics of the speakers beside those of real clips, how well the
corpus is told from real motion and speech from other speech, and a picture of gestures beside it.
"""

import argparse
import logging
import sys
from pathlib import Path

from conventions.names import printable
from model.storage.files import written_atomically
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


def write_report(data: Path, real: Path | None, out: Path, clips_per_speaker: int) -> None:
    """Measure so many clips of each speaker, and as many real ones, and write page and pictures.

    Raises:
        ReportError: if there are no clips that can be used.
        CorpusError: if the folder's manifest cannot be read.
        WriteError: if the page cannot be written.
    """
    rig = open_body_rig()
    chosen = _first_of_each_speaker(list_clips(data), clips_per_speaker)
    real_clips: list[MeasuredClip] = []
    if real is not None:
        real_clips = measure_clips(
            list_clips(real)[:clips_per_speaker], rig, "Measuring real clips"
        )
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


def main(argv: list[str] | None = None) -> int:
    """Make the report; 0 when done, 1 with a sentence when it failed, 2 for wrong arguments."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.corpus.report", description="Describe a corpus in figures."
    )
    parser.add_argument("--data", type=Path, required=True, help="corpus folder")
    parser.add_argument("--real", type=Path, help="folder of real BEAT2 clips to compare with")
    parser.add_argument("--out", type=Path, default=Path("docs/corpus.md"))
    parser.add_argument("--clips", type=int, default=8, help="clips of each speaker (default: 8)")
    arguments = parser.parse_args(argv)
    if arguments.clips < 1:
        parser.error(f"--clips must be at least 1; found {arguments.clips}")
    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    try:
        write_report(arguments.data, arguments.real, arguments.out, arguments.clips)
    except (ReportError, CorpusError, OSError) as error:
        sys.stderr.write(f"{printable(str(error))}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
