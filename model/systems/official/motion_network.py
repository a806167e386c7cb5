"""The authors' motion network: two branches (hands, body) from noisy motion to clean motion.

Written anew from a description of the architecture; attributes are named as in the files that the
authors' training script saves.
"""

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from model.systems.official.layers import Positions, SpeakerEmbedding
from model.systems.official.sizes import (
    BODY_CHANNELS,
    EXPRESSION_DIM,
    HAND_CHANNELS,
    MOTION_DIM,
    SEED_FRAMES,
    SPEAKER_DIM,
    SPEECH_DIM,
)

WIDTH = 384
NUM_BLOCKS = 6
NUM_HEADS = 8


class SeedBlock(nn.Module):
    """Attention and a feed-forward net, both modulated by time and speaker; the first frames look
    at the seed pose first. Norms stand behind the additions and learn nothing."""

    def __init__(self) -> None:
        super().__init__()
        self.mlp = nn.Sequential(nn.SiLU(), nn.Linear(WIDTH, 9 * WIDTH))
        self.attn = nn.MultiheadAttention(WIDTH, NUM_HEADS, batch_first=True)
        self.ff = nn.Sequential(nn.Linear(WIDTH, 2 * WIDTH), nn.GELU(), nn.Linear(2 * WIDTH, WIDTH))
        self.ff_seed_poses = nn.Sequential(
            nn.Linear(WIDTH, WIDTH), nn.GELU(), nn.Linear(WIDTH, WIDTH)
        )
        self.cross_attn = nn.MultiheadAttention(WIDTH, NUM_HEADS, batch_first=True)

    def forward(
        self,
        tokens: Float[Tensor, "B T width"],
        seed: Float[Tensor, "B S width"],
        condition: Float[Tensor, "B width"],
    ) -> Float[Tensor, "B T width"]:
        """The tokens after this block; every block is given the same seed tokens."""
        by_part = self.mlp(condition)[:, None].unflatten(-1, (3, 3, WIDTH)).unbind(2)
        around, through, of_seed = (part.unbind(2) for part in by_part)
        gate, scale, shift = of_seed
        known = seed + gate * self.ff_seed_poses(_level(seed) * (1 + scale) + shift)
        first = tokens[:, :SEED_FRAMES]
        first = first + self.cross_attn(first, known, known, need_weights=False)[0]
        tokens = torch.cat([first, tokens[:, SEED_FRAMES:]], dim=1)

        gate, scale, shift = around
        heard = tokens * (1 + scale) + shift
        tokens = _level(tokens + gate * self.attn(heard, heard, heard, need_weights=False)[0])
        gate, scale, shift = through
        return _level(tokens + gate * self.ff(tokens * (1 + scale) + shift))


def _level(tokens: Float[Tensor, "B T width"]) -> Float[Tensor, "B T width"]:
    return torch.nn.functional.layer_norm(tokens, tokens.shape[-1:])


class OfficialMotionNetwork(nn.Module):
    """Predicts clean motion from noisy motion, time, speech, expressions, seed and speaker."""

    def __init__(self) -> None:
        super().__init__()
        hand, body = len(HAND_CHANNELS), len(BODY_CHANNELS)
        self.pos_enc = Positions(WIDTH)
        self.in_hand = nn.Linear(hand, WIDTH)
        self.in_body = nn.Linear(body, WIDTH)
        self.in_x_hand = nn.Linear(MOTION_DIM + EXPRESSION_DIM, WIDTH)
        self.in_x_body = nn.Linear(MOTION_DIM + EXPRESSION_DIM, WIDTH)
        self.hand_fuse = nn.Linear(3 * WIDTH, WIDTH)
        self.body_fuse = nn.Linear(3 * WIDTH, WIDTH)
        self.transformer_hand = nn.ModuleList(SeedBlock() for _ in range(NUM_BLOCKS))
        self.transformer_body = nn.ModuleList(SeedBlock() for _ in range(NUM_BLOCKS))
        self.hand = nn.Linear(WIDTH, hand)
        self.body = nn.Linear(WIDTH, body)
        time_dim = WIDTH - SPEAKER_DIM
        self.time_embed = nn.Sequential(nn.Linear(1, WIDTH), nn.SiLU(), nn.Linear(WIDTH, time_dim))
        self.style_embed = SpeakerEmbedding()
        self.seed_prj_hand = nn.Linear(hand, WIDTH)
        self.seed_prj_body = nn.Linear(body, WIDTH)
        self.hubert_prj = nn.Sequential(
            nn.Linear(SPEECH_DIM, WIDTH), nn.SiLU(), nn.Linear(WIDTH, WIDTH)
        )

    def forward(
        self,
        x_t: Float[Tensor, "B T 333"],
        t: Float[Tensor, " B"],
        *,
        speech: Float[Tensor, "B T 1024"],
        expression: Float[Tensor, "B T 100"],
        seed: Float[Tensor, "B 8 333"],
        speaker: Int[Tensor, " B"],
    ) -> Float[Tensor, "B T 333"]:
        """Clean motion.

        Args:
            t: 0 is noise, 1 is data.
            seed: the first frames, clean.
        """
        condition = torch.cat([self.time_embed(t[:, None]), self.style_embed(speaker)], dim=-1)
        heard = self.hubert_prj(speech)
        whole = torch.cat([x_t, expression], dim=-1)
        branches = (
            (HAND_CHANNELS, self.in_hand, self.in_x_hand, self.hand_fuse, self.seed_prj_hand,
             self.transformer_hand, self.hand),
            (BODY_CHANNELS, self.in_body, self.in_x_body, self.body_fuse, self.seed_prj_body,
             self.transformer_body, self.body),
        )  # fmt: skip
        x_1 = torch.empty_like(x_t)
        for channels, part, all_of_it, fuse, known, blocks, out in branches:
            own = list(channels)
            fused = fuse(torch.cat([part(x_t[..., own]), all_of_it(whole), heard], dim=-1))
            tokens = self.pos_enc(fused)
            seed_tokens = self.pos_enc(known(seed[..., own]))
            for block in blocks:
                tokens = block(tokens, seed_tokens, condition)
            x_1[..., own] = out(tokens)
        return x_1
