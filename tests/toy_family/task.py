"""The puppet learns with an optimizer for its body and another for its face."""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from model.data.prepared import Batch, PreparedData
from model.training.task import Workshop
from tests.toy_family import ToyConfig
from tests.toy_family.network import Puppet


class PuppetTask:
    """Two optimizers take turns: what a task is need not be one descent."""

    window_frames, context = 60, 0

    def __init__(self, config: ToyConfig) -> None:
        torch.manual_seed(config.random_seed)
        self.network = Puppet(config.width)
        parts = self.network.inner.parameters(), self.network.out.parameters()
        self.optimizers = [torch.optim.Adam(part, lr=config.learning_rate) for part in parts]

    def step(self, number: int, batch: Batch, generator: torch.Generator) -> dict[str, float]:
        losses = self.validate(batch, generator)
        self.network.zero_grad()
        losses["total"].backward()
        self.optimizers[number % 2].step()
        return {name: float(loss) for name, loss in losses.items()}

    def validate(self, batch: Batch, generator: torch.Generator) -> dict[str, Tensor]:
        pose, face = self.network(batch.speech)
        body = (pose - batch.poses).square().mean()
        mask = (face - batch.expression).square().mean()
        return {"body": body, "face": mask, "total": body + mask}

    def export(self) -> dict[str, Tensor]:
        return {f"network.{name}": tensor for name, tensor in self.network.state_dict().items()}

    def state(self) -> dict[str, Any]:
        return {
            "network": self.network.state_dict(),
            "optimizers": [optimizer.state_dict() for optimizer in self.optimizers],
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        self.network.load_state_dict(state["network"])
        for optimizer, saved in zip(self.optimizers, state["optimizers"], strict=True):
            optimizer.load_state_dict(saved)


def make_task(config: ToyConfig, data: PreparedData, workshop: Workshop) -> PuppetTask:
    return PuppetTask(config)
