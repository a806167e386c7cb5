"""The command ``plan``: gestures, looks and nods of speech, to be read, changed and performed."""

from __future__ import annotations

import argparse
from pathlib import Path

from app.commands.said import name_file
from app.config import BUNDLED_WEIGHTS
from app.run.planning import PlanRequest, make_plan
from app.run.request import WORDS_ASKED


def add_plan(commands) -> None:
    """The command with its flags."""
    parser = commands.add_parser(
        "plan",
        help="speech to a plan of gestures, which `generate --plan` performs",
        description="Draw a plan from speech without moving anything: what each hand does when, "
        "where to and on which word; looks, nods, brows, blinks and steps. It is JSON, made to be "
        "changed (docs/plans.md).",
    )
    parser.add_argument("speech", type=Path, metavar="SPEECH", help="any sound file")
    parser.add_argument("--out", type=Path, required=True, metavar="PLAN.json")
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
    parser.add_argument("--weights", type=Path, default=BUNDLED_WEIGHTS, metavar="DIR")
    parser.set_defaults(command=_plan)


def _plan(options: argparse.Namespace) -> None:
    request = PlanRequest(
        speech=options.speech,
        out=options.out,
        weights=options.weights,
        speaker=options.speaker,
        seed=options.seed,
        guidance=options.guidance,
        transcript=options.transcript,
        words=options.words,
    )
    make_plan(request)
    name_file(options.out)
