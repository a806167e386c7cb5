"""Two windows by the authors' networks, from inputs that are given."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import torch
from torch import Tensor

from model.generation.base import Draw, SpeechWindow, Windowing
from model.motion.motion import Motion
from model.storage.cards import Card
from model.systems.official.config import FAMILY, FILTERED
from model.systems.official.networks import OfficialExpressionNetwork, OfficialMotionNetwork
from model.systems.official.speech import OfficialEncoder, by_frame
from model.systems.official.system import OfficialSystem, OfficialWindow, seed_of
from tests.model.systems.official.filled import made

Networks = tuple[OfficialMotionNetwork, OfficialExpressionNetwork]


@dataclass(frozen=True)
class GivenWindows:
    """What the authors' script was given for one clip of two windows."""

    speaker: int
    start_poses: np.ndarray
    """(8, 165) local axis-angle."""
    start_trans: np.ndarray
    """(8, 3) metres."""
    features: Tensor
    """(2, 60, 1024) of speech."""
    noise: Tensor
    """(2, 60, 333)"""

    @property
    def start(self) -> Tensor:
        """The first seed."""
        return seed_of(
            Motion(
                poses=self.start_poses,
                trans=self.start_trans,
                expressions=np.zeros((8, 100), np.float32),
                expression_basis="flame100",
                betas=np.zeros(300, np.float32),
            )
        )

    def run(
        self, networks: Networks, is_filtered: bool
    ) -> tuple[list[OfficialWindow], OfficialWindow]:
        """Both windows as they were made, and joined."""
        system = _system(networks, self.start, is_filtered)
        frames = by_frame(self.features)
        draw = _GivenDraw(
            speaker=self.speaker,
            seed=0,
            samples=1,
            index=0,
            sampler="reinterpolate",
            steps=5,
            guidance=1.0,
            given=self.noise,
        )
        first = system.window(SpeechWindow(frames[:60]), None, draw)
        second = system.window(SpeechWindow(frames[52:]), first, replace(draw, index=1))
        joined = system.join(first.part(slice(52, 60)), second)
        start, rest = (window.fields_of(slice(None)) for window in (first, joined))
        fields = {name: torch.cat([start[name][:, :52], rest[name]], dim=1) for name in rest}
        return [first, second], OfficialWindow(**fields)


@dataclass(frozen=True)
class _GivenDraw(Draw):
    """Its noise is given."""

    given: Tensor = field(default_factory=lambda: torch.empty(0))

    def noise(self, shape: tuple[int, ...]) -> Tensor:
        assert shape == self.given.shape[1:]
        return self.given[self.index, None]


def _system(networks: Networks, seed: Tensor, is_filtered: bool) -> OfficialSystem:
    motion, expression = networks
    return OfficialSystem(
        name="official",
        card=Card({}, "given"),
        sha256s={},
        speakers={},
        encoder=OfficialEncoder(lambda windows: made("heard", (len(windows), 60, 1024))),
        windowing=Windowing(60, 8, 0),
        samplers=FAMILY.samplers_of(FILTERED),
        frame="world",
        root_motion="place",
        expression_basis="flame100",
        network=motion,
        expressions=expression,
        seed=seed,
        filters=is_filtered,
    )
