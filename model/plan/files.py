"""Plans in files, told apart by their ending: JSON, Praat's TextGrid, ELAN's .eaf."""

import os
from pathlib import Path

from model.plan.annotation import PlanRead
from model.plan.elan import elan_of, read_elan_plan
from model.plan.plan import GesturePlan, PlanError, read_plan
from model.plan.textgrid import read_textgrid_plan, textgrid_of
from model.storage.files import written_atomically

ENDINGS = (".json", ".TextGrid", ".eaf")


def read_plan_file(path: Path) -> PlanRead:
    """A plan, and what a person should know of how it was taken.

    Raises:
        PlanError: if the file is missing, too large, or holds no plan; one sentence.
    """
    ending = path.suffix.lower()
    if ending == ".textgrid":
        return read_textgrid_plan(path)
    if ending == ".eaf":
        return read_elan_plan(path)
    return PlanRead(read_plan(path))


def check_ending(path: Path) -> None:
    """
    Raises:
        PlanError: if no plan is written under such a name.
    """
    if path.suffix.lower() not in {ending.lower() for ending in ENDINGS}:
        raise PlanError(
            f"{path.name} ends in {path.suffix or 'nothing'!r}; a plan is written as "
            f"{', '.join(ENDINGS)}."
        )


def write_plan_file(plan: GesturePlan, path: Path, speech: Path | None = None) -> None:
    """Write it in the form its ending names, whole or not at all.

    Args:
        speech: what ELAN opens with the plan.

    Raises:
        PlanError: if the ending is none of ours, or the form cannot hold the plan.
        WriteError: with the reason.
    """
    check_ending(path)
    ending = path.suffix.lower()
    if ending == ".json":
        text = plan.as_json()
    elif ending == ".eaf":
        text = elan_of(plan, "" if speech is None else os.path.relpath(speech, path.parent))
    else:
        text = textgrid_of(plan)
    with written_atomically(path) as part:
        part.write_text(text, encoding="utf-8", newline="")
