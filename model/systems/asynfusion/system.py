"""AsynFusion as a system: sampling of a window of face and body in two branches.

``x_k = sqrt(abar_k) x_0 + sqrt(1 - abar_k) eps`` (eq. 5) divided by the sum of the two roots lies
on the straight path from noise to data at the flow time ``sqrt(abar_k) / (sqrt(abar_k) + sqrt(1 -
abar_k))``. So networks, priors and interpolation of flow matching serve diffusion too: only the
times differ. A step that predicts clean motion x_1 predicts the noise ``(x_t - t x_1) / (1 - t)``,
and DDIM returns to the path of that noise at an earlier step.

The branch with more steps sets the pace. The other takes its steps at even distances among them, so
that both are at similar noise when they exchange features; in between it is idle, and the active
one uses its features of its last step, which costs nothing.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal, get_args

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from model.generation.base import SpeechWindow, System, Window, Windowing, WindowSpec
from model.motion.packing import rotations
from model.motion.spaces import ROOT_DIM
from model.networks.trained import TrainedWeights
from model.sampling.flow import ClassifierFreeGuidance, interpolate
from model.systems.asynfusion.config import FACE_SHARE, FAMILY, DualBranchConfig
from model.systems.asynfusion.network import (
    BRANCHES,
    GESTURE,
    DualBranchNetwork,
    FeatureBuffer,
    Pair,
    PairStatistics,
    map_branches,
    read_statistics,
)

NUM_STEPS = 1000
FIRST_BETA, LAST_BETA = 1e-4, 0.02
"""Betas of the linear schedule, as in DDPM (Ho et al. 2020); the paper only says 1,000 steps."""


@cache
def flow_times() -> Float[Tensor, "1000"]:
    """Return the flow time of each step; step 0 is next to the data."""
    betas = torch.linspace(FIRST_BETA, LAST_BETA, NUM_STEPS, dtype=torch.float64)
    alphas_cumprod = torch.cumprod(1 - betas, dim=0)
    return (alphas_cumprod.sqrt() / (alphas_cumprod.sqrt() + (1 - alphas_cumprod).sqrt())).float()


def noise_from_clean(
    x_t: Float[Tensor, "B T C"], x_1: Float[Tensor, "B T C"], t: Float[Tensor, " B"]
) -> Float[Tensor, "B T C"]:
    """Compute the noise that leads from clean motion to ``x_t``."""
    t = t[:, None, None]
    return (x_t - t * x_1) / (1 - t)


def trailing_steps(count: int) -> Int[Tensor, " count"]:
    """Return steps evenly from noise (999) down (Lin et al. 2024); raises ValueError."""
    if not 1 <= count <= NUM_STEPS:
        raise ValueError(
            f"The number of sampling steps must be from 1 to {NUM_STEPS}; got {count}."
        )
    return (NUM_STEPS - torch.arange(count) * NUM_STEPS / count).round().long() - 1


Noise = Callable[[int, int], Float[Tensor, "B T C"]]
"""Function from branch and number of its step to standard normal noise; step 0's is the start."""


SamplerName = Literal["ddim", "lcm"]
SAMPLER_NAMES: tuple[SamplerName, ...] = get_args(SamplerName)
"""Names of samplers."""


def branch_step_indices(count: int, total: int) -> list[int]:
    """Return at which of ``total`` steps a branch with ``count`` steps is active."""
    return [j * total // count for j in range(count)]


def sample(
    network: DualBranchNetwork,
    guide: ClassifierFreeGuidance,
    noise: Noise,
    step_counts: Sequence[int],
    sampler: SamplerName,
    *,
    speech_tokens: Float[Tensor, "copies T width"],
    seed: Pair,
    speaker: Int[Tensor, " B"],
    has_seed: Bool[Tensor, " B"],
) -> Pair:
    """Sample clean motion of both branches, normalised components.

    Args:
        guide: guidance of the body; the face stays as trained. With guidance, both branches of the
            unconditional copies have no speech, as in training.
        step_counts: steps of the expression branch and of the gesture branch.
        sampler: ``ddim`` follows the path of the noise that a step predicts; ``lcm`` adds new noise
            to the motion that it predicts (Luo et al. 2023).
        speech_tokens: tokens of the speech, with guidance followed by those of absent speech.
    """
    twice = guide.duplicate
    conditions: dict[str, Any] = {
        "speech_tokens": speech_tokens, "seed": map_branches(twice, seed),
        "speaker": twice(speaker), "has_seed": twice(has_seed),
    }  # fmt: skip
    grids = [flow_times()[trailing_steps(count)].tolist() for count in step_counts]
    own = [branch_step_indices(count, max(step_counts)) for count in step_counts]
    x = [noise(which, 0) for which in BRANCHES]
    t = [torch.full((len(x[which]),), grids[which][0]) for which in BRANCHES]
    buffer: FeatureBuffer = {}
    for k in range(max(step_counts)):
        busy = [which for which in BRANCHES if k in own[which]]
        now = map_branches(twice, (x[0], x[1])), map_branches(twice, (t[0], t[1]))
        predictions = network.predict_active(busy, *now, buffer, **conditions)
        for which in busy:
            clean = predictions[which]
            clean = guide.combine(clean) if which == GESTURE else clean[: len(speaker)]
            done = own[which].index(k) + 1
            if done == step_counts[which]:
                x[which], t[which] = clean, torch.ones_like(t[which])
                continue
            follows = sampler == "ddim"
            noised = noise_from_clean(x[which], clean, t[which]) if follows else noise(which, done)
            t[which] = torch.full_like(t[which], grids[which][done])
            x[which] = interpolate(noised, clean, t[which])
    return x[0], x[1]


@dataclass(frozen=True)
class DualWindow(Window):
    """A window with the input of the next one."""

    unblended_face: Float[Tensor, "B n E"]
    """Normalised blendshapes of its frames before blending."""
    unblended_body: Float[Tensor, "B n C"]
    """Normalised body motion of its frames before blending."""


@dataclass(frozen=True, kw_only=True)
class AsynFusionSystem(System):
    """Two branches with the statistics; they include the face."""

    config: DualBranchConfig
    network: DualBranchNetwork
    statistics: PairStatistics

    @torch.inference_mode()
    def window(self, speech: SpeechWindow, before: Window | None, spec: WindowSpec) -> DualWindow:
        assert before is None or isinstance(before, DualWindow)
        config, size = self.config, spec.num_samples
        channels = config.expression_dim, config.gesture_dim
        if before is None:
            seed = [torch.zeros(size, config.seed_frames, count) for count in channels]
        else:
            seed = [
                stream[:, -config.seed_frames :]
                for stream in (before.unblended_face, before.unblended_body)
            ]
        around = speech.trim_context(config.speech_context, config.window_frames)
        guide = spec.make_guidance(self.statistics[GESTURE].normaliser, "axis-angle")
        tokens = self.network.speech_tokens(
            guide.duplicate(around[None]), guide.conditional_mask(1)
        )
        sampled = sample(
            self.network,
            guide,
            lambda which, step: spec.noise((config.window_frames, channels[which]), which, step),
            (max(1, round(spec.steps * FACE_SHARE[self.name])), spec.steps),
            SAMPLER_NAMES[SAMPLER_NAMES.index(spec.sampler)],
            seed=(seed[0], seed[1]),
            has_seed=torch.full((size,), before is not None),
            speech_tokens=tokens.repeat_interleave(size, dim=0),
            speaker=torch.full((size,), spec.speaker_index),
        )
        units, vectors = (
            stream.normaliser.restore(x) for stream, x in zip(self.statistics, sampled, strict=True)
        )
        units = units.clamp(0, 1)
        face, body = (
            stream.normaliser.normalise(motion)
            for stream, motion in zip(self.statistics, (units, vectors), strict=True)
        )
        return DualWindow(
            rotmat=rotations(vectors, "axis-angle"),
            root=vectors[..., -ROOT_DIM:],
            expression=units,
            unblended_face=face,
            unblended_body=body,
        )


def load(name: str, folder: Path) -> AsynFusionSystem:
    """Load a system."""
    trained = TrainedWeights.read(folder, FAMILY.weights_name(name))
    config = trained.card.config(DualBranchConfig, "network")
    statistics = read_statistics(trained, config.seed_frames)
    consistent = trained.card.setting("aim") == "teacher"
    fields = FAMILY.system_fields(name, trained.card)
    if not trained.card.setting("speech_dropout"):  # trained with speech only
        fields["samplers"] = tuple(
            replace(one, default_guidance=None) for one in fields["samplers"]
        )
    return AsynFusionSystem(
        **fields,
        sha256s={trained.name: trained.sha256},
        windowing=Windowing(config.window_frames, config.seed_frames, config.speech_context),
        rotation_frame="local",
        root_format="place",
        config=config,
        network=trained.load_into(DualBranchNetwork(config, statistics, consistent=consistent)),
        statistics=statistics,
    )
