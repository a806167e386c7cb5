"""The command ``plan``: gestures, looks and nods, drawn from speech or found in a motion, to be
read, changed and performed."""

from __future__ import annotations

import argparse

from app.commands.said import name_file, say
from app.errors import RunError
from app.flags import add_flags, read_flags
from app.run.planning import PlanRequest, find_plan, is_motion, make_plan


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
    add_flags(parser, PlanRequest)
    parser.set_defaults(command=_plan)


def _plan(options: argparse.Namespace) -> None:
    if is_motion(options.speech):
        of_speech = {
            "--speaker": options.speaker,
            "--guidance": options.guidance,
            "--transcript": options.transcript,
            "--empty": options.is_empty,
            "--style": options.style,
        }
        given = [name for name, value in of_speech.items() if value]
        if given:
            raise RunError(f"In a motion the plan is found; {given[0]} is for speech.")
        for note in find_plan(options.speech, options.out, options.told):
            say(note)
        name_file(options.out)
        return
    request = read_flags(PlanRequest, options)
    for note in make_plan(request).notes:
        say(note)
    name_file(options.out)
