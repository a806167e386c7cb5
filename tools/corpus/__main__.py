"""``python -m model.corpus --out DIR --hours H --seed N [--workers N]``."""

import argparse
import os
import sys
from pathlib import Path

from tqdm import tqdm

from conventions.names import printable
from tools.corpus.build import CorpusError, build_corpus
from tools.corpus.people.voice import VoiceError


def main(argv: list[str] | None = None) -> int:
    """Make a corpus; 0 when done, 1 with a sentence when it failed, 2 for wrong arguments."""
    arguments = _parser().parse_args(argv)
    bar: tqdm | None = None

    def on_clip(done: int, total: int) -> None:
        nonlocal bar
        if bar is None:
            bar = tqdm(total=total, initial=done, unit="clip", desc="Corpus")
        bar.update(done - bar.n)

    try:
        build_corpus(arguments.out, arguments.hours, arguments.seed, arguments.workers, on_clip)
    except (CorpusError, VoiceError) as error:
        sys.stderr.write(f"{printable(str(error))}\n")
        return 1
    except KeyboardInterrupt:
        sys.stderr.write("Interrupted; the same command continues where it stopped.\n")
        return 1
    finally:
        if bar is not None:
            bar.close()
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m model.corpus",
        description="Make a corpus of speech and co-speech motion in BEAT2's layout.",
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the corpus")
    parser.add_argument("--hours", type=float, required=True, help="length of the corpus")
    parser.add_argument("--seed", type=int, required=True, help="same seed, same bytes")
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count() or 1, help="processes (default: all cores)"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
