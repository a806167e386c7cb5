"""The noise schedule of DDPM, told in flow times.

``x_k = sqrt(abar_k) x_0 + sqrt(1 - abar_k) eps`` (eq. 5) divided by the sum of the two roots lies
on the straight path from noise to data at the flow time ``sqrt(abar_k) / (sqrt(abar_k) +
sqrt(1 - abar_k))``. So networks, priors and interpolation of flow matching serve diffusion too:
only the times differ. A step that predicts clean motion x_1 predicts the noise
``(x_t - t x_1) / (1 - t)``, and DDIM returns to the path of that noise at an earlier step.
"""

from functools import cache

import torch
from jaxtyping import Float, Int
from torch import Tensor

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
