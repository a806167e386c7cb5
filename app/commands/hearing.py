"""The command ``hearing``: what of a system's motion its speech decides, and what chance."""

from __future__ import annotations

import argparse
from pathlib import Path

from app.commands.said import name_file, say
from app.family_files import add_family_files, use_family_files
from app.flags import add_flags, read_flags
from app.run.experiments.hearing import HearingRequest, measure_hearing


def add_hearing(commands) -> None:
    """The command with its flags."""
    parser = commands.add_parser(
        "hearing",
        help="does it hear? what speech decides of the motion, and what chance",
        description="Generate each speech with each noise seed and compare: motions that share the "
        "speech, the noise, or neither. Or compare a folder of anyone's motion, whose files are "
        "called SYSTEM__SPEECH__SEED.npz.",
    )
    parser.add_argument(
        "given", type=Path, nargs="+", metavar="SPEECH",
        help="two sound files or more, or one folder of motions",
    )  # fmt: skip
    add_flags(parser, HearingRequest)
    add_family_files(parser)
    parser.set_defaults(command=_hearing)


def _hearing(options: argparse.Namespace) -> None:
    from app.commands.terminal import ProgressBar

    use_family_files(options)
    is_folder = len(options.given) == 1 and options.given[0].is_dir()
    request = read_flags(
        HearingRequest,
        options,
        **(
            {"motions": options.given[0], "systems": ()}
            if is_folder
            else {"speeches": tuple(options.given)}
        ),
    )
    with ProgressBar("compare") as bar:
        hearing = measure_hearing(request, bar.show)
    for sentence in hearing.sentences():
        say(sentence)
    for path in hearing.files:
        name_file(path)
