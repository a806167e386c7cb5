"""Motion network of GlobalDiff, and the systems that use it."""

from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from conventions.rates import FPS
from model.generation.base import WindowSpec, fade_weights
from model.motion import packing
from model.motion.packing import HAND_CHANNELS, MOTION_DIM, NON_HAND_CHANNELS
from model.motion.rotations import rot6d_from_matrix
from model.motion.spaces import ROOT_DIM
from model.networks.branch import (
    ConditionedNetwork,
    MotionBranch,
    PriorResidualNetwork,
    mask_expression,
)
from model.networks.trained import TrainedWeights
from model.sampling.flow import ClassifierFreeGuidance, sample
from model.sampling.prior import GaussianPrior
from model.sampling.samplers import FLOW_SAMPLERS
from model.systems.face.face import FaceFirstSystem, SeedingWindow, face_first_fields
from model.systems.globaldiff.config import FAMILY, NetworkConfig


class MotionNetwork(ConditionedNetwork):
    """Network that predicts x_1 (normalised motion) from x_t, time and conditions."""

    prior = None
    """Absent prior; `PriorResidualNetwork` has one."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        self.config = config
        self.hands, self.torso = (
            MotionBranch(
                config,
                inputs=len(channels),
                body_inputs=MOTION_DIM + config.expression_dim,
                channels=len(channels),
            )
            for channels in (HAND_CHANNELS, NON_HAND_CHANNELS)
        )

    def forward(
        self,
        x_t: Float[Tensor, "B T 333"],
        t: Float[Tensor, " B"],
        *,
        speech: Float[Tensor, "B T_ctx speech_dim"],
        expression: Float[Tensor, "B T expression_dim"],
        seed: Float[Tensor, "B S 333"],
        speaker: Int[Tensor, " B"],
        has_seed: Bool[Tensor, " B"],
        has_speech: Bool[Tensor, " B"],
    ) -> Float[Tensor, "B T 333"]:
        """Predict clean motion x_1 from x_t at flow time t, 0 (noise) to 1 (data).

        Args:
            speech: features of the window and of ``speech_context`` frames before and after it.
            seed: the clean first ``S`` frames; ignored where ``has_seed`` is false.
            speaker: 0 is "no speaker".
            has_speech: false hides speech and expression.
        """
        condition = self.condition(t, speaker)
        speech_tokens = self.speech_tokens(speech, has_speech)
        body = torch.cat([x_t, mask_expression(expression, has_speech)], dim=-1)
        x_1 = torch.empty_like(x_t)
        for branch, channels in ((self.hands, HAND_CHANNELS), (self.torso, NON_HAND_CHANNELS)):
            region, region_seed = x_t[..., channels], seed[..., channels]
            predicted = branch(region, body, speech_tokens, region_seed, has_seed, condition)
            x_1[..., channels] = predicted.to(x_1.dtype)  # it is bf16 under autocast
        return x_1

    @torch.no_grad()
    def initialise_output(self, x_1: Float[Tensor, "333"]) -> None:
        """Set the bias of the output to a motion vector, so that training starts from its pose.

        With a zero output, the gradient of the orthonormalisation of 6D would be unbounded.
        """
        self.hands.out.bias.copy_(x_1[HAND_CHANNELS])
        self.torso.out.bias.copy_(x_1[NON_HAND_CHANNELS])


def make_network(
    config: NetworkConfig, prior: GaussianPrior | None
) -> MotionNetwork | PriorResidualNetwork:
    """Make an untrained network, with a prior if there is one."""
    if prior is None:
        return MotionNetwork(config)
    return PriorResidualNetwork(
        config, prior, channels=config.motion_dim, expression_dim=config.expression_dim
    )


INPAINT_UNTIL = 0.7
"""Flow time up to which the seed frames are held. With 10 Euler steps, wrist jerk at seams was 1.2
times the inside's (worst frame 1.6); held to the end 1.3 (2.7)."""


@dataclass(frozen=True, kw_only=True)
class GlobalDiffSystem(FaceFirstSystem):
    """System with a motion network, its statistics, and the expression network."""

    config: NetworkConfig
    network: MotionNetwork | PriorResidualNetwork
    drift_correction_s: float = 40.0
    """Time (s) in which a body with absolute position would return home at the initial speed."""

    @torch.inference_mode()
    def sample_body(
        self,
        speech: Float[Tensor, "T_ctx dim"],
        expression: Float[Tensor, "T E"],
        seed: Float[Tensor, "B S C"] | None,
        spec: WindowSpec,
    ) -> SeedingWindow:
        """Sample the body, with in-painting of the seed early in the flow.

        Until `INPAINT_UNTIL`, the seed frames replace the prediction of the first frames; later the
        network may change them, which halves the jump after the seed. A network with a
        prior has the seed as a condition instead. `System.join` blends the windows afterwards.
        """
        config, prior, size = self.config, self.network.prior, spec.num_samples
        x_0 = self.noise(spec)
        seed_poses = torch.zeros(size, config.seed_frames, x_0.shape[-1]) if seed is None else seed
        last_prediction = x_0
        guide = self.make_guidance(spec)
        copies, has_speech = guide.network_batch_size(size), guide.conditional_mask(size)
        conditions = {
            **self.split_conditioning(speech, has_speech),
            "expression": expression.expand(copies, -1, -1),
            "seed": guide.duplicate(seed_poses),
            "speaker": self.speaker_inputs(spec, has_speech),
            "has_seed": torch.full((copies,), seed is not None),
        }

        def predict(x_t: Float[Tensor, "B T C"], t: float) -> Tensor:
            nonlocal last_prediction
            outputs = self.network(guide.duplicate(x_t), torch.full((copies,), t), **conditions)
            last_prediction = guide.combine(outputs)
            if seed is None or prior is not None or t >= INPAINT_UNTIL:
                return last_prediction
            return torch.cat([seed, last_prediction[:, config.seed_frames :]], dim=1)

        sampler = FLOW_SAMPLERS[FLOW_SAMPLERS.index(spec.sampler)]
        if prior is not None and sampler != "reinterpolate":
            x_1 = prior.sample(predict, x_0, seed, steps=spec.steps, heun=sampler == "heun")
        else:
            sample(predict, x_0, steps=spec.steps, sampler=sampler)
            # All samplers end there up to rounding; in one step, their result has the seed frames.
            x_1 = last_prediction
        vectors = self.normaliser.restore(x_1)
        if seed is not None and config.root == "place":
            vectors = pull_towards_origin(vectors, config.seed_frames, self.drift_correction_s)
        rotmat, root = packing.rotations(vectors, config.rotation_space), vectors[..., -ROOT_DIM:]
        if config.rotation_space != "axis-angle":  # rows of any length become those of a rotation
            vectors = packing.join_channels(rot6d_from_matrix(rotmat), root)
        return SeedingWindow(
            rotmat=rotmat,
            root=root,
            expression=expression.expand(size, -1, -1),
            clean=self.normaliser.normalise(vectors),
        )

    def noise(self, spec: WindowSpec) -> Float[Tensor, "B T C"]:
        """Draw the noise at the start of the flow."""
        return spec.noise((self.config.window_frames, self.config.motion_dim))

    def make_guidance(self, spec: WindowSpec) -> ClassifierFreeGuidance:
        """Return the classifier-free guidance of the network."""
        return spec.make_guidance(self.normaliser, self.config.rotation_space)

    def split_conditioning(
        self, conditioning: Float[Tensor, "T_ctx dim"], has_speech: Bool[Tensor, " copies"]
    ) -> dict[str, Tensor]:
        """Split `conditioning` into the network's inputs by name, one row for each copy."""
        return {"speech": conditioning.expand(len(has_speech), -1, -1), "has_speech": has_speech}

    def speaker_inputs(
        self, spec: WindowSpec, has_speech: Bool[Tensor, " copies"]
    ) -> Int[Tensor, " copies"]:
        """Return the speaker for each copy; 0 means no speaker."""
        return torch.full(has_speech.shape, spec.speaker_index)


def pull_towards_origin(
    vectors: Float[Tensor, "B T C"], seed_frames: int, correction_s: float
) -> Float[Tensor, "B T C"]:
    """Pull the root towards home, x = z = 0 of the training data, by its share of ``correction_s``.

    The distance from home is that of the seed's last frame. The network's own pull is too weak for
    long speech: without this a body was .8 m from the mean of its positions after ten minutes.
    """
    frames = vectors.shape[1]
    share = (frames - seed_frames) / FPS / correction_s
    weight = torch.zeros(frames)
    weight[seed_frames:] = fade_weights(frames - seed_frames)
    home = vectors.clone()
    x_and_z = [-ROOT_DIM, -ROOT_DIM + 2]
    away = vectors[:, seed_frames - 1, None, x_and_z]
    home[..., x_and_z] -= share * weight[:, None] * away
    return home


def load(name: str, folder: Path) -> GlobalDiffSystem:
    """Load a system with its expression network."""
    trained = TrainedWeights.read(folder, name)
    config = trained.card.config(NetworkConfig, "network")
    prior = trained.prior(config.seed_frames) if config.has_prior else None
    return GlobalDiffSystem(
        **face_first_fields(FAMILY, name, trained, config, folder),
        rotation_frame="global" if config.rotation_space == "global" else "local",
        root_format=config.root,
        network=trained.load_into(make_network(config, prior)),
    )
