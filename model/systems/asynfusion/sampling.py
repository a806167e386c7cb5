"""From noise to motion in two branches: the schedule, the steps of each, and what speech changes.

``x_k = sqrt(abar_k) x_0 + sqrt(1 - abar_k) eps`` (eq. 5) divided by the sum of the two roots lies
on the straight path from noise to data at the flow time ``sqrt(abar_k) / (sqrt(abar_k) +
sqrt(1 - abar_k))``. So networks, priors and interpolation of flow matching serve diffusion too:
only the times differ. A step that predicts clean motion x_1 predicts the noise
``(x_t - t x_1) / (1 - t)``, and DDIM returns to the path of that noise at an earlier step.

The branch with more steps sets the pace. The other takes its steps at even distances among them,
so that both are at similar noise when they hear each other; in between it is idle, and the busy
one hears its features of its last step, which costs nothing.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, Literal, get_args

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from model.sampling.flow import SpeechGuide, interpolate
from model.systems.asynfusion.network import (
    BRANCHES,
    GESTURE,
    DualBranchNetwork,
    FeatureBuffer,
    Pair,
    both,
)

NUM_STEPS = 1000
FIRST_BETA, LAST_BETA = 1e-4, 0.02
"""Linear, as in DDPM (Ho et al. 2020); the paper only says 1,000 steps."""


@cache
def flow_times() -> Float[Tensor, "1000"]:
    """Flow time of each step; step 0 is next to the data."""
    betas = torch.linspace(FIRST_BETA, LAST_BETA, NUM_STEPS, dtype=torch.float64)
    kept = torch.cumprod(1 - betas, dim=0)
    return (kept.sqrt() / (kept.sqrt() + (1 - kept).sqrt())).float()


def noise_of(
    x_t: Float[Tensor, "B T C"], x_1: Float[Tensor, "B T C"], t: Float[Tensor, " B"]
) -> Float[Tensor, "B T C"]:
    """The noise that leads from clean motion to ``x_t``."""
    t = t[:, None, None]
    return (x_t - t * x_1) / (1 - t)


def trailing_steps(count: int) -> Int[Tensor, " count"]:
    """``count`` steps at even distances, from pure noise (999) down (Lin et al. 2024).

    Raises:
        ValueError: if that is none, or more than there are.
    """
    if not 1 <= count <= NUM_STEPS:
        raise ValueError(f"There are {NUM_STEPS} diffusion steps; {count} cannot be taken.")
    return (NUM_STEPS - torch.arange(count) * NUM_STEPS / count).round().long() - 1


Noise = Callable[[int, int], Float[Tensor, "B T C"]]
"""Branch and number of its step -> standard normal noise; that of step 0 is where it starts."""


Way = Literal["ddim", "lcm"]
WAYS: tuple[Way, ...] = get_args(Way)
"""Names of samplers."""


def turns(count: int, total: int) -> list[int]:
    """At which of ``total`` steps a branch with ``count`` steps takes its own."""
    return [j * total // count for j in range(count)]


def sample(
    network: DualBranchNetwork,
    guide: SpeechGuide,
    noise: Noise,
    counts: Sequence[int],
    way: Way,
    *,
    heard: Float[Tensor, "copies T width"],
    seed: Pair,
    speaker: Int[Tensor, " B"],
    has_seed: Bool[Tensor, " B"],
) -> Pair:
    """Clean motion of both branches, normalised components.

    Args:
        guide: of the body; the face stays as trained. Asked twice, both branches of the copies that
            do not hear are deaf, as they were in training.
        counts: steps of the expression branch and of the gesture branch.
        way: ``ddim`` keeps to the path of the noise that a step predicts; ``lcm`` adds new noise to
            the motion that it predicts (Luo et al. 2023).
        heard: tokens of the speech, then those of none where the guide asks twice.
    """
    twice = guide.twice
    told: dict[str, Any] = {
        "heard": heard, "seed": both(twice, seed), "speaker": twice(speaker),
        "has_seed": twice(has_seed),
    }  # fmt: skip
    grids = [flow_times()[trailing_steps(count)].tolist() for count in counts]
    own = [turns(count, max(counts)) for count in counts]
    x = [noise(which, 0) for which in BRANCHES]
    t = [torch.full((len(x[which]),), grids[which][0]) for which in BRANCHES]
    buffer: FeatureBuffer = {}
    for k in range(max(counts)):
        busy = [which for which in BRANCHES if k in own[which]]
        now = both(twice, (x[0], x[1])), both(twice, (t[0], t[1]))
        found = network.evaluate(busy, *now, buffer, **told)
        for which in busy:
            clean = found[which]
            clean = guide.guided(clean) if which == GESTURE else clean[: len(speaker)]
            done = own[which].index(k) + 1
            if done == counts[which]:
                x[which], t[which] = clean, torch.ones_like(t[which])
                continue
            follows = way == "ddim"
            kept = noise_of(x[which], clean, t[which]) if follows else noise(which, done)
            t[which] = torch.full_like(t[which], grids[which][done])
            x[which] = interpolate(kept, clean, t[which])
    return x[0], x[1]
