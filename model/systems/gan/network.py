"""Networks and schedule of the GAN: generator, discriminator, a step's posterior, and DDIM's step.

The generator predicts clean motion x_0 from x_t, speech, seed pose and speaker. The notation is
diffusion's: x_0 is data and t = 1 noise; in `model.sampling.flow`, x_1 is data and t = 0 noise.

Xiao et al., "Tackling the Generative Learning Trilemma with Denoising Diffusion GANs" (2022),
variance-preserving: ``x_t = signal(t) x_0 + noise(t) eps`` with t from 0 (data) to 1 (noise) and
``log signal(t)^2 = -(beta_min t + (beta_max - beta_min) t^2 / 2)``. A sampling of T steps visits t
= 1, (T - 1) / T, ..., 1 / T. Time is continuous, so that one network serves every T.
"""

from itertools import pairwise

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from model.motion.packing import AXIS_ANGLE_GROUPS, Normaliser
from model.networks.branch import ConditionedNetwork, MotionBranch, TimeEmbedding, mask_expression
from model.sampling.prior import GaussianPrior
from model.systems.gan.config import DiscriminatorConfig, GeneratorConfig

BETA_MIN, BETA_MAX = 0.1, 20.0


def diffusion_factors(t: Float[Tensor, "*batch"]) -> tuple[Tensor, Tensor]:
    """Compute the factors of x_0 and of the noise in x_t; their squares add to 1."""
    log_square = -(BETA_MIN * t + (BETA_MAX - BETA_MIN) * t**2 / 2)
    return (log_square / 2).exp(), (-torch.expm1(log_square)).sqrt()


def flow_time_and_scale(t: Float[Tensor, "*batch"]) -> tuple[Tensor, Tensor]:
    """Return the flow time with the same ratio of data and noise, and the scale of x_t in it."""
    signal, noise = diffusion_factors(t)
    return signal / (signal + noise), signal + noise


def diffuse(
    x_s: Float[Tensor, "B T C"],
    noise: Float[Tensor, "B T C"],
    s: Float[Tensor, " B"],
    t: Float[Tensor, " B"],
) -> Float[Tensor, "B T C"]:
    """Diffuse x_s from time ``s`` to a later ``t``; data is at 0."""
    share = _rows(_variance_share(s, t))
    return share.sqrt() * x_s + (1 - share).sqrt() * noise


def posterior(
    x_t: Float[Tensor, "B T C"],
    x_0: Float[Tensor, "B T C"],
    s: Float[Tensor, " B"],
    t: Float[Tensor, " B"],
) -> tuple[Float[Tensor, "B T C"], Float[Tensor, "B 1 1"]]:
    """Compute the mean and standard deviation of x_s given x_t and x_0, for s < t.

    At ``s`` 0 they are x_0 and 0.
    """
    share = _variance_share(s, t)
    signal_s, noise_s = diffusion_factors(s)
    _, noise_t = diffusion_factors(t)
    share_0 = signal_s * (1 - share) / noise_t**2
    share_t = share.sqrt() * noise_s**2 / noise_t**2
    std = (1 - share).sqrt() * noise_s / noise_t
    return _rows(share_0) * x_0 + _rows(share_t) * x_t, _rows(std)


def diffusion_times(steps: int) -> list[float]:
    """Return the times of a sampling, from 1 down to 0; raises ValueError if ``steps`` < 1."""
    if steps < 1:
        raise ValueError(f"The number of sampling steps must be at least 1; got {steps}.")
    return [(steps - k) / steps for k in range(steps)] + [0.0]


def _variance_share(s: Float[Tensor, "*#batch"], t: Float[Tensor, "*#batch"]) -> Tensor:
    """Compute the share of the variance at ``s`` that is left at ``t``."""
    signal_s, _ = diffusion_factors(s)
    signal_t, _ = diffusion_factors(t)
    return (signal_t / signal_s).square()


def _rows(values: Float[Tensor, " B"]) -> Float[Tensor, "B 1 1"]:
    return values[:, None, None]


def ddim_step(
    x_t: Float[Tensor, "B T C"], x_0: Float[Tensor, "B T C"], s: float, t: float
) -> Float[Tensor, "B T C"]:
    """Compute x_s from x_t for constant x_0 and s < t, by DDIM (Song et al. 2021)."""
    (signal_s, signal_t), (noise_s, noise_t) = (
        factors.tolist() for factors in diffusion_factors(torch.tensor([s, t], dtype=torch.float64))
    )
    return signal_s * x_0 + noise_s / noise_t * (x_t - signal_t * x_0)


FINGERS = AXIS_ANGLE_GROUPS[0]
MIN_INITIAL_BRANCH_SHARE = 0.05
"""Limit of the initial balance: no branch starts with a smaller weight."""
LOG_STD_RATIO_BOUNDS = (-3.0, 1.0)
"""Limits of the logarithm of a deviation as a share of the prior's."""
NUM_LAYERS = 7
CONDITION_WIDTH = 64


class Generator(ConditionedNetwork):
    """Network that predicts components of motion: posterior mean and corrections of two branches.

    The posterior mean of x_0 is that of the linear-Gaussian prior; the transformer branches add to
    it in units of its deviation. One branch has the fingers' part of x_t as input, the other that
    of the rest, and both the whole as well. Each predicts every component; a learned weight for
    each component balances them, which starts at the share of the fingers in it.

    A large step leaves much of x_0 open, so x_0 is sampled: a latent adds to the mean, with the
    posterior's deviation times a learned share for each component and each eigenvector over time.
    For a Gaussian process this is the exact posterior from the start, in steps of any size.
    """

    def __init__(
        self, config: GeneratorConfig, prior: GaussianPrior, normaliser: Normaliser
    ) -> None:
        super().__init__(config)
        assert normaliser.unmix is not None
        self.config = config
        self.prior = prior
        self.reach = TimeEmbedding(config.width)
        channels = config.channels
        rest = [c for c in range(channels) if c not in set(FINGERS)]
        self.regions = [FINGERS, rest]
        self.branches = nn.ModuleList(
            MotionBranch(
                config,
                inputs=len(region),
                body_inputs=channels + config.expression_dim,
                channels=channels,
            )
            for region in self.regions
        )
        self.unmix: Tensor
        self.register_buffer("unmix", normaliser.unmix, persistent=False)
        energy = normaliser.unmix.square()
        share = energy[:, FINGERS].sum(1) / energy.sum(1)
        self.balance = nn.Parameter(torch.logit(share, eps=MIN_INITIAL_BRANCH_SHARE))
        self.spread = nn.Linear(config.width + 1, channels + config.window_frames)
        nn.init.zeros_(self.spread.weight)
        nn.init.zeros_(self.spread.bias)

    def forward(
        self,
        x_t: Float[Tensor, "B T C"],
        t: Float[Tensor, " B"],
        s: Float[Tensor, " B"],
        *,
        speech: Float[Tensor, "B T_ctx speech_dim"],
        expression: Float[Tensor, "B T expression_dim"],
        seed: Float[Tensor, "B S C"],
        speaker: Int[Tensor, " B"],
        has_seed: Bool[Tensor, " B"],
        has_speech: Bool[Tensor, " B"],
    ) -> tuple[Float[Tensor, "B T C"], Float[Tensor, "C T B"]]:
        """Predict mean of the clean x_0, and deviation along the prior's eigenvectors.

        `sample_x_0` samples x_0. A step leads from the diffusion time ``t``, 1 (noise) to 0
        (data), to ``s`` below it.
        """
        tokens = self.speech_tokens(speech, has_speech)
        face = mask_expression(expression, has_speech)
        return self.denoised(
            x_t, t, s, tokens=tokens, face=face, seed=seed, speaker=speaker,
            has_seed=has_seed,
        )  # fmt: skip

    def denoised(
        self,
        x_t: Float[Tensor, "B T C"],
        t: Float[Tensor, " B"],
        s: Float[Tensor, " B"],
        *,
        tokens: Float[Tensor, "B T width"],
        face: Float[Tensor, "B T expression_dim"],
        seed: Float[Tensor, "B S C"],
        speaker: Int[Tensor, " B"],
        has_seed: Bool[Tensor, " B"],
    ) -> tuple[Float[Tensor, "B T C"], Float[Tensor, "C T B"]]:
        """Predict as `forward` does, from speech tokens that all steps share."""
        tau, scale = flow_time_and_scale(t)
        with torch.autocast(x_t.device.type, enabled=False):  # bf16 adds jitter
            prior_mean = self.posterior_mean(x_t / scale[:, None, None], tau, seed, has_seed)
        condition = self.condition(t, speaker) + self.reach(s)
        body = torch.cat([prior_mean, face], dim=-1)
        in_channels = x_t @ self.unmix
        fingers, rest = (
            branch(in_channels[..., region], body, tokens, seed, has_seed, condition).float()
            for branch, region in zip(self.branches, self.regions, strict=True)
        )
        unit = torch.lerp(rest, fingers, self.balance.sigmoid())
        with torch.autocast(x_t.device.type, enabled=False):
            own = self.posterior_std_in_eigenbasis(tau, has_seed)
            mean = prior_mean + self.prior.from_eigenbasis(
                own * self.prior.to_eigenbasis(unit, has_seed), has_seed
            )
            open_ = self.spread(torch.cat([condition.float(), has_seed[:, None].float()], dim=-1))
            by_component, by_vector = open_.T.split([x_t.shape[2], x_t.shape[1]])
            return mean, own * (by_component[:, None] + by_vector).clamp(
                *LOG_STD_RATIO_BOUNDS
            ).exp()

    def sample_x_0(
        self,
        mean: Float[Tensor, "B T C"],
        std: Float[Tensor, "C T B"],
        latent: Float[Tensor, "B T C"],
        has_seed: Bool[Tensor, " B"],
    ) -> Float[Tensor, "B T C"]:
        """Sample x_0 from mean and deviation of `forward` and standard normal numbers."""
        return mean + self.prior.from_eigenbasis(std * latent.permute(2, 1, 0), has_seed)

    def posterior_mean(
        self,
        x: Float[Tensor, "B T C"],
        tau: Float[Tensor, " B"],
        seed: Float[Tensor, "B S C"],
        has_seed: Bool[Tensor, " B"],
    ) -> Float[Tensor, "B T C"]:
        """Compute the mean of x_0 at flow time ``tau`` as `GaussianPrior.posterior_mean` does."""
        expected = self.prior.mean_from_seed(seed) * has_seed[:, None, None]
        variance = self._variance(has_seed)
        share = tau * variance / (tau**2 * variance + (1 - tau) ** 2)
        moved = self.prior.to_eigenbasis(x - tau[:, None, None] * expected, has_seed)
        return expected + self.prior.from_eigenbasis(share * moved, has_seed)

    def _variance(self, has_seed: Bool[Tensor, " B"]) -> Float[Tensor, "C T B"]:
        free, held = self.prior.variance[..., None]
        return torch.where(has_seed, held, free)

    def posterior_std_in_eigenbasis(
        self, tau: Float[Tensor, " B"], has_seed: Bool[Tensor, " B"]
    ) -> Float[Tensor, "C T B"]:
        """Compute the posterior's deviation of x_0 along its eigenvectors at flow time ``tau``."""
        variance = self._variance(has_seed)
        return (1 - tau) * (variance / (tau**2 * variance + (1 - tau) ** 2)).sqrt()


class Discriminator(nn.Module):
    """Discriminator of seven layers (linear, SELU, GroupNorm) over both ends of a step.

    Further inputs are its times and the generator's conditions. The first layer is per frame.
    """

    def __init__(self, config: DiscriminatorConfig, motion: GeneratorConfig) -> None:
        super().__init__()
        self.now, self.before = TimeEmbedding(CONDITION_WIDTH), TimeEmbedding(CONDITION_WIDTH)
        self.speaker = nn.Embedding(motion.num_speakers, CONDITION_WIDTH)
        self.motion = motion
        # x_s, x_t, the seed if there is one, speech
        self.frame = _layer(3 * motion.channels + motion.speech_dim, config.frame_width, config)
        flat = motion.window_frames * config.frame_width + 3 * CONDITION_WIDTH
        widths = [flat] + [config.width] * (NUM_LAYERS - 2)
        self.window = nn.Sequential(*(_layer(a, b, config) for a, b in pairwise(widths)))
        self.score = nn.Linear(config.width, 1)

    def forward(
        self,
        x_s: Float[Tensor, "B T C"],
        x_t: Float[Tensor, "B T C"],
        s: Float[Tensor, " B"],
        t: Float[Tensor, " B"],
        *,
        speech: Float[Tensor, "B T_ctx speech_dim"],
        seed: Float[Tensor, "B S C"],
        speaker: Int[Tensor, " B"],
        has_seed: Bool[Tensor, " B"],
        has_speech: Bool[Tensor, " B"],
    ) -> Float[Tensor, " B"]:
        """Compute scores, positive for steps that are classified as real."""
        context = self.motion.speech_context
        spoken = speech[:, context : speech.shape[1] - context] * has_speech[:, None, None]
        padded_seed = F.pad(seed * has_seed[:, None, None], (0, 0, 0, x_t.shape[1] - seed.shape[1]))
        frames = self.frame(torch.cat([x_s, x_t, padded_seed, spoken], dim=-1).flatten(0, 1))
        inputs = [self.now(t), self.before(s), self.speaker(speaker)]
        flat = frames.view(len(x_t), -1)
        return self.score(self.window(torch.cat([flat, *inputs], dim=-1)))[:, 0]


def _layer(inputs: int, outputs: int, config: DiscriminatorConfig) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(inputs, outputs), nn.SELU(), nn.GroupNorm(config.groups, outputs)
    )
