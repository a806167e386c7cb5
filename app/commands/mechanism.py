"""The command ``mechanism``: equal noise on local and on global rotations, on two bodies."""

from __future__ import annotations

import argparse
from pathlib import Path

from app.commands.said import name_file, say
from app.config import default_body
from app.run.mechanism import NOISE_RAD, MechanismRequest, show_mechanism
from app.run.pictures.followed_point import TIP


def add_mechanism(commands) -> None:
    """The command with its flags."""
    least, most = NOISE_RAD
    parser = commands.add_parser(
        "mechanism",
        help="the paper's argument on a body: equal noise on local and on global rotations",
        description="Put the same random turns on the local and on the global rotations of a "
        "motion, draw both bodies beside each other, and tell how far a fingertip is moved, as "
        "measured and by the closed form. No network takes part.",
    )
    parser.add_argument("motion", type=Path, metavar="MOTION.npz")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.mp4")
    parser.add_argument(
        "--noise", type=float, default=MechanismRequest.noise_rad, metavar="RAD",
        help=f"deviation about each axis, {least:g} to {most:g} (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="default: %(default)s")
    parser.add_argument(
        "--joint", default=TIP, metavar="NAME",
        help="fingertip or joint to follow (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--speech", type=Path, metavar="WAV", help="sound of the video")
    parser.add_argument(
        "--size", type=int, default=MechanismRequest.size, metavar="PX",
        help="height of a body (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--body", type=Path, default=default_body(), metavar="FILE",
        help="licensed SMPLX_NEUTRAL*.npz (default: $SMPLX_MODEL, else the open body)",
    )  # fmt: skip
    parser.set_defaults(command=_mechanism)


def _mechanism(options: argparse.Namespace) -> None:
    from app.commands.terminal import ProgressBar

    request = MechanismRequest(
        motion=options.motion,
        out=options.out,
        noise_rad=options.noise,
        seed=options.seed,
        joint=options.joint,
        speech=options.speech,
        body=options.body,
        size=options.size,
    )
    with ProgressBar(f"draw {options.out.name}") as bar:
        _, sentences = show_mechanism(request, bar.show)
    for sentence in sentences:
        say(sentence)
    name_file(options.out)
