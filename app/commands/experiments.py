"""The commands ``hearing`` and ``mechanism``: what speech decides; noise on two bodies."""

from __future__ import annotations

import argparse
from pathlib import Path

from app.commands.said import name_file, say
from app.flags import add_family_files, add_flags, read_flags, use_family_files
from app.run.experiments.hearing import HearingRequest, measure_hearing
from app.run.experiments.mechanism import MechanismRequest, show_mechanism


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
        "given",
        type=Path,
        nargs="+",
        metavar="SPEECH",
        help="two sound files or more, or one folder of motions",
    )
    add_flags(parser, HearingRequest)
    add_family_files(parser)
    parser.set_defaults(command=_hearing)


def _hearing(options: argparse.Namespace) -> None:
    from app.commands.said import ProgressBar

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
        hearing = measure_hearing(request, bar.take)
    for sentence in hearing.sentences():
        say(sentence)
    for path in hearing.files:
        name_file(path)


def add_mechanism(commands) -> None:
    """The command with its flags."""
    parser = commands.add_parser(
        "mechanism",
        help="the paper's argument on a body: equal noise on local and on global rotations",
        description="Put the same random turns on the local and on the global rotations of a "
        "motion, draw both bodies beside each other, and tell how far a fingertip is moved, as "
        "measured and by the closed form. No network takes part.",
    )
    add_flags(parser, MechanismRequest)
    parser.set_defaults(command=_mechanism)


def _mechanism(options: argparse.Namespace) -> None:
    from app.commands.said import ProgressBar

    request = read_flags(MechanismRequest, options)
    with ProgressBar(f"draw {options.out.name}") as bar:
        _, sentences = show_mechanism(request, bar.take)
    for sentence in sentences:
        say(sentence)
    name_file(options.out)
