"""Deterministic ways from noise to data for a denoiser that predicts x_0: what few-step generators
are compared with, at the same number of network evaluations.

All follow the probability-flow ODE of `model.systems.gan.schedule`. Of first order they are one
formula at other times: DDIM (Song et al. 2021) visits equal steps of diffusion time, DPM-Solver++
(Lu et al. 2022) equal steps of log(signal / noise), Euler of flow matching equal steps of flow
time. DPM-Solver++ of second order (2M) carries the last prediction on, Heun evaluates twice a step
(once in the last).
"""

import math
from collections.abc import Callable
from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor

from model.systems.gan.config import Solver
from model.systems.gan.schedule import flow_time, signal_and_noise, time_of, times

LAST_TIME = 1e-3
"""At which DPM-Solver++ asks last, as its authors do; data is infinitely far in its steps."""

PredictClean = Callable[[Float[Tensor, "B T C"], float, float], Float[Tensor, "B T C"]]
"""x_0 predicted from x_t at one time, for a step to an earlier one."""


def way(solver: Solver, steps: int) -> list[float]:
    """Diffusion times that a solver visits, from 1 down to 0.

    Raises:
        ValueError: if ``steps`` is below 1.
    """
    uniform = times(steps)
    match solver:
        case "ddim":
            return uniform
        case "dpm-solver++" | "dpm-solver++-2m":
            first, last = _log_ratio(1.0), _log_ratio(LAST_TIME)
            inner = [time_of(first + (last - first) * k / (steps - 1)) for k in range(1, steps)]
        case "euler" | "heun":
            first = 1 / (1 + math.exp(-_log_ratio(1.0)))
            flow = [first + (1 - first) * k / steps for k in range(1, steps)]
            inner = [time_of(math.log(tau / (1 - tau))) for tau in flow]
    return [1.0, *inner, 0.0]


def solve(
    predict: PredictClean, x: Float[Tensor, "B T C"], *, solver: Solver, steps: int
) -> Float[Tensor, "B T C"]:
    """Carry noise ``x`` to data.

    Raises:
        ValueError: if ``steps`` is below 1.
    """
    visited = way(solver, steps)
    earlier: tuple[Tensor, float] | None = None
    for k, (now, before) in enumerate(pairwise(visited)):
        x_0 = predict(x, now, before)
        aim = x_0
        if solver == "dpm-solver++-2m" and before > 0:
            if earlier is not None:  # the line through two predictions, half a step on
                last, length = earlier
                ratio = (_log_ratio(before) - _log_ratio(now)) / length
                aim = x_0 + ratio / 2 * (x_0 - last)
            earlier = x_0, _log_ratio(before) - _log_ratio(now)
        reached = stepped(x, aim, now, before)
        if solver == "heun" and before > 0:
            after = predict(reached, before, visited[k + 2])
            reached = _trapezoid(x, x_0, reached, after, now, before)
        x = reached
    return x


def stepped(
    x: Float[Tensor, "B T C"], x_0: Float[Tensor, "B T C"], now: float, before: float
) -> Float[Tensor, "B T C"]:
    """x at the earlier time if x_0 stays what it is: the noise in x, mixed anew. At ``before`` 0
    that is x_0."""
    signal, noise = _factors(now)
    signal_before, noise_before = _factors(before)
    return signal_before * x_0 + noise_before / noise * (x - signal * x_0)


def evaluations(solver: str, steps: int) -> int:
    """Passes through the network in so many steps."""
    return 2 * steps - 1 if solver == "heun" else steps


def _trapezoid(
    x: Tensor, x_0: Tensor, guess: Tensor, after: Tensor, now: float, before: float
) -> Float[Tensor, "B T C"]:
    """A step of flow time by the mean of the velocities at its ends."""
    (tau, scale), (tau_before, scale_before) = _flow(now), _flow(before)
    here, there = x / scale, guess / scale_before
    velocity = (x_0 - here) / (1 - tau) + (after - there) / (1 - tau_before)
    return scale_before * (here + (tau_before - tau) * velocity / 2)


def _log_ratio(t: float) -> float:
    signal, noise = _factors(t)
    return math.log(signal / noise)


def _factors(t: float) -> tuple[float, float]:
    signal, noise = signal_and_noise(torch.tensor(t, dtype=torch.float64))
    return float(signal), float(noise)


def _flow(t: float) -> tuple[float, float]:
    tau, scale = flow_time(torch.tensor(t, dtype=torch.float64))
    return float(tau), float(scale)
