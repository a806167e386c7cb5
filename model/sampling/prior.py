"""Linear-Gaussian denoiser: the posterior of x_1 given x_t and the seed pose, without a network.

Motion is split into components (`Normaliser.mix`) that are modelled as independent Gaussian
processes over the frames of a window, each with the covariance of its training windows. The
posterior of x_1 given x_t, and the seed if there is one, is then Gaussian too, with a mean linear
in x_t and a known standard deviation. A network adds to that mean, in units of that deviation: the
preconditioning of Karras et al. (2022), with a matrix instead of a number. So motion has the right
amplitude, smoothness and variance before the network has learned anything, continues its seed, and
the network's errors at high frequencies are as small as the data's motion there.

Along an eigenvector of a covariance, let x_1 ~ N(m, v); m is 0 without a seed. Then

    s_t^2          = t^2 v + (1 - t)^2                        variance of x_t
    z_t            = (x_t - t m) / s_t                        standardised x_t
    E[x_1 | x_t]   = m + (t v / s_t) z_t                      posterior mean
    std[x_1 | x_t] = (1 - t) sqrt(v) / s_t                    posterior deviation
    f(x_t, t)      = (x_1 - E[x_1 | x_t]) / std[x_1 | x_t]    correction; x_1 is the network's
    theta(t)       = atan(t sqrt(v) / (1 - t))                angle, 0 (noise) to pi / 2 (data)

and the flow is ``dz / dtheta = f``: without a network z is constant. `sample` integrates f over
theta, so the only discretisation error is that of f.
"""

import math
from collections.abc import Callable, Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from model.sampling.flow import PredictClean

SEED_NOISE_VARIANCE_SHARE = 1e-3
"""Variance of a seed frame about its true value, as a share of the channel's variance. Smooth
curves determine their own continuation almost exactly; without this the extrapolation explodes."""
VARIANCE_FLOOR = 1e-7
RELATIVE_VARIANCE_FLOOR = 1e-6
"""Variance, as a share of the largest, below which a direction of channels counts as still."""
GRID_VARIANCE = 10.0
"""Variance v of an eigenvector, in units of the noise's, for which steps are equal in theta. Larger
values put more steps near t = 0, where slow and large movement is determined."""


class GaussianPrior(nn.Module):
    """Posterior of clean windows with components that are independent Gaussian processes.

    Args:
        covariance: covariance (C, T, T) of each component between the frames of a window.
        seed_frames: number of first frames that a seed pose fixes.
    """

    def __init__(self, covariance: Float[Tensor, "C T T"], seed_frames: int) -> None:
        super().__init__()
        self.covariance: Tensor
        self.gain: Tensor
        self.variance: Tensor
        self.vectors: Tensor
        full = covariance.double()
        size, axes = torch.linalg.eigh(full)  # an estimate need not be positive
        full = (axes * size.clamp_min(VARIANCE_FLOOR)[:, None]) @ axes.mT
        seed_covariance = full[:, :, :seed_frames]
        noise = SEED_NOISE_VARIANCE_SHARE * full.diagonal(dim1=1, dim2=2).mean(1)
        block = seed_covariance[:, :seed_frames] + noise[:, None, None] * torch.eye(seed_frames)
        gain = torch.linalg.solve(block, seed_covariance.mT).mT
        variance, vectors = torch.linalg.eigh(torch.stack([full, full - gain @ seed_covariance.mT]))
        for name, value in {
            "covariance": covariance,
            "gain": gain,  # (C, T, S)
            "variance": variance.clamp_min(VARIANCE_FLOOR),  # (2, C, T): without and with a seed
            "vectors": vectors,  # (2, C, T, T), an eigenvector a column
        }.items():
            self.register_buffer(name, value.float().contiguous(), persistent=False)

    def to_eigenbasis(
        self, x: Float[Tensor, "B T C"], has_seed: int | Bool[Tensor, " B"]
    ) -> Float[Tensor, "C T B"]:
        """Transform motion into eigenvector coordinates of the prior without or with a seed.

        ``has_seed`` is 0 or 1 for all samples, or a mask.
        """
        return self._by_seed(has_seed, lambda case: self.vectors[case].mT @ x.permute(2, 1, 0))

    def from_eigenbasis(
        self, coordinates: Float[Tensor, "C T B"], has_seed: int | Bool[Tensor, " B"]
    ) -> Float[Tensor, "B T C"]:
        """Transform eigenvector coordinates back to motion; the inverse of `to_eigenbasis`."""
        motion = self._by_seed(has_seed, lambda case: self.vectors[case] @ coordinates)
        return motion.permute(2, 1, 0)

    def _by_seed(
        self, has_seed: int | Bool[Tensor, " B"], compute: Callable[[int], Float[Tensor, "C T B"]]
    ) -> Float[Tensor, "C T B"]:
        """Select, per sample, the result without (0) or with (1) a seed."""
        case = has_seed if isinstance(has_seed, int) else self.common_has_seed(has_seed)
        if case is not None:
            return compute(case)
        return torch.where(torch.as_tensor(has_seed), compute(1), compute(0))

    def mean_from_seed(self, seed: Float[Tensor, "B S C"]) -> Float[Tensor, "B T C"]:
        """Compute the mean m of x_1 given its seed alone."""
        return (self.gain @ seed.permute(2, 1, 0)).permute(2, 1, 0)

    def posterior_mean(
        self,
        x_t: Float[Tensor, "B T C"],
        t: Float[Tensor, " B"],
        seed: Float[Tensor, "B S C"],
        has_seed: Bool[Tensor, " B"],
    ) -> Float[Tensor, "B T C"]:
        """Compute the mean of x_1 given x_t = (1 - t) x_0 + t x_1, and a seed if there is one."""
        return self._linear_estimate(x_t, t, seed, has_seed, t * self.variance[..., None])

    def flow_to_data(
        self,
        x_t: Float[Tensor, "B T C"],
        t: Float[Tensor, " B"],
        seed: Float[Tensor, "B S C"],
        has_seed: Bool[Tensor, " B"],
    ) -> Float[Tensor, "B T C"]:
        """Carry ``x_t`` to t = 1 by the Gaussian's flow alone: its consistency function."""
        std = self._std(t)
        return self._linear_estimate(x_t, t, seed, has_seed, self.variance[..., None].sqrt() * std)

    def _linear_estimate(
        self,
        x_t: Float[Tensor, "B T C"],
        t: Float[Tensor, " B"],
        seed: Float[Tensor, "B S C"],
        has_seed: Bool[Tensor, " B"],
        covariance: Float[Tensor, "2 C T B"],
    ) -> Float[Tensor, "B T C"]:
        """Compute ``m + covariance / s_t^2 (x_t - t m)`` along each eigenvector.

        The covariance is that of estimate and x_t, without and with a seed.
        """
        slopes = covariance / self._std(t).square()  # (2, C, T, B)

        def estimate(case: int) -> Float[Tensor, "C T B"]:
            mean = self.gain @ seed.permute(2, 1, 0) if case else t.new_zeros(())
            centred = self.vectors[case].mT @ (x_t.permute(2, 1, 0) - t * mean)
            return mean + self.vectors[case] @ (slopes[case] * centred)

        return self._by_seed(has_seed, estimate).permute(2, 1, 0)

    def scale_by_posterior(
        self, unit: Float[Tensor, "B T C"], t: Float[Tensor, " B"], has_seed: Bool[Tensor, " B"]
    ) -> Float[Tensor, "B T C"]:
        """Scale a correction in units of the posterior's standard deviation to motion."""
        std = (1 - t) * self.variance[..., None].sqrt() / self._std(t)  # (2, C, T, B)

        def scaled(case: int) -> Float[Tensor, "C T B"]:
            return self.vectors[case] @ (std[case] * self.to_eigenbasis(unit, case))

        return self._by_seed(has_seed, scaled).permute(2, 1, 0)

    def common_has_seed(self, has_seed: Bool[Tensor, " B"]) -> int | None:
        """Return 0 or 1 if no or every sample has a seed, else None; always None in training."""
        if self.training or not bool((has_seed == has_seed[0]).all()):
            return None
        return int(has_seed[0])

    def _std(self, t: Float[Tensor, " B"] | float) -> Float[Tensor, "2 C T B"]:
        """Compute s_t, the standard deviation of x_t along each eigenvector."""
        return (t**2 * self.variance[..., None] + (1 - t) ** 2).sqrt()

    def sample(
        self,
        predict: PredictClean,
        x_0: Float[Tensor, "B T C"],
        seed: Float[Tensor, "B S C"] | None,
        *,
        steps: int,
        heun: bool = False,
    ) -> Float[Tensor, "B T C"]:
        """Integrate over the angle theta; one evaluation a step, two with ``heun`` (last: one).

        ``predict`` is the prediction of x_1 by a network with this prior. Raises ValueError if
        ``steps`` is below 1.
        """
        if steps < 1:
            raise ValueError(f"steps is {steps}; at least 1 is needed.")
        case = 0 if seed is None else 1
        variance = self.variance[case][..., None]
        mean = torch.zeros_like(x_0) if seed is None else self.mean_from_seed(seed)

        def theta(t: float) -> Float[Tensor, "C T 1"]:
            return torch.atan2(t * variance.sqrt(), torch.full_like(variance, 1 - t))

        def x_at(z: Float[Tensor, "C T B"], t: float) -> Float[Tensor, "B T C"]:
            return t * mean + self.from_eigenbasis(self._std(t)[case] * z, case)

        def predicted_slope(z: Float[Tensor, "C T B"], t: float) -> Float[Tensor, "C T B"]:
            centred = self.to_eigenbasis(predict(x_at(z, t), t) - mean, case)
            std = self._std(t)[case]
            posterior_mean = t * variance / std * z
            return (centred - posterior_mean) * std / (variance.sqrt() * (1 - t))

        z = self.to_eigenbasis(x_0, case)
        times = time_grid(steps)
        for k in range(steps):
            step = theta(times[k + 1]) - theta(times[k])
            slope = predicted_slope(z, times[k])
            if heun and k < steps - 1:
                slope = (slope + predicted_slope(z + step * slope, times[k + 1])) / 2
            z = z + step * slope
        return x_at(z, 1.0)


def time_grid(steps: int) -> list[float]:
    """Return the flow times 0 to 1 of the steps, equally spaced in theta at `GRID_VARIANCE`."""
    tangents = [math.tan(math.pi / 2 * k / steps) for k in range(steps)]
    return [tan / (tan + math.sqrt(GRID_VARIANCE)) for tan in tangents] + [1.0]


def fit_components(
    windows: Sequence[Float[Tensor, "N T C"]],
) -> tuple[Float[Tensor, "C C"], Float[Tensor, "C C"]]:
    """Fit the `Normaliser`'s matrices to and from components of unit variance, for mean 0.

    Neither values nor accelerations of components are correlated (as in second-order blind
    identification, Tong et al. 1991), so slow and large motion does not leak into jitter. Channels
    that never move get components of next to no variance.
    """
    values, bends = (_covariance([batch.diff(n=n, dim=1) for batch in windows]) for n in (0, 2))
    size, axes = torch.linalg.eigh(values)
    white = axes / size.clamp_min(RELATIVE_VARIANCE_FLOOR * size.max()).sqrt()
    mix = white @ torch.linalg.eigh(white.mT @ bends @ white).eigenvectors
    return mix.float(), torch.linalg.inv(mix).float()


def fit_prior(components: Sequence[Float[Tensor, "N T C"]], seed_frames: int) -> GaussianPrior:
    """Fit the covariance over time of each component of windows.

    It is taken about the mean of all windows, not of each: where a speaker holds the hands is part
    of what is sampled.
    """
    total = sum(torch.einsum("nic,njc->cij", batch, batch).double() for batch in components)
    assert isinstance(total, Tensor)
    return GaussianPrior(total.float() / sum(map(len, components)), seed_frames)


def _covariance(windows: Sequence[Float[Tensor, "N T C"]]) -> Float[Tensor, "C C"]:
    """Compute the second moments over all frames, in float64."""
    flat = [batch.flatten(0, 1) for batch in windows]
    total = sum((rows.T @ rows).double() for rows in flat)
    assert isinstance(total, Tensor)
    return total / sum(map(len, flat))
