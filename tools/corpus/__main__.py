"""``python -m model.corpus --out DIR --hours H --seed N [--workers N]``."""

import os
import sys
from pathlib import Path

from tqdm import tqdm

from tools.command import called
from tools.corpus.build import CorpusError, build_corpus
from tools.corpus.people.speaker import VoiceError


def make(out: Path, hours: float, seed: int, workers: int = os.cpu_count() or 1) -> None:
    """Make a corpus of speech and co-speech motion in BEAT2's layout.

    Args:
        out: Folder of the corpus.
        hours: Length of the corpus.
        seed: Same seed, same bytes.
        workers: Processes.
    """
    with tqdm(unit="clip", desc="Corpus", delay=1) as bar:

        def on_clip(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        try:
            build_corpus(out, hours, seed, workers, on_clip)
        except KeyboardInterrupt:
            raise CorpusError("Interrupted; the same command continues where it stopped.") from None


def main(arguments: list[str] | None = None) -> int:
    return called(make, "model.corpus", arguments, CorpusError, VoiceError)


if __name__ == "__main__":
    sys.exit(main())
