"""GAN as a system: sampling of a window with few steps."""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from model.generation.base import WindowSpec
from model.motion.packing import rotations
from model.motion.spaces import ROOT_DIM
from model.networks.branch import mask_expression
from model.networks.trained import TrainedWeights
from model.systems.face.face import FaceFirstSystem, SeedingWindow, face_first_fields
from model.systems.gan.config import FAMILY, GeneratorConfig
from model.systems.gan.network import Generator, ddim_step, diffusion_times, posterior


@dataclass(frozen=True, kw_only=True)
class GanSystem(FaceFirstSystem):
    """System with a trained generator, its statistics, and the expression network."""

    config: GeneratorConfig
    network: Generator

    @torch.inference_mode()
    def sample_body(
        self,
        speech: Float[Tensor, "T_ctx dim"],
        expression: Float[Tensor, "T E"],
        seed: Float[Tensor, "B S C"] | None,
        spec: WindowSpec,
    ) -> SeedingWindow:
        """Sample the body from posteriors as trained, or by DDIM."""
        config, size = self.config, spec.num_samples
        seed_poses = (
            torch.zeros(size, config.seed_frames, config.channels) if seed is None else seed
        )
        guide = spec.make_guidance(self.normaliser, "axis-angle")
        copies, has_speech = guide.network_batch_size(size), guide.conditional_mask(size)
        has_seed = torch.full((size,), seed is not None)
        tokens = self.network.speech_tokens(
            guide.duplicate(speech[None]), guide.conditional_mask(1)
        )
        conditions = {
            "tokens": tokens.repeat_interleave(size, dim=0),
            "face": mask_expression(expression.expand(copies, -1, -1), has_speech),
            "seed": guide.duplicate(seed_poses),
            "speaker": torch.full((copies,), spec.speaker_index),
            "has_seed": guide.duplicate(has_seed),
        }

        x = spec.noise((config.window_frames, config.channels))
        for k, (t, s) in enumerate(pairwise(diffusion_times(spec.steps)), start=1):
            t_batch, s_batch = torch.full((size,), t), torch.full((size,), s)
            answers, open_ = self.network.denoised(
                *map(guide.duplicate, (x, t_batch, s_batch)), **conditions
            )
            mean_x_0 = guide.combine(answers)
            if spec.sampler == "ddim":
                x = ddim_step(x, mean_x_0, s, t)
                continue
            again, latent = spec.noise((2, *x.shape[1:]), k).unbind(1)
            x_0 = self.network.sample_x_0(mean_x_0, open_[..., :size], latent, has_seed)
            mean, std = posterior(x, x_0, s_batch, t_batch)
            x = mean + std * again
        vectors = self.normaliser.restore(x)
        return SeedingWindow(
            rotmat=rotations(vectors, "axis-angle"),
            root=vectors[..., -ROOT_DIM:],
            expression=expression.expand(size, -1, -1),
            clean=x,
        )


def load(name: str, folder: Path) -> GanSystem:
    """Load a system with its expression network."""
    trained = TrainedWeights.read(folder, FAMILY.weights_name(name))
    config = trained.card.config(GeneratorConfig, "generator")
    network = Generator(config, trained.prior(config.seed_frames), trained.normaliser)
    return GanSystem(
        **face_first_fields(FAMILY, name, trained, config, folder),
        rotation_frame="local",
        root_format="place",
        network=trained.load_into(network),
    )
