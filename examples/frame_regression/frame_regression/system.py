"""The regression moves."""

from dataclasses import dataclass
from pathlib import Path

import torch
from torch.nn.functional import avg_pool1d

from frame_regression.config import DRAWN, FAMILY
from frame_regression.network import CONTEXT, POSE, Regression
from model.generation.base import SpeechWindow, System, Window, Windowing, WindowSpec
from model.motion.rotations import matrix_from_axis_angle
from model.networks.trained import TrainedWeights

SMOOTHED_OVER = 15
"""Frames."""


@dataclass(frozen=True, kw_only=True)
class RegressionSystem(System):
    """Its face is an output, the same for each sample."""

    network: Regression
    is_drawn: bool

    @torch.inference_mode()
    def window(self, speech: SpeechWindow, before: Window | None, spec: WindowSpec) -> Window:
        """See `System.window`."""
        frames = self.windowing.frames
        pose, face = self.network(speech.trim_context(CONTEXT, frames))
        poses = pose.expand(spec.num_samples, -1, -1)
        if self.is_drawn:
            noise = _smooth(spec.noise((frames, POSE)), spec.steps)
            poses = poses + self.network.log_spread.exp() * noise
        root = self.network.height * torch.tensor([0.0, 1.0, 0.0])
        return Window(
            matrix_from_axis_angle(poses.unflatten(-1, (-1, 3))),
            root.expand(spec.num_samples, frames, 3),
            face.expand(spec.num_samples, -1, -1),
        )


def _smooth(noise: torch.Tensor, passes: int) -> torch.Tensor:
    """Means over half a second, ``passes`` times over, each scaled back to deviation 1."""
    for _ in range(passes):
        means = avg_pool1d(
            noise.transpose(1, 2), SMOOTHED_OVER, 1, SMOOTHED_OVER // 2, count_include_pad=False
        ).transpose(1, 2)
        noise = means / means.std(dim=1, keepdim=True)
    return noise


def load(name: str, folder: Path) -> RegressionSystem:
    """See `Family.load`."""
    trained = TrainedWeights.read(folder, FAMILY.weights_name(name))
    fields = FAMILY.system_fields(name, trained.card)
    network = Regression(fields["encoder"].dim, trained.card.setting("width"))
    return RegressionSystem(
        **fields,
        sha256s={trained.name: trained.sha256},
        windowing=Windowing(frames=60, overlap=8, context=CONTEXT),
        rotation_frame="local",
        root_format="place",
        network=trained.load_into(network),
        is_drawn=name == DRAWN,
    )
