"""The authors' checkpoints, as a person names them on any command line."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from model.systems.official.files import (
    FOLDER_VARIABLE,
    SEED_VARIABLE,
    SPEECH_VARIABLE,
    official_files,
    require_official,
    require_speech,
)


def add_official(parser: argparse.ArgumentParser) -> None:
    """Flags that name them; ``docs/official.md`` tells what is read."""
    group = parser.add_argument_group("GlobalDiff by its authors (docs/official.md)")
    group.add_argument(
        "--official", type=Path, metavar="FOLDER",
        help="of checkpoints of the official code: adds the systems official/... (default: "
        f"${FOLDER_VARIABLE})",
    )  # fmt: skip
    group.add_argument(
        "--official-features", type=Path, metavar="PATH",
        help="a folder of WavLM or HuBERT by which they hear, or features of this speech, .npz or "
        f".npy (default: ${SPEECH_VARIABLE}, else $WAVLM_DIR)",
    )  # fmt: skip
    group.add_argument(
        "--official-seed", type=Path, metavar="MOTION.npz",
        help=f"motion with whose first 8 frames they start (default: ${SEED_VARIABLE}, else "
        "somebody who stands still)",
    )  # fmt: skip


def use_official(options: argparse.Namespace) -> None:
    """Let this process and its children know what was named; see at once that it is all there.

    Raises:
        CheckpointError, EncoderError: if something is named, but not there, or not enough.
    """
    for variable, path in (
        (FOLDER_VARIABLE, options.official),
        (SPEECH_VARIABLE, options.official_features),
        (SEED_VARIABLE, options.official_seed),
    ):
        if path is not None:
            os.environ[variable] = str(path.absolute())
    if official_files() is not None:
        require_official()
        require_speech()
