"""The plans that the page shows and edits: what `GesturePlan.as_json` writes, with ``origin``
beside it, which says whether a system performed the plan or it was found in a motion."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from conventions.names import file_stem

if TYPE_CHECKING:
    from model.plan.plan import GesturePlan

Origin = Literal["planned", "found"]


def planned(path: Path, name: str, folder: Path) -> Path:
    """A plan that a row performed, from the run's own file, which may move away.

    Raises:
        PlanError: if it is none.
    """
    from model.plan.plan import read_plan

    return shown_plan(read_plan(path), "planned", name, folder)


def found_plans(motions: Mapping[str, Path], folder: Path) -> dict[str, Path]:
    """By row the plan that its motion seems to follow."""
    from model.motion.kinematics import open_body_skeleton
    from model.motion.motion import load_motion
    from model.plan.found import found_plan

    skeleton = open_body_skeleton()
    return {
        name: shown_plan(found_plan(load_motion(path), skeleton), "found", name, folder)
        for name, path in motions.items()
    }


def shown_plan(plan: GesturePlan, origin: Origin, name: str, folder: Path) -> Path:
    """The plan of a row, as a file for a browser."""
    path = folder / f"{file_stem(name)}.tiers.json"
    told = {"origin": origin, **json.loads(plan.as_json())}
    path.write_text(json.dumps(told, allow_nan=False, separators=(",", ":")))
    return path
