"""From noise to data in few large steps: the schedule, a step's posterior, and DDIM's step.

Xiao et al., "Tackling the Generative Learning Trilemma with Denoising Diffusion GANs" (2022),
variance-preserving: ``x_t = signal(t) x_0 + noise(t) eps`` with t from 0 (data) to 1 (noise) and
``log signal(t)^2 = -(beta_min t + (beta_max - beta_min) t^2 / 2)``. A sampling of T steps visits
t = 1, (T - 1) / T, ..., 1 / T. Time is continuous, so that one network serves every T.
"""

import torch
from jaxtyping import Float
from torch import Tensor

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


def stepped(
    x: Float[Tensor, "B T C"], x_0: Float[Tensor, "B T C"], before: float, now: float
) -> Float[Tensor, "B T C"]:
    """x at the earlier time ``before`` if x_0 stays what it is: the noise in x, mixed anew (DDIM,
    Song et al. 2021). At ``before`` 0 that is x_0."""
    (signal_before, signal), (noise_before, noise) = (
        factors.tolist()
        for factors in signal_and_noise(torch.tensor([before, now], dtype=torch.float64))
    )
    return signal_before * x_0 + noise_before / noise * (x - signal * x_0)
