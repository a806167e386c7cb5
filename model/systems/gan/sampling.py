"""From noise to data in few large steps: the schedule, the posterior of a step, and deterministic
solvers beside it.

Xiao et al., "Tackling the Generative Learning Trilemma with Denoising Diffusion GANs" (2022),
variance-preserving: ``x_t = signal(t) x_0 + noise(t) eps`` with t from 0 (data) to 1 (noise) and
``log signal(t)^2 = -(beta_min t + (beta_max - beta_min) t^2 / 2)``. A sampling of T steps visits
t = 1, (T - 1) / T, ..., 1 / T. Time is continuous, so that one network serves every T.

The solvers follow the probability-flow ODE of that schedule. Of first order they are one
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

BETA_MIN, BETA_MAX = 0.1, 20.0


def signal_and_noise(t: Tensor) -> tuple[Tensor, Tensor]:
    """Factors of x_0 and of the noise in x_t; their squares add to 1."""
    log_square = -(BETA_MIN * t + (BETA_MAX - BETA_MIN) * t**2 / 2)
    return (log_square / 2).exp(), (-torch.expm1(log_square)).sqrt()


def flow_time(t: Tensor) -> tuple[Tensor, Tensor]:
    """The flow time at which data and noise have the same ratio as at t, and the factor by which
    x_t is larger than the flow's ``tau x_0 + (1 - tau) eps``."""
    signal, noise = signal_and_noise(t)
    return signal / (signal + noise), signal + noise


def time_of(log_ratio: float) -> float:
    """The time t at which ``log(signal(t) / noise(t))`` is this."""
    log_square = -math.log1p(math.exp(-2 * log_ratio))
    slope = BETA_MAX - BETA_MIN
    return (math.sqrt(BETA_MIN**2 - 2 * slope * log_square) - BETA_MIN) / slope


def diffused(
    x: Float[Tensor, "B T C"],
    noise: Float[Tensor, "B T C"],
    before: Float[Tensor, " B"],
    now: Float[Tensor, " B"],
) -> Float[Tensor, "B T C"]:
    """x at time ``now`` from x at the earlier time ``before``; data is at 0."""
    kept = _rows(_kept(before, now))
    return kept.sqrt() * x + (1 - kept).sqrt() * noise


def posterior(
    x_now: Float[Tensor, "B T C"],
    x_0: Float[Tensor, "B T C"],
    before: Float[Tensor, " B"],
    now: Float[Tensor, " B"],
) -> tuple[Float[Tensor, "B T C"], Float[Tensor, "B 1 1"]]:
    """Mean and deviation of x at the earlier time ``before``, given x at ``now`` and x_0. At
    ``before`` 0 they are x_0 and 0."""
    kept = _kept(before, now)
    signal_before, noise_before = signal_and_noise(before)
    _, noise_now = signal_and_noise(now)
    share_0 = signal_before * (1 - kept) / noise_now**2
    share_now = kept.sqrt() * noise_before**2 / noise_now**2
    deviation = (1 - kept).sqrt() * noise_before / noise_now
    return _rows(share_0) * x_0 + _rows(share_now) * x_now, _rows(deviation)


def times(steps: int) -> list[float]:
    """Times of a sampling, from 1 down to 0.

    Raises:
        ValueError: if ``steps`` is below 1.
    """
    if steps < 1:
        raise ValueError(f"steps is {steps}; at least 1 is needed.")
    return [(steps - k) / steps for k in range(steps)] + [0.0]


def _kept(before: Tensor, now: Tensor) -> Tensor:
    """Share of the variance at ``before`` that is left at ``now``."""
    signal_before, _ = signal_and_noise(before)
    signal_now, _ = signal_and_noise(now)
    return (signal_now / signal_before).square()


def _rows(values: Float[Tensor, " B"]) -> Float[Tensor, "B 1 1"]:
    return values[:, None, None]


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
