"""The expression network: speech and speaker to face units, drawn and not averaged.

GlobalDiff estimates expressions "directly" from audio, because lips follow phonemes almost one to
one. Lids and brows do not: the best estimate of a blink is a face that never blinks. So the face is
drawn by flow matching like the body, in the same windows, on a linear-Gaussian prior of its own.
One network serves every system, so that all of them show the same face; a plan, where a system has
one, tells it of brows, smiles and blinks.
"""

import functools
import hashlib
from collections import OrderedDict
from dataclasses import dataclass, field
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from model.generation.stitching import fade
from model.motion.packing import Normaliser
from model.sampling.flow import seeded_noise
from model.sampling.prior import GaussianPrior
from model.storage.cards import CheckpointError, load_card
from model.storage.checkpoint import load_into, load_weights
from model.storage.settings import from_dict
from model.systems.face.config import EXPRESSION, ExpressionConfig
from model.systems.face.network import FaceNetwork

FACE_STEPS = 12
REMEMBERED_WINDOWS = 512
"""About 7 MB: a quarter of an hour of speech."""


@dataclass(frozen=True)
class Face:
    """A trained expression network with the statistics of its units."""

    network: FaceNetwork
    normaliser: Normaliser
    sha256: str
    _remembered: OrderedDict[bytes, Tensor] = field(default_factory=OrderedDict, repr=False)

    @property
    def config(self) -> ExpressionConfig:
        return self.network.config

    @torch.inference_mode()
    def draw(
        self,
        speech: Float[Tensor, "B heard speech_dim"],
        speaker: int,
        seed: Float[Tensor, "B S E"] | None,
        noise: Float[Tensor, "B T E"],
        plan: Float[Tensor, "B heard tracks"] | None = None,
    ) -> tuple[Float[Tensor, "B T E"], Float[Tensor, "B S E"]]:
        """Windows of face units, and the seeds of the windows that follow them.

        Args:
            seed: normalised last frames of the windows before, as this returned them; None where
                a face begins.
            plan: `model.plan.tracks.FACE_TRACKS` of the frames that are heard.
        """
        size = len(speech)
        known = torch.zeros_like(noise[:, : self.config.seed_frames]) if seed is None else seed
        conditions = {
            "speech": speech,
            "seed": known,
            "speaker": torch.full((size,), speaker),
            "has_seed": torch.full((size,), seed is not None),
            "has_speech": torch.ones(size, dtype=torch.bool),
        }

        def predict(x_t: Tensor, t: float) -> Tensor:
            return self.network(x_t, torch.full((size,), t), tracks=plan, **conditions)

        x_1 = self.network.prior.sample(predict, noise, seed, steps=FACE_STEPS)
        units = self.normaliser.restore(x_1).clamp(0, 1)
        return units, self.normaliser.normalise(units[:, -self.config.seed_frames :])

    def window(
        self,
        speech: Float[Tensor, "heard speech_dim"],
        speaker: int,
        before: Float[Tensor, "n E"] | None,
        noise_seed: int,
        index: int,
        plan: Float[Tensor, "heard tracks"] | None = None,
    ) -> Float[Tensor, "T E"]:
        """Face units of one window, joined to those of the window before, whose last frames are
        this one's first. Drawn once for all systems of a run that have no plan: their face depends
        on nothing that they differ in, so what was drawn before is remembered."""
        shared = self.config.seed_frames
        end = None if before is None else before[-shared:]
        told = hashlib.blake2b(repr((speaker, noise_seed, index)).encode())
        told.update(speech.numpy().tobytes())
        if plan is not None:
            told.update(plan.numpy().tobytes())
        if end is not None:
            told.update(end.numpy().tobytes())
        key = told.digest()
        found = self._remembered.get(key)
        if found is None:
            seed = None if end is None else self.normaliser.normalise(end[None])
            noise = self.noise(noise_seed, index)
            planned = None if plan is None else plan[None]
            drawn, _ = self.draw(speech[None], speaker, seed, noise, planned)
            found = drawn[0]
            if end is not None:
                found = torch.cat([fade(end, found[:shared]), found[shared:]])
            self._remembered[key] = found
            while len(self._remembered) > REMEMBERED_WINDOWS:
                self._remembered.popitem(last=False)
        return found

    def noise(self, seed: int, window: int) -> Float[Tensor, "1 T E"]:
        """The same for every system and length."""
        shape = 1, self.config.window_frames, self.config.expression_dim
        return seeded_noise([seed, 1, window], shape)


def load_face(folder: Path) -> Face:
    """Read the expression network, once for all systems of a folder.

    Raises:
        CheckpointError: if its files are missing or damaged.
    """
    return _load(folder, load_card(folder, EXPRESSION)["sha256"])


@functools.lru_cache(maxsize=4)
def _load(folder: Path, sha256: str) -> Face:
    tensors, card = load_weights(folder, EXPRESSION)
    try:
        config = from_dict(ExpressionConfig, card["config"]["expression"])
        normaliser = Normaliser.of_tensors(tensors)
        prior = GaussianPrior(tensors["prior.covariance"], config.seed_frames)
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise CheckpointError(f"The card of {EXPRESSION} lacks or misstates {error}.") from None
    network = FaceNetwork(config, prior)
    load_into(network, tensors, "network.", EXPRESSION)
    network.eval().requires_grad_(False)
    return Face(network, normaliser, sha256)
