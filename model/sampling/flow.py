"""Flow matching that predicts the clean end: the path, its time weights, and the samplers.

Noise ``x_0 ~ N(0, I)`` lies at t = 0, data ``x_1`` at t = 1, and ``x_t = (1 - t) x_0 + t x_1``
(GlobalDiff, "Flow Matching Objective"). A model that predicts x_1 gives the velocity
``(x_1 - x_t) / (1 - t)``.
"""

import math
from collections.abc import Callable, Sequence
from typing import assert_never

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from model.sampling.names import FlowSampler

PredictClean = Callable[[Float[Tensor, "B ..."], float], Float[Tensor, "B ..."]]
"""x_1 predicted from x_t at one time t."""


def seeded_noise(key: Sequence[int], shape: Sequence[int]) -> Float[Tensor, "..."]:
    """Standard normal numbers that follow from ``key`` alone."""
    state = np.random.SeedSequence(key).generate_state(1, np.uint64)
    generator = torch.Generator().manual_seed(int(state[0] >> 1))
    return torch.randn(tuple(shape), generator=generator)


def interpolate(
    x_0: Float[Tensor, "B ..."], x_1: Float[Tensor, "B ..."], t: Float[Tensor, " B"]
) -> Float[Tensor, "B ..."]:
    """``x_t`` on the straight path from noise to data."""
    t = t.reshape(-1, *[1] * (x_0.ndim - 1))
    return (1 - t) * x_0 + t * x_1


def time_weight(t: Float[Tensor, " B"], floor: float | None) -> Float[Tensor, " B"]:
    """``1 / ((1 - t)^2 + floor)``, scaled to mean 1 over t in [0, 1]; ones when floor is None.

    Without the floor this is the weight that turns an x_1 error into a velocity error.
    """
    if floor is None:
        return torch.ones_like(t)
    mean = math.atan(1 / math.sqrt(floor)) / math.sqrt(floor)
    return 1 / ((1 - t) ** 2 + floor) / mean


def sample(
    predict: PredictClean,
    x_0: Float[Tensor, "B ..."],
    *,
    steps: int,
    sampler: FlowSampler = "euler",
) -> Float[Tensor, "B ..."]:
    """Carry noise to data in ``steps`` equal steps.

    ``euler`` (one evaluation a step) and ``heun`` (two, but one in the last step) solve the ODE
    ``dx/dt = (x_1(x, t) - x) / (1 - t)``. ``reinterpolate`` is the official GlobalDiff procedure:
    at the start and at the middle of each step, predict x_1 and return to the straight path from
    the *same* noise; it is no ODE solver. Its result is the last prediction.

    Raises:
        ValueError: if ``steps`` is below 1.
    """
    if steps < 1:
        raise ValueError(f"steps is {steps}; at least 1 is needed.")
    x = x_0
    for k in range(steps):
        t, t_next = k / steps, (k + 1) / steps
        x_1 = predict(x, t)
        match sampler:
            case "euler":
                x = x + (t_next - t) / (1 - t) * (x_1 - x)
            case "heun":
                velocity = (x_1 - x) / (1 - t)
                guess = x + (t_next - t) * velocity
                if k == steps - 1:  # the velocity is undefined at t = 1
                    x = guess
                else:
                    velocity_next = (predict(guess, t_next) - guess) / (1 - t_next)
                    x = x + (t_next - t) * (velocity + velocity_next) / 2
            case "reinterpolate":
                middle = (t + t_next) / 2
                x = (1 - middle) * x_0 + middle * x_1
                x_1 = predict(x, middle)
                x = (1 - t_next) * x_0 + t_next * x_1
            case _:
                assert_never(sampler)
    return x
