"""The puppet moves."""

from dataclasses import dataclass
from pathlib import Path

import torch

from model.generation.base import Draw, System, Window, Windowing
from model.generation.speech_stream import SpeechWindow
from model.motion.rotations import matrix_from_axis_angle
from model.speech.encoders import make_encoder
from model.storage.checkpoint import load_into, load_weights
from tests.toy_family import FAMILY
from tests.toy_family.network import POSE, Puppet


@dataclass(frozen=True, kw_only=True)
class PuppetSystem(System):
    """Its face is an output, drawn for each sample."""

    network: Puppet

    @torch.inference_mode()
    def window(self, speech: SpeechWindow, before: Window | None, draw: Draw) -> Window:
        pose, face = self.network(speech.around(0, self.windowing.frames))
        tremble = 0.01 * draw.steps * draw.noise((self.windowing.frames, POSE))
        poses = pose + tremble
        root = torch.tensor([0.0, 1.2, 0.0]).expand(*poses.shape[:2], 3)
        rotmat = matrix_from_axis_angle(poses.unflatten(-1, (-1, 3)))
        return Window(rotmat, root, face.expand(draw.samples, -1, -1))


def load(name: str, folder: Path) -> PuppetSystem:
    weights = FAMILY.weights_of(name)
    tensors, card = load_weights(folder, weights)
    network = Puppet(card["config"]["width"])
    load_into(network, tensors, "network.", weights)
    return PuppetSystem(
        name=name,
        card=card,
        sha256s={weights: card["sha256"]},
        speakers=card["speakers"],
        encoder=make_encoder(card["config"]["encoder"]),
        windowing=Windowing(frames=60, overlap=4, context=0),
        samplers=FAMILY.samplers_of(name),
        frame="parent",
        root_motion="place",
        network=network.eval(),
    )
