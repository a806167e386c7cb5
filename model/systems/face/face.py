"""Expression network: samples blendshapes from speech and speaker, as part of a system.

GlobalDiff estimates expressions "directly" from audio, because lips follow phonemes almost one to
one. Lids and brows do not: the best estimate of a blink is a face that never blinks. So the face is
sampled by flow matching like the body, in the same windows, on a linear-Gaussian prior of the face.
One network serves every system, so that all have the same face; a plan, if the system has one, adds
brows, smiles and blinks.
"""

import functools
from abc import abstractmethod
from collections import OrderedDict
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import torch
from jaxtyping import Bool, Float, Shaped
from torch import Tensor

from model.generation.base import SpeechWindow, System, Window, Windowing, WindowSpec, crossfade
from model.generation.family import Family
from model.motion.packing import Normaliser
from model.networks.branch import ExtraConditionEncoder, PriorResidualNetwork
from model.networks.config import BranchConfig
from model.networks.trained import TrainedWeights
from model.plan.plan_features import NUM_HEAD_FACE_TRACKS
from model.sampling.flow import seeded_noise
from model.sampling.prior import GaussianPrior
from model.storage.cards import CheckpointError, load_card
from model.systems.face.config import EXPRESSION, ExpressionConfig


class FaceNetwork(PriorResidualNetwork):
    """Network of blendshapes x_1 from a plan's tracks and `PriorResidualNetwork`'s inputs."""

    config: ExpressionConfig

    def __init__(self, config: ExpressionConfig, prior: GaussianPrior) -> None:
        super().__init__(config, prior, channels=config.expression_dim, expression_dim=0)
        self.plan = ExtraConditionEncoder(NUM_HEAD_FACE_TRACKS, config.width, config.speech_context)

    def forward(
        self,
        x_t: Float[Tensor, "B T E"],
        t: Float[Tensor, " B"],
        *,
        tracks: Float[Tensor, "B T_ctx tracks"] | None = None,
        has_plan: Bool[Tensor, " B"] | None = None,
        **conditions: Shaped[Tensor, "B ..."],
    ) -> Float[Tensor, "B T E"]:
        """Predict the clean components x_1, with the inputs of `PriorResidualNetwork` and a plan.

        ``tracks`` are `model.plan.plan_features.HEAD_FACE_TRACKS` of the speech's frames;
        ``has_plan`` drops them.
        """
        if tracks is None:
            return super().forward(x_t, t, **conditions)
        has_plan_mask = conditions["has_seed"].new_ones(len(x_t)) if has_plan is None else has_plan
        return super().forward(x_t, t, extra_tokens=self.plan(tracks, has_plan_mask), **conditions)


FACE_STEPS = 12
FACE_CACHE_WINDOWS = 512
"""Number of cached windows: about 21 MB with their inputs, a quarter of an hour of speech."""


@dataclass(frozen=True)
class FaceModel:
    """Trained expression network with the statistics of its blendshapes."""

    network: FaceNetwork
    normaliser: Normaliser
    sha256: str
    _cache: OrderedDict[tuple, Tensor] = field(default_factory=OrderedDict, repr=False)

    @property
    def config(self) -> ExpressionConfig:
        return self.network.config

    @torch.inference_mode()
    def sample(
        self,
        speech: Float[Tensor, "B T_ctx speech_dim"],
        speaker: int,
        seed: Float[Tensor, "B S E"] | None,
        noise: Float[Tensor, "B T E"],
        face_tracks: Float[Tensor, "B T_ctx tracks"] | None = None,
    ) -> Float[Tensor, "B T E"]:
        """Sample windows of blendshapes.

        ``seed`` has the normalised last frames of the windows before, None at the start of a clip;
        ``face_tracks`` are `model.plan.plan_features.HEAD_FACE_TRACKS` of the speech's frames.
        """
        size = len(speech)
        seed_poses = torch.zeros_like(noise[:, : self.config.seed_frames]) if seed is None else seed
        conditions = {
            "speech": speech,
            "seed": seed_poses,
            "speaker": torch.full((size,), speaker),
            "has_seed": torch.full((size,), seed is not None),
            "has_speech": torch.ones(size, dtype=torch.bool),
        }

        def predict(x_t: Float[Tensor, "B T E"], t: float) -> Tensor:
            return self.network(x_t, torch.full((size,), t), tracks=face_tracks, **conditions)

        x_1 = self.network.prior.sample(predict, noise, seed, steps=FACE_STEPS)
        return self.normaliser.restore(x_1).clamp(0, 1)

    def window(
        self,
        speech: Float[Tensor, "T_ctx speech_dim"],
        speaker: int,
        before: Float[Tensor, "n E"] | None,
        noise_seed: int,
        index: int,
        face_tracks: Float[Tensor, "T_ctx tracks"] | None = None,
    ) -> Float[Tensor, "T E"]:
        """Sample the blendshapes of one window, blended with the end of the one before.

        Results are cached, as all systems of a run without a plan have the same face.
        """
        shared = self.config.seed_frames
        end = None if before is None else before[-shared:]
        key_parts = (
            None if each is None else each.numpy().tobytes() for each in (speech, face_tracks, end)
        )
        key = speaker, noise_seed, index, *key_parts
        cached = self._cache.get(key)
        if cached is None:
            seed = None if end is None else self.normaliser.normalise(end[None])
            noise = self.noise(noise_seed, index)
            tracks = None if face_tracks is None else face_tracks[None]
            cached = self.sample(speech[None], speaker, seed, noise, tracks)[0]
            if end is not None:
                cached = torch.cat([crossfade(end, cached[:shared]), cached[shared:]])
            self._cache[key] = cached
            while len(self._cache) > FACE_CACHE_WINDOWS:
                self._cache.popitem(last=False)
        return cached

    def noise(self, noise_seed: int, index: int) -> Float[Tensor, "1 T E"]:
        """Draw the noise of window ``index``, the same for every system and length."""
        shape = 1, self.config.window_frames, self.config.expression_dim
        return seeded_noise([noise_seed, 1, index], shape)


def load_face(folder: Path) -> FaceModel:
    """Load the expression network, once for all systems of a folder."""
    return _load(folder, load_card(folder, EXPRESSION).sha256)


@functools.lru_cache(maxsize=4)
def _load(folder: Path, sha256: str) -> FaceModel:
    trained = TrainedWeights.read(folder, EXPRESSION)
    config = trained.card.config(ExpressionConfig, "expression")
    network = trained.load_into(FaceNetwork(config, trained.prior(config.seed_frames)))
    return FaceModel(network, trained.normaliser, sha256)


@dataclass(frozen=True)
class SeedingWindow(Window):
    """A window with the input of the next one."""

    clean: Float[Tensor, "B n C"]
    """Normalised motion of its frames before blending, which only seeds the next window."""


@dataclass(frozen=True, kw_only=True)
class FaceFirstSystem(System):
    """System with the face of the expression network, which is sampled before the body."""

    window_type: ClassVar[type[Window]] = SeedingWindow
    config: BranchConfig
    """Shape of the body's network."""
    normaliser: Normaliser
    """Statistics of the body's motion."""
    face: FaceModel

    def face_tracks(
        self, conditioning: Float[Tensor, "T_ctx dim"]
    ) -> Float[Tensor, "T_ctx tracks"] | None:
        """Return the plan's face tracks in the result of `conditioning`; None without a plan."""
        return None

    @abstractmethod
    def sample_body(
        self,
        speech: Float[Tensor, "T_ctx dim"],
        expression: Float[Tensor, "T E"],
        seed: Float[Tensor, "B S C"] | None,
        spec: WindowSpec,
    ) -> SeedingWindow:
        """Sample the body of one window.

        ``speech`` has features of the window and ``config.speech_context`` frames on either side,
        as `conditioning` returns them: the encoder's first. ``seed`` is the normalised motion of
        the first frames; None at the start of a clip.
        """

    def window(
        self, speech: SpeechWindow, before: Window | None, spec: WindowSpec
    ) -> SeedingWindow:
        """Generate a window (`System.window`): the face, for all samples, then the body."""
        assert before is None or isinstance(before, SeedingWindow)
        frames = self.windowing.frames
        speech_window = speech.trim_context(self.face.config.speech_context, frames)
        face = self.face.window(
            speech_window[:, : self.encoder.dim],
            spec.speaker_index,
            None if before is None else before.expression[0],
            spec.seed,
            spec.index,
            self.face_tracks(speech_window),
        )
        seed = None if before is None else before.clean[:, -self.config.seed_frames :]
        return self.sample_body(
            speech.trim_context(self.config.speech_context, frames), face, seed, spec
        )

    def join(self, older: Window, newer: Window) -> Window:
        """Blend the bodies of two windows; their faces are blended already."""
        return replace(super().join(older, newer), expression=newer.expression)


def face_first_fields(
    family: Family, name: str, body: TrainedWeights, config: BranchConfig, folder: Path
) -> dict[str, Any]:
    """Return the fields of a `FaceFirstSystem`, without the network of the body.

    Raises CheckpointError if windows of body and face differ, or face files are missing or damaged.
    """
    face = load_face(folder)
    windows = config.window_frames, config.seed_frames
    if windows != (face.config.window_frames, face.config.seed_frames):
        raise CheckpointError(
            f"{body.name} and the expression network were trained with different window lengths or "
            "overlaps; use weights that match."
        )
    return family.system_fields(name, body.card) | {
        "sha256s": {body.name: body.sha256, EXPRESSION: face.sha256},
        "windowing": Windowing(*windows, max(config.speech_context, face.config.speech_context)),
        "config": config,
        "normaliser": body.normaliser,
        "face": face,
    }
