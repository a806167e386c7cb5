"""A trained AsynFusion: speech and the window before to a window of face and body."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from model.generation.base import Draw, SpeechWindow, System, Window, Windowing
from model.motion.packing import rotations
from model.motion.spaces import ROOT_DIM
from model.networks.trained import Trained
from model.sampling.flow import seeded_noise
from model.systems.asynfusion.config import FACE_SHARE, FAMILY, DualBranchConfig
from model.systems.asynfusion.network import (
    GESTURE,
    DualBranchNetwork,
    Streams,
    read_streams,
)
from model.systems.asynfusion.sampling import WAYS, sample


@dataclass(frozen=True)
class DualWindow(Window):
    """A window, and what the next one starts from."""

    face: Float[Tensor, "B n E"]
    """Normalised face units of its frames, before they are joined."""
    body: Float[Tensor, "B n C"]
    """And its normalised motion."""


@dataclass(frozen=True, kw_only=True)
class AsynFusionSystem(System):
    """Two branches with the statistics of their streams; the face is theirs, too."""

    config: DualBranchConfig
    network: DualBranchNetwork
    streams: Streams

    @torch.inference_mode()
    def window(self, speech: SpeechWindow, before: Window | None, draw: Draw) -> DualWindow:
        assert before is None or isinstance(before, DualWindow)
        config, size = self.config, draw.samples
        channels = config.expression_dim, config.gesture_dim
        if before is None:
            seed = [torch.zeros(size, config.seed_frames, count) for count in channels]
        else:
            seed = [stream[:, -config.seed_frames :] for stream in (before.face, before.body)]
        around = speech.around(config.speech_context, config.window_frames)
        guide = draw.guide(self.streams[GESTURE].normaliser, "axis-angle")
        heard = self.network.hear(guide.twice(around[None]), guide.hears(1))
        found = sample(
            self.network,
            guide,
            partial(self._noise, draw),
            (max(1, round(draw.steps * FACE_SHARE[self.name])), draw.steps),
            WAYS[WAYS.index(draw.sampler)],
            seed=(seed[0], seed[1]),
            has_seed=torch.full((size,), before is not None),
            heard=heard.repeat_interleave(size, dim=0),
            speaker=torch.full((size,), draw.speaker),
        )
        units, vectors = (
            stream.normaliser.restore(x) for stream, x in zip(self.streams, found, strict=True)
        )
        units = units.clamp(0, 1)
        face, body = (
            stream.normaliser.normalise(motion)
            for stream, motion in zip(self.streams, (units, vectors), strict=True)
        )
        return DualWindow(
            rotmat=rotations(vectors, "axis-angle"),
            root=vectors[..., -ROOT_DIM:],
            expression=units,
            face=face,
            body=body,
        )

    def _noise(self, draw: Draw, which: int, step: int) -> Float[Tensor, "B T C"]:
        """The same for a branch's step whatever the number of its steps and of the other's."""
        config = self.config
        shape = config.window_frames, (config.expression_dim, config.gesture_dim)[which]
        keys = [[draw.seed, sample, draw.index, which, step] for sample in range(draw.samples)]
        return torch.stack([seeded_noise(key, shape) for key in keys])


def load(name: str, folder: Path) -> AsynFusionSystem:
    """Read a system."""
    trained = Trained.read(folder, FAMILY.weights_of(name))
    config = trained.card.config(DualBranchConfig, "network")
    streams = read_streams(trained, config.seed_frames)
    consistent = trained.card.setting("aim") == "teacher"
    fields = FAMILY.fields_of(name, trained.card)
    if not trained.card.setting("speech_dropout"):  # it has never been deaf
        fields["samplers"] = tuple(replace(one, guidance=None) for one in fields["samplers"])
    return AsynFusionSystem(
        **fields,
        sha256s={trained.name: trained.sha256},
        windowing=Windowing(config.window_frames, config.seed_frames, config.speech_context),
        frame="parent",
        root_motion="place",
        config=config,
        network=trained.as_of(DualBranchNetwork(config, streams, consistent=consistent)),
        streams=streams,
    )
