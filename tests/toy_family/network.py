"""The puppet's network."""

import torch
from torch import Tensor, nn

POSE, FACE = 165, 52


class Puppet(nn.Module):
    """Speech features of a frame to a pose (axis-angle) and a face."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.inner, self.out = nn.Linear(68, width), nn.Linear(width, POSE + FACE)

    def forward(self, speech: Tensor) -> tuple[Tensor, Tensor]:
        pose, face = self.out(torch.tanh(self.inner(speech))).split([POSE, FACE], dim=-1)
        return pose, torch.sigmoid(face)
