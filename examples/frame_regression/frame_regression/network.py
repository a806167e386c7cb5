"""The regression's network."""

from torch import Tensor, nn, tanh, zeros

POSE, FACE = 165, 52
CONTEXT = 15
"""Frames of speech that are heard before and after each."""


class Regression(nn.Module):
    """Speech features to the mean pose (axis-angle) and face of each frame, the deviation of the
    pose from it, and the height of the pelvis in metres."""

    def __init__(self, speech_dim: int, width: int) -> None:
        super().__init__()
        self.heard = nn.Conv1d(speech_dim, width, 2 * CONTEXT + 1)
        self.told = nn.Linear(width, POSE + FACE)
        self.height = nn.Parameter(zeros(1))
        self.log_spread = nn.Parameter(zeros(POSE))

    def forward(self, speech: Tensor) -> tuple[Tensor, Tensor]:
        """Features ``(..., heard, dim)`` to poses ``(..., T, 165)`` and faces ``(..., T, 52)``."""
        hidden = tanh(self.heard(speech.transpose(-1, -2))).transpose(-1, -2)
        pose, face = self.told(hidden).split([POSE, FACE], dim=-1)
        return pose, face.sigmoid()
