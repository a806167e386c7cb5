"""Linear-Gaussian denoiser: the posterior of x_1 given x_t and the seed pose, without a network.

Motion is split into components (`Normaliser.mix`) that are modelled as independent Gaussian
processes, each with the covariance of its training windows. The posterior of x_1 given x_t (and the
seed, whose frames are fixed) is then Gaussian too, with a mean linear in x_t and a known deviation.
A network adds to that mean, in units of that deviation: the preconditioning of Karras et al.
(2022), with a matrix in place of a number. So motion has the right amplitude, smoothness and
variance before the network has learned anything, continues its seed, and the network's errors at
high frequencies are as small there as the data's motion.

Along an eigenvector of a process with variance v, the flow of the Gaussian alone leaves ``z = (x_t
- t mean) / sqrt(t^2 v + (1 - t)^2)`` constant, and the network's output f moves it: ``dz = f
d(angle)`` with ``angle = atan(t sqrt(v) / (1 - t))``, from 0 to a right angle. `sample` steps along
these angles, so that the only discretisation error is the network's.
"""

import math
from collections.abc import Callable, Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from model.sampling.flow import PredictClean

SEED_NOISE = 1e-3
"""Variance of a seed frame about its true value, as a share of the channel's variance. Smooth
curves determine their own continuation almost exactly; without this the extrapolation explodes."""
VARIANCE_FLOOR = 1e-7
CHANNEL_FLOOR = 1e-6
"""Variance, as a share of the largest, below which a direction of channels counts as still."""
GRID_VARIANCE = 10.0
"""Variance of the direction with steps of equal angle: many are early, where the slow and
large part of the motion is determined."""


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
        known = full[:, :, :seed_frames]
        noise = SEED_NOISE * full.diagonal(dim1=1, dim2=2).mean(1)
        block = known[:, :seed_frames] + noise[:, None, None] * torch.eye(seed_frames)
        gain = torch.linalg.solve(block, known.mT).mT
        variance, vectors = torch.linalg.eigh(torch.stack([full, full - gain @ known.mT]))
        for name, value in {
            "covariance": covariance,
            "gain": gain,  # (C, T, S)
            "variance": variance.clamp_min(VARIANCE_FLOOR),  # (2, C, T): without and with a seed
            "vectors": vectors,  # (2, C, T, T), an eigenvector a column
        }.items():
            self.register_buffer(name, value.float().contiguous(), persistent=False)

    def to_eigenbasis(
        self, x: Float[Tensor, "B T C"], which: int | Bool[Tensor, " B"]
    ) -> Float[Tensor, "C T B"]:
        """Transform motion into eigenvector coordinates, without (0) or with (1) a seed."""
        return self._by_seed(which, lambda k: self.vectors[k].mT @ x.permute(2, 1, 0))

    def back(
        self, along: Float[Tensor, "C T B"], which: int | Bool[Tensor, " B"]
    ) -> Float[Tensor, "B T C"]:
        """Transform eigenvector coordinates back to motion; the inverse of `to_eigenbasis`."""
        return self._by_seed(which, lambda k: self.vectors[k] @ along).permute(2, 1, 0)

    def _by_seed(
        self,
        which: int | Bool[Tensor, " B"],
        has_seed: Callable[[int], Float[Tensor, "C T B"]],
    ) -> Float[Tensor, "C T B"]:
        """Select, per sample, the result without (0) or with (1) a seed."""
        one = which if isinstance(which, int) else self.common_seed_case(which)
        return (
            torch.where(torch.as_tensor(which), has_seed(1), has_seed(0))
            if one is None
            else has_seed(one)
        )

    def expected(self, seed: Float[Tensor, "B S C"]) -> Float[Tensor, "B T C"]:
        """Compute the mean of x_1 conditioned on its seed alone."""
        return (self.gain @ seed.permute(2, 1, 0)).permute(2, 1, 0)

    def posterior(
        self,
        x_t: Float[Tensor, "B T C"],
        t: Float[Tensor, " B"],
        seed: Float[Tensor, "B S C"],
        has_seed: Bool[Tensor, " B"],
    ) -> Float[Tensor, "B T C"]:
        """Compute the mean of x_1 given x_t = (1 - t) x_0 + t x_1, and a seed if there is one."""
        return self._linear(x_t, t, seed, has_seed, t * self.variance[..., None])

    def consistency(
        self,
        x_t: Float[Tensor, "B T C"],
        t: Float[Tensor, " B"],
        seed: Float[Tensor, "B S C"],
        has_seed: Bool[Tensor, " B"],
    ) -> Float[Tensor, "B T C"]:
        """Carry ``x_t`` to t = 1 by the Gaussian's flow alone: its consistency function."""
        spread = self._spread(t)
        return self._linear(x_t, t, seed, has_seed, self.variance[..., None].sqrt() * spread)

    def _linear(
        self,
        x_t: Float[Tensor, "B T C"],
        t: Float[Tensor, " B"],
        seed: Float[Tensor, "B S C"],
        has_seed: Bool[Tensor, " B"],
        gains: Float[Tensor, "2 C T B"],
    ) -> Float[Tensor, "B T C"]:
        """Return the mean, plus ``gains`` over the variance of x_t times x_t's deviation."""
        shares = gains / self._spread(t).square()  # (2, C, T, B)

        def told(k: int) -> Float[Tensor, "C T B"]:
            expected = self.gain @ seed.permute(2, 1, 0) if k else t.new_zeros(())
            moved = self.vectors[k].mT @ (x_t.permute(2, 1, 0) - t * expected)
            return expected + self.vectors[k] @ (shares[k] * moved)

        return self._by_seed(has_seed, told).permute(2, 1, 0)

    def scale_by_posterior(
        self, unit: Float[Tensor, "B T C"], t: Float[Tensor, " B"], has_seed: Bool[Tensor, " B"]
    ) -> Float[Tensor, "B T C"]:
        """Scale values of unit size to deviations from the posterior mean."""
        deviation = (1 - t) * self.variance[..., None].sqrt() / self._spread(t)  # (2, C, T, B)

        def told(k: int) -> Float[Tensor, "C T B"]:
            return self.vectors[k] @ (deviation[k] * self.to_eigenbasis(unit, k))

        return self._by_seed(has_seed, told).permute(2, 1, 0)

    def common_seed_case(self, has_seed: Bool[Tensor, " B"]) -> int | None:
        """Return the eigenvectors' index if all samples share it; always None in training."""
        if self.training or not bool((has_seed == has_seed[0]).all()):
            return None
        return int(has_seed[0])

    def _spread(self, t: Float[Tensor, " B"] | float) -> Float[Tensor, "2 C T B"]:
        """Return the standard deviation of x_t along each eigenvector."""
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
        """Integrate along the angles; one evaluation a step, two with ``heun`` (last step: one).

        Args:
            predict: x_1 of a network with this prior.
            seed: first frames (B, S, C); None without a seed pose.

        Raises:
            ValueError: if ``steps`` is below 1.
        """
        if steps < 1:
            raise ValueError(f"steps is {steps}; at least 1 is needed.")
        which = 0 if seed is None else 1
        variance = self.variance[which][..., None]
        expected = torch.zeros_like(x_0) if seed is None else self.expected(seed)

        def angle(t: float) -> Float[Tensor, "C T 1"]:
            return torch.atan2(t * variance.sqrt(), torch.full_like(variance, 1 - t))

        def at(z: Float[Tensor, "C T B"], t: float) -> Float[Tensor, "B T C"]:
            return t * expected + self.back(self._spread(t)[which] * z, which)

        def network_says(z: Float[Tensor, "C T B"], t: float) -> Float[Tensor, "C T B"]:
            moved = self.to_eigenbasis(predict(at(z, t), t) - expected, which)
            spread = self._spread(t)[which]
            mean = t * variance / spread * z
            return (moved - mean) * spread / (variance.sqrt() * (1 - t))

        z = self.to_eigenbasis(x_0, which)
        times = time_grid(steps)
        for k in range(steps):
            turn = angle(times[k + 1]) - angle(times[k])
            slope = network_says(z, times[k])
            if heun and k < steps - 1:
                slope = (slope + network_says(z + turn * slope, times[k + 1])) / 2
            z = z + turn * slope
        return at(z, 1.0)


def time_grid(steps: int) -> list[float]:
    """Return the flow times 0 to 1 of the steps, equally spaced in the angle at `GRID_VARIANCE`."""
    tangents = [math.tan(math.pi / 2 * k / steps) for k in range(steps)]
    return [tan / (tan + math.sqrt(GRID_VARIANCE)) for tan in tangents] + [1.0]


def fit_components(
    windows: Sequence[Float[Tensor, "N T C"]],
) -> tuple[Float[Tensor, "C C"], Float[Tensor, "C C"]]:
    """Fit matrices to and from components with unit variance, for channels of mean 0.

    Neither values nor accelerations of components are correlated (as in second-order blind
    identification, Tong et al. 1991), so slow and large motion does not leak into jitter. Channels
    that never move get components of next to no variance.
    """
    values, bends = (_covariance([batch.diff(n=n, dim=1) for batch in windows]) for n in (0, 2))
    size, axes = torch.linalg.eigh(values)
    white = axes / size.clamp_min(CHANNEL_FLOOR * size.max()).sqrt()
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
