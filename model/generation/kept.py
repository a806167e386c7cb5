"""A performance in a file, so that another process can go on from it."""

from collections.abc import Mapping
from pathlib import Path

import torch
from jaxtyping import Float64
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor

from model.generation.again import Performance
from model.generation.base import System
from model.generation.feet import Footing
from model.motion.motion import Motion
from model.plan.plan import SIDES, GesturePlan, PlanError, Planted
from model.storage.files import written_atomically

ENDING = ".windows"
_HEARD = "heard"
_STOOD = "stood"


def save_performance(performance: Performance, path: Path) -> None:
    """Write its windows and what they heard, to the bit; motion and plan have files of their own.

    Raises:
        WriteError: with the reason.
    """
    fields = [window.fields_of(slice(None)) for window in performance.made]
    tensors = {name: torch.stack([each[name] for each in fields]) for name in fields[0]}
    with written_atomically(path) as part:
        told = {_HEARD: performance.heard.contiguous(), _STOOD: _told(performance.footings)}
        part.write_bytes(save({**told, **tensors}))


def load_performance(path: Path, system: System, plan: GesturePlan, motion: Motion) -> Performance:
    """What `save_performance` has written of a system's motion after a plan.

    Raises:
        PlanError: if it is kept no longer, or damaged.
    """
    try:
        tensors = load(path.read_bytes())
        heard, stood = tensors.pop(_HEARD), _footings(tensors.pop(_STOOD))
        return Performance(motion, plan, (), _windows(system, tensors), heard, stood)
    except (OSError, SafetensorError, KeyError, TypeError) as error:
        raise PlanError("This take is kept no longer; generate the motion again.") from error


def _told(footings: Mapping[Planted, Footing]) -> Float64[Tensor, "n 6"]:
    rows = [
        (event.start_s, event.end_s, SIDES.index(event.foot), at.x, at.z, at.turn)
        for event, at in footings.items()
    ]
    return torch.tensor(rows, dtype=torch.float64).reshape(-1, 6)


def _footings(told: Float64[Tensor, "n 6"]) -> dict[Planted, Footing]:
    return {
        Planted(start_s, end_s, SIDES[int(foot)]): Footing(x, z, turn)
        for start_s, end_s, foot, x, z, turn in told.tolist()
    }


def _windows(system: System, tensors: Mapping[str, Tensor]) -> tuple:
    count = len(next(iter(tensors.values())))
    return tuple(
        system.window_type(**{name: stacked[k] for name, stacked in tensors.items()})
        for k in range(count)
    )
