"""The regression learns: an optimizer for the mean, another for the deviation from it."""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from frame_regression.config import RegressionConfig
from frame_regression.network import CONTEXT, Regression
from model.data.prepared import Batch, PreparedData
from model.training.task import TaskSetup


class RegressionTask:
    """See `model.training.task.Task`: what trains need not be one descent."""

    window_frames, context_frames = 60, CONTEXT

    def __init__(self, config: RegressionConfig, speech_dim: int) -> None:
        torch.manual_seed(config.random_seed)
        self.network = Regression(speech_dim, config.width)
        spread = [self.network.log_spread]
        mean = [each for each in self.network.parameters() if each is not spread[0]]
        self.optimizers = [torch.optim.Adam(part, config.learning_rate) for part in (mean, spread)]

    def step(self, number: int, batch: Batch, generator: torch.Generator) -> dict[str, float]:
        """Both take a step: the deviation's likelihood does not reach the mean."""
        losses = self.validate(batch, generator)
        self.network.zero_grad()
        losses["total"].backward()
        for optimizer in self.optimizers:
            optimizer.step()
        return {name: loss.item() for name, loss in losses.items()}

    def validate(self, batch: Batch, generator: torch.Generator) -> dict[str, Tensor]:
        """Mean squares of pose (rad), face and height (m), and the negative log-likelihood of the
        pose's errors under a Gaussian, up to a constant."""
        pose, face = self.network(batch.speech)
        error = pose - batch.poses
        parts = {
            "body": error.square().mean(),
            "face": (face - batch.arkit_weights).square().mean(),
            "height": (self.network.height - batch.transl[..., 1]).square().mean(),
        }
        log_spread = self.network.log_spread
        standard = error.detach().square() * (-2 * log_spread).exp()
        parts["spread"] = (log_spread + standard / 2).mean()
        return {**parts, "total": sum(parts.values(), torch.zeros(()))}

    def export(self) -> dict[str, Tensor]:
        """Tensors as `save_weights` takes them."""
        return {f"network.{name}": tensor for name, tensor in self.network.state_dict().items()}

    def state(self) -> dict[str, Any]:
        """What a run is resumed with."""
        return {
            "network": self.network.state_dict(),
            "optimizers": [optimizer.state_dict() for optimizer in self.optimizers],
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``."""
        self.network.load_state_dict(state["network"])
        for optimizer, saved in zip(self.optimizers, state["optimizers"], strict=True):
            optimizer.load_state_dict(saved)


def make_task(config: RegressionConfig, data: PreparedData, setup: TaskSetup) -> RegressionTask:
    """See `Family.make_task`."""
    return RegressionTask(config, data.speech.shape[1])
