"""Flow matching with prediction of x_1: path, time weights, samplers, and speech guidance.

Noise ``x_0 ~ N(0, I)`` lies at t = 0, data ``x_1`` at t = 1, and ``x_t = (1 - t) x_0 + t x_1``
(GlobalDiff, "Flow Matching Objective"). A model's x_1 gives the velocity ``(x_1 - x_t) / (1 - t)``.

Classifier-free guidance with scale s combines two predictions of a network that was trained with
dropped speech, with (cond) and without (uncond) speech, in every step:

    x_1 = x_uncond + s (x_cond - x_uncond)

At 1 the network is as trained, at 0 speech has no effect. Jaw and eyes, relative to the head, are
not guided: they are those of x_cond. Speech determines nearly all of the jaw already; with s = 2.5
it would open twice as far.
"""

import math
from collections.abc import Callable, Sequence
from typing import assert_never

import numpy as np
import torch
from jaxtyping import Bool, Float, Shaped
from torch import Tensor

from conventions.joints import FACE, JOINT_INDEX
from model.motion.packing import Normaliser, joint_channels
from model.motion.rotations import matrix_from_rot6d
from model.motion.spaces import RotationSpace
from model.sampling.samplers import FlowSampler

PredictClean = Callable[[Float[Tensor, "B ..."], float], Float[Tensor, "B ..."]]
"""Function that predicts x_1 from x_t at one time t."""


def seeded_noise(key: Sequence[int], shape: Sequence[int]) -> Float[Tensor, "..."]:
    """Draw standard normal numbers that depend on ``key`` alone."""
    state = np.random.SeedSequence(key).generate_state(1, np.uint64)
    generator = torch.Generator().manual_seed(int(state[0] >> 1))
    return torch.randn(tuple(shape), generator=generator)


def interpolate(
    x_0: Float[Tensor, "B ..."], x_1: Float[Tensor, "B ..."], t: Float[Tensor, " B"]
) -> Float[Tensor, "B ..."]:
    """Compute ``x_t`` on the straight path from noise to data."""
    t = t.reshape(-1, *[1] * (x_0.ndim - 1))
    return (1 - t) * x_0 + t * x_1


def flow_loss_weight(t: Float[Tensor, " B"], floor: float | None) -> Float[Tensor, " B"]:
    """Compute ``1 / ((1 - t)^2 + floor)``, scaled to mean 1 over t in [0, 1]; 1 if floor is None.

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
    """Integrate from noise to data in ``steps`` equal steps.

    ``euler`` (one evaluation a step) and ``heun`` (two, but one in the last step) solve the ODE
    ``dx/dt = (x_1(x, t) - x) / (1 - t)``. ``reinterpolate`` is the official GlobalDiff procedure:
    at the start and at the middle of each step, predict x_1 and return to the straight path from
    the *same* noise; it is not an ODE solver. Its result is the last prediction. Raises ValueError
    if ``steps`` is below 1.
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


HEAD = (JOINT_INDEX["neck"], JOINT_INDEX["head"])


class ClassifierFreeGuidance:
    """Classifier-free guidance by speech, for predictions of clean motion.

    Args:
        scale: guidance scale; 1 is the network as trained.
        head_scale: guidance scale of neck and head; None for that of the rest.
    """

    def __init__(
        self,
        scale: float,
        normaliser: Normaliser,
        space: RotationSpace,
        head_scale: float | None = None,
    ) -> None:
        self._scale = scale
        self._head_scale = scale if head_scale is None else head_scale
        self._normaliser = normaliser
        self._space = space
        numbers = 3 if space == "axis-angle" else 6
        self._face, self._head = (
            [numbers * joint + k for joint in joints for k in range(numbers)]
            for joints in (FACE, HEAD)
        )

    @property
    def needs_unconditional(self) -> bool:
        """True if predictions without speech are needed."""
        return self._scale != 1 or self._head_scale != 1

    def network_batch_size(self, size: int) -> int:
        """Return the batch size with duplicates: samples with speech first, then without."""
        return 2 * size if self.needs_unconditional else size

    def conditional_mask(self, size: int) -> Bool[Tensor, " _"]:
        """Return a mask over the duplicated batch that is true for samples with speech."""
        return torch.arange(self.network_batch_size(size)) < size

    def duplicate(self, batch: Shaped[Tensor, "B ..."]) -> Shaped[Tensor, "_ ..."]:
        """Duplicate the batch if predictions without speech are needed."""
        return torch.cat([batch, batch]) if self.needs_unconditional else batch

    def combine(self, clean: Float[Tensor, "_ T C"]) -> Float[Tensor, "B T C"]:
        """Combine the normalised predictions with and without speech into one."""
        if not self.needs_unconditional:
            return clean
        conditional, unconditional = clean.chunk(2)
        mix, unmix = self._normaliser.mix, self._normaliser.unmix
        change = conditional - unconditional
        if unmix is not None:
            change = change @ unmix
        added_scale = change.new_full(change.shape[-1:], self._scale - 1)
        added_scale[self._head] = self._head_scale - 1
        change = added_scale * change
        change[..., self._face] = self._carried(conditional, change)
        if mix is not None:
            change = change @ mix
        return conditional + change

    def _carried(
        self, conditional: Float[Tensor, "B T C"], change: Float[Tensor, "B T C"]
    ) -> Float[Tensor, "B T face"] | float:
        """Return the head's effect on jaw and eyes, which stay fixed relative to it.

        It is 0 for local rotations. Rows of a global rotation are the head's rows times the
        rotation relative to the head.
        """
        if self._space != "global":
            return 0.0
        head = joint_channels((JOINT_INDEX["head"],))
        std = self._normaliser.std
        world = self._normaliser.restore(conditional)
        of_head, of_face = (
            matrix_from_rot6d(world[..., channels].unflatten(-1, (-1, 6)))
            for channels in (head, self._face)
        )
        rows = (change[..., head] * std[head]).unflatten(-1, (1, 2, 3))
        return (rows @ (of_head.mT @ of_face)).flatten(-3) / std[self._face]
