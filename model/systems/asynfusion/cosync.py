"""What one branch hears of the other after a block: CoSync and the variants it is compared with."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from model.networks.layers import Attention
from model.systems.asynfusion.config import Interaction


class CoSync(nn.Module):
    """``MLP(LN(softmax(Q K^T / sqrt(d)) V)) + F`` (eqs. 9 and 10): queries from a branch's own
    frames, keys and values from the other's. Begins as no exchange at all."""

    def __init__(self, width: int, num_heads: int) -> None:
        super().__init__()
        self.attention = Attention(width, num_heads)
        self.norm = nn.LayerNorm(width)
        last = nn.Linear(width, width)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.mlp = nn.Sequential(nn.Linear(width, width), nn.GELU(), last)

    def forward(
        self, own: Float[Tensor, "B T width"], other: Float[Tensor, "B T width"]
    ) -> Float[Tensor, "B T width"]:
        return self.mlp(self.norm(self.attention(own, other))) + own


class Concatenation(nn.Module):
    """A linear map of both, frame by frame; begins with a branch's own."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.mix = nn.Linear(2 * width, width)
        with torch.no_grad():
            self.mix.weight.copy_(torch.cat([torch.eye(width), torch.zeros(width, width)], dim=1))
            self.mix.bias.zero_()

    def forward(
        self, own: Float[Tensor, "B T width"], other: Float[Tensor, "B T width"]
    ) -> Float[Tensor, "B T width"]:
        return self.mix(torch.cat([own, other], dim=-1))


class Gate(nn.Module):
    """``g F_own + (1 - g) F_other`` with ``g = sigmoid(W [F_own; F_other])`` (eq. 19)."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.gate = nn.Linear(2 * width, width)

    def forward(
        self, own: Float[Tensor, "B T width"], other: Float[Tensor, "B T width"]
    ) -> Float[Tensor, "B T width"]:
        share = self.gate(torch.cat([own, other], dim=-1)).sigmoid()
        return share * own + (1 - share) * other


class Deaf(nn.Module):
    """Hears nothing of the other branch."""

    def forward(
        self, own: Float[Tensor, "B T width"], other: Float[Tensor, "B T width"]
    ) -> Float[Tensor, "B T width"]:
        return own


def make_exchange(interaction: Interaction, which: int, width: int, num_heads: int) -> nn.Module:
    """What the expression branch (``which`` 0) or the gesture branch (1) hears after one block."""
    match interaction:
        case "concatenation":
            return Concatenation(width)
        case "gated":
            return Gate(width)
        case "cross-attention":
            return CoSync(width, num_heads)
        case "expression-to-gesture" if which == 1:
            return CoSync(width, num_heads)
        case "gesture-to-expression" if which == 0:
            return CoSync(width, num_heads)
    return Deaf()
