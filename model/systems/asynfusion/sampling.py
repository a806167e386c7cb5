"""From noise to motion in two branches, each in as many steps as it is given.

The branch with more steps sets the pace. The other takes its steps at even distances among them,
so that both are at similar noise when they hear each other; in between it is idle, and what the
busy one hears of it is either stale (its features of its last step, which costs nothing) or
recomputed (its features from where it stands now).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import torch
from jaxtyping import Float
from torch import Tensor

from model.sampling.flow import interpolate
from model.systems.asynfusion.guided import GuidedNetwork
from model.systems.asynfusion.network import BRANCHES, DualBranchNetwork, FeatureBuffer, Pair
from model.systems.asynfusion.schedule import flow_times, noise_of, trailing_steps

BLENDED_STEPS = 2
"""Last steps of a branch in which overlapping frames are blended with the window before."""

Noise = Callable[[int, int], Float[Tensor, "B T C"]]
"""Branch and number of its step -> standard normal noise; that of step 0 is where it starts."""


@dataclass(frozen=True)
class Way:
    """How steps are taken."""

    kind: Literal["ddim", "lcm"] = "ddim"
    """``ddim`` keeps to the path of the noise that a step predicts. ``lcm`` adds new noise to the
    motion that it predicts (Luo et al. 2023)."""
    idle: Literal["stale", "recomputed"] = "stale"
    blends: bool = False
    """Blend the frames that repeat the window before linearly into its, in the last steps (the
    paper, section 3.4)."""


WAYS: dict[str, Way] = {
    "ddim": Way(),
    "ddim-blend": Way(blends=True),
    "lcm": Way("lcm"),
    "lcm-recomputed": Way("lcm", idle="recomputed"),
    "lcm-blend": Way("lcm", blends=True),
}
"""By the name of a sampler."""


def turns(count: int, total: int) -> list[int]:
    """At which of ``total`` steps a branch with ``count`` steps takes its own."""
    return [j * total // count for j in range(count)]


def sample(
    network: DualBranchNetwork | GuidedNetwork,
    noise: Noise,
    counts: Sequence[int],
    way: Way,
    *,
    seed: Pair,
    **conditions: Any,
) -> Pair:
    """Clean motion of both branches, normalised components.

    Args:
        counts: steps of the expression branch and of the gesture branch.
        conditions: as `DualBranchNetwork.evaluate` takes them.

    Raises:
        ValueError: if a count is below 1 or above 1,000.
    """
    grids = [flow_times()[trailing_steps(count)].tolist() for count in counts]
    own = [turns(count, max(counts)) for count in counts]
    x = [noise(which, 0) for which in BRANCHES]
    t = [torch.full((len(x[which]),), grids[which][0]) for which in BRANCHES]
    buffer = FeatureBuffer()
    for k in range(max(counts)):
        moving = [which for which in BRANCHES if k in own[which]]
        asked = BRANCHES if way.idle == "recomputed" else moving
        found = network.evaluate(asked, (x[0], x[1]), (t[0], t[1]), buffer, seed=seed, **conditions)
        for which in moving:
            clean = found[which]
            done = own[which].index(k) + 1
            if way.blends and conditions["has_seed"].all() and done > counts[which] - BLENDED_STEPS:
                clean = blended(seed[which], clean)
            if done == counts[which]:
                x[which], t[which] = clean, torch.ones_like(t[which])
                continue
            is_ddim = way.kind == "ddim"
            kept = noise_of(x[which], clean, t[which]) if is_ddim else noise(which, done)
            t[which] = torch.full_like(t[which], grids[which][done])
            x[which] = interpolate(kept, clean, t[which])
    return x[0], x[1]


def blended(
    before: Float[Tensor, "B S C"], clean: Float[Tensor, "B T C"]
) -> Float[Tensor, "B T C"]:
    """``clean`` with its first frames led linearly from those of the window before to its own."""
    count = before.shape[1]
    share = (torch.arange(1, count + 1) / (count + 1))[:, None]
    return torch.cat([torch.lerp(before, clean[:, :count], share), clean[:, count:]], dim=1)
