"""The command ``plan``: gestures, looks and nods, drawn from speech or found in a motion, to be
read, changed and performed."""

from __future__ import annotations

import argparse
from pathlib import Path

from app.commands.said import name_file, say
from app.config import BUNDLED_WEIGHTS
from app.errors import RunError
from app.run.planning import PlanRequest, find_plan, is_motion, make_plan
from app.run.request import WORDS_ASKED


def add_plan(commands) -> None:
    """The command with its flags."""
    parser = commands.add_parser(
        "plan",
        help="speech to a plan of gestures, which `generate --plan` performs",
        description="Draw a plan from speech without moving anything: what each hand does when, "
        "where to and on which word; looks, nods, brows, blinks and steps. It is made to be "
        "changed, by hand or in Praat or ELAN (docs/plans.md). Of a motion (.npz, .npy, .bvh) the "
        "plan is found instead, as annotators do.",
    )
    parser.add_argument(
        "speech", type=Path, metavar="SPEECH|MOTION", help="any sound file, or a motion"
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE",
        help="ends in .json, or in .TextGrid or .eaf for Praat and ELAN",
    )  # fmt: skip
    parser.add_argument(
        "--empty", action="store_true",
        help="draw nothing: leave the tiers to be annotated by hand",
    )  # fmt: skip
    parser.add_argument("--speaker", metavar="NAME", help="whose manner (default: the first)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="default: %(default)s")
    parser.add_argument(
        "--guidance", type=float, metavar="N",
        help="strength of the speech, 0 to 10; 1 is as trained (default: as suits the planner)",
    )  # fmt: skip
    parser.add_argument(
        "--transcript", type=Path, metavar="FILE",
        help="what is said: a TextGrid, or a plain text (.txt) that is looked for in the speech",
    )  # fmt: skip
    parser.add_argument(
        "--words", choices=WORDS_ASKED, default="none",
        help="recognise words where no transcript is given (default: %(default)s)",
    )  # fmt: skip
    add_style(parser)
    parser.add_argument("--weights", type=Path, default=BUNDLED_WEIGHTS, metavar="DIR")
    parser.set_defaults(command=_plan)


def add_style(parser: argparse.ArgumentParser) -> None:
    """The flag for a style file."""
    parser.add_argument(
        "--style", type=Path, metavar="FILE.toml",
        help="how often, how large, how high, how fast: done to every plan (docs/plans.md)",
    )  # fmt: skip


def _plan(options: argparse.Namespace) -> None:
    if is_motion(options.speech):
        given = [f"--{name}" for name in ("speaker", "guidance", "transcript", "empty", "style")
                 if getattr(options, name)]  # fmt: skip
        if given:
            raise RunError(f"In a motion the plan is found; {given[0]} is for speech.")
        for note in find_plan(options.speech, options.out):
            say(note)
        name_file(options.out)
        return
    request = PlanRequest(
        speech=options.speech,
        out=options.out,
        weights=options.weights,
        speaker=options.speaker,
        seed=options.seed,
        guidance=options.guidance,
        transcript=options.transcript,
        words=options.words,
        is_empty=options.empty,
        style=options.style,
    )
    for note in make_plan(request).notes:
        say(note)
    name_file(options.out)
