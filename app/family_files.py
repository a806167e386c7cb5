"""Files that families need of a person, as they are named on any command line."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from model.systems.registry import families


def add_family_files(parser: argparse.ArgumentParser) -> None:
    """Flags that name them, a group for each family that has some."""
    for family in families():
        if not family.files:
            continue
        group = parser.add_argument_group(family.files_title)
        for file in family.files:
            group.add_argument(file.flag, type=Path, metavar=file.metavar, help=file.help)


def use_family_files(options: argparse.Namespace) -> None:
    """Let this process and its children know what was named; see at once that it is all there.

    Raises:
        CheckpointError, EncoderError: if something is named, but not there, or not enough.
    """
    for family in families():
        for file in family.files:
            path = getattr(options, file.flag.removeprefix("--").replace("-", "_"))
            if path is not None:
                os.environ[file.variable] = str(path.absolute())
        family.require_files()
