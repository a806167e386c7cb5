"""The command ``mechanism``: equal noise on local and on global rotations, on two bodies."""

from __future__ import annotations

import argparse

from app.commands.said import name_file, say
from app.flags import add_flags, read_flags
from app.run.experiments.mechanism import MechanismRequest, show_mechanism


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
    from app.commands.terminal import ProgressBar

    request = read_flags(MechanismRequest, options)
    with ProgressBar(f"draw {options.out.name}") as bar:
        _, sentences = show_mechanism(request, bar.show)
    for sentence in sentences:
        say(sentence)
    name_file(options.out)
