"""Training of the speech encoder on the corpus's exact annotation."""

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor, nn

from model.data.annotated import annotated_speech, prepare_plans
from model.data.prepared import Batch, PreparedData
from model.networks.speech_codes import CodesNetwork, SpeechReading
from model.speech.codes import TOLD
from model.systems.speech_encoder.config import SpeechEncoderConfig
from model.training.parallel import Draws
from model.training.targets import fit_features, heard
from model.training.task import DescentTask, StepLoss, TaskSetup

_NUMBERS = ("strength", "speed")
"""Of `TOLD` those that are no logits."""


class CodesTask(DescentTask):
    """Cross-entropies of phone, accent, phrase end, voice and strokes on words, squared errors of
    an accent's strength where there is one and of the speed."""

    config: SpeechEncoderConfig

    def __init__(self, config: SpeechEncoderConfig, data: PreparedData, setup: TaskSetup) -> None:
        given, shape = setup.begin(config, data), config.codes
        self.spoken = annotated_speech(data, prepare_plans(data, 1 + max(data.speakers)))
        network = CodesNetwork(shape)
        normaliser = given.normaliser if given else fit_features(data)
        super().__init__(
            setup, config, given, network, normaliser, config.window_frames, shape.context
        )

    def loss(self, network: nn.Module, batch: Batch, draws: Draws) -> StepLoss:
        config, shard = self.config, draws.shard
        with torch.no_grad():
            features = shard.of(heard(config, network, batch, draws.generator))
            speech = self.normaliser.normalise(features)
            phone, told = (shard.of(part) for part in self.spoken.of(batch))
        with shard.autocast():
            reading = network(speech)
        inside = slice(config.codes.context, speech.shape[1] - config.codes.context)
        found = SpeechReading(reading.phone[:, inside].float(), reading.told[:, inside].float())
        right = (found.phone.argmax(-1) == phone).float().mean()
        return StepLoss(terms(found, phone, told), {"phones_right": right})


make_task = CodesTask


def terms(
    found: SpeechReading, phone: Int[Tensor, "B T"], told: Float[Tensor, "B T told"]
) -> dict[str, Float[Tensor, ""]]:
    """Each part of the loss."""
    losses = {"phone": F.cross_entropy(found.phone.flatten(0, 1), phone.flatten())}
    for number, name in enumerate(TOLD):
        said, wanted = found.told[..., number], told[..., number]
        if name not in _NUMBERS:
            losses[name] = F.binary_cross_entropy_with_logits(said, wanted)
            continue
        counts = told[..., TOLD.index("accent")] if name == "strength" else torch.ones_like(said)
        losses[name] = ((said - wanted).square() * counts).sum() / counts.sum().clamp_min(1)
    return losses
