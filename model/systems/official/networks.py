"""The authors' networks, reimplemented from a description of the architecture.

They are read from the files of their training script: attributes have the same names.
"""

from collections.abc import Iterator
from pathlib import Path

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from model.generation.family import FileCheck
from model.storage.checkpoint import check_tensors, read_torch_checkpoint
from model.systems.official.checkpoints import (
    BODY_CHANNELS,
    EXPRESSION_DIM,
    HAND_CHANNELS,
    MOTION_DIM,
    NUM_SPEAKERS,
    OFFICIAL_NETWORKS,
    SEED_FRAMES,
    SPEAKER_DIM,
    SPEECH_DIM,
    OfficialNetwork,
    official_file,
)
from model.systems.official.speech import official_encoder


class _Frequencies(nn.Module):
    """Buffer of a positional encoding in the file."""

    inv_freq: Tensor

    def __init__(self, width: int) -> None:
        super().__init__()
        powers = torch.arange(0, width, 2).float() / width
        self.register_buffer("inv_freq", 1.0 / 10000.0**powers)


class PositionalEncoding(nn.Module):
    """Positional encoding of the frame's number: sine in even channels, cosine in odd ones."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.penc = _Frequencies(width)

    def forward(self, tokens: Float[Tensor, "B T width"]) -> Float[Tensor, "B T width"]:
        """Add the positions, from 0, to the tokens."""
        inv_freq = self.penc.inv_freq
        number = torch.arange(tokens.shape[1], device=tokens.device, dtype=inv_freq.dtype)
        angle = number[:, None] * inv_freq
        return tokens + torch.stack([angle.sin(), angle.cos()], dim=-1).flatten(-2)


class SpeakerEmbedding(nn.Module):
    """Embedding of a speaker's number; 0 means no speaker."""

    def __init__(self) -> None:
        super().__init__()
        self.mlp = nn.Sequential(
            nn.Linear(NUM_SPEAKERS, 2 * SPEAKER_DIM),
            nn.SiLU(),
            nn.Linear(2 * SPEAKER_DIM, SPEAKER_DIM),
        )

    def forward(self, speaker: Int[Tensor, " B"]) -> Float[Tensor, "B 64"]:
        """Return one vector for each speaker."""
        one_hot = torch.nn.functional.one_hot(speaker, NUM_SPEAKERS)
        return self.mlp(one_hot.to(self.mlp.get_parameter("0.weight")))


EXPRESSION_WIDTH = 512
EXPRESSION_NUM_LAYERS = 4
EXPRESSION_NUM_HEADS = 4


class OfficialExpressionNetwork(nn.Module):
    """Expression network of VAEDecoder layers that all attend to the input of the first."""

    def __init__(self) -> None:
        super().__init__()
        layer = nn.TransformerDecoderLayer(
            EXPRESSION_WIDTH,
            EXPRESSION_NUM_HEADS,
            2 * EXPRESSION_WIDTH,
            dropout=0.1,
            batch_first=True,
            norm_first=True,
        )
        self.pos_enc = PositionalEncoding(EXPRESSION_WIDTH)
        self.transformer_decoder = nn.TransformerDecoder(layer, EXPRESSION_NUM_LAYERS)
        self.audio_feature_map = nn.Linear(SPEECH_DIM + SPEAKER_DIM, EXPRESSION_WIDTH)
        self.vertice_map_r = nn.Linear(EXPRESSION_WIDTH, EXPRESSION_DIM)
        self.style_embed = SpeakerEmbedding()

    def forward(
        self, speech: Float[Tensor, "B T 1024"], speaker: Int[Tensor, " B"]
    ) -> Float[Tensor, "B T 100"]:
        """Predict the expression coefficients of each frame."""
        style = self.style_embed(speaker)[:, None].expand(-1, speech.shape[1], -1)
        tokens = self.pos_enc(self.audio_feature_map(torch.cat([speech, style], dim=-1)))
        return self.vertice_map_r(self.transformer_decoder(tokens, tokens))


MOTION_WIDTH = 384
NUM_BLOCKS = 6
MOTION_NUM_HEADS = 8


class SeedBlock(nn.Module):
    """Attention and a feed-forward network, both modulated by time and speaker.

    The first frames attend to the seed pose first. Norms follow additions and have no parameters.
    """

    def __init__(self) -> None:
        super().__init__()
        self.mlp = nn.Sequential(nn.SiLU(), nn.Linear(MOTION_WIDTH, 9 * MOTION_WIDTH))
        self.attn = nn.MultiheadAttention(MOTION_WIDTH, MOTION_NUM_HEADS, batch_first=True)
        self.ff = nn.Sequential(
            nn.Linear(MOTION_WIDTH, 2 * MOTION_WIDTH),
            nn.GELU(),
            nn.Linear(2 * MOTION_WIDTH, MOTION_WIDTH),
        )
        self.ff_seed_poses = nn.Sequential(
            nn.Linear(MOTION_WIDTH, MOTION_WIDTH), nn.GELU(), nn.Linear(MOTION_WIDTH, MOTION_WIDTH)
        )
        self.cross_attn = nn.MultiheadAttention(MOTION_WIDTH, MOTION_NUM_HEADS, batch_first=True)

    def forward(
        self,
        tokens: Float[Tensor, "B T width"],
        seed: Float[Tensor, "B S width"],
        condition: Float[Tensor, "B width"],
    ) -> Float[Tensor, "B T width"]:
        """Apply the block to the tokens; every block gets the same seed tokens."""
        by_part = self.mlp(condition)[:, None].unflatten(-1, (3, 3, MOTION_WIDTH)).unbind(2)
        around, through, of_seed = (part.unbind(2) for part in by_part)
        gate, scale, shift = of_seed
        seed_out = seed + gate * self.ff_seed_poses(_layer_norm(seed) * (1 + scale) + shift)
        first = tokens[:, :SEED_FRAMES]
        first = first + self.cross_attn(first, seed_out, seed_out, need_weights=False)[0]
        tokens = torch.cat([first, tokens[:, SEED_FRAMES:]], dim=1)

        gate, scale, shift = around
        speech_tokens = tokens * (1 + scale) + shift
        tokens = _layer_norm(
            tokens
            + gate * self.attn(speech_tokens, speech_tokens, speech_tokens, need_weights=False)[0]
        )
        gate, scale, shift = through
        return _layer_norm(tokens + gate * self.ff(tokens * (1 + scale) + shift))


def _layer_norm(tokens: Float[Tensor, "B T width"]) -> Float[Tensor, "B T width"]:
    return torch.nn.functional.layer_norm(tokens, tokens.shape[-1:])


class OfficialMotionNetwork(nn.Module):
    """Network that predicts clean motion from x_t, time, speech, expressions, seed and speaker."""

    def __init__(self) -> None:
        super().__init__()
        hand, body = len(HAND_CHANNELS), len(BODY_CHANNELS)
        self.pos_enc = PositionalEncoding(MOTION_WIDTH)
        self.in_hand = nn.Linear(hand, MOTION_WIDTH)
        self.in_body = nn.Linear(body, MOTION_WIDTH)
        self.in_x_hand = nn.Linear(MOTION_DIM + EXPRESSION_DIM, MOTION_WIDTH)
        self.in_x_body = nn.Linear(MOTION_DIM + EXPRESSION_DIM, MOTION_WIDTH)
        self.hand_fuse = nn.Linear(3 * MOTION_WIDTH, MOTION_WIDTH)
        self.body_fuse = nn.Linear(3 * MOTION_WIDTH, MOTION_WIDTH)
        self.transformer_hand = nn.ModuleList(SeedBlock() for _ in range(NUM_BLOCKS))
        self.transformer_body = nn.ModuleList(SeedBlock() for _ in range(NUM_BLOCKS))
        self.hand = nn.Linear(MOTION_WIDTH, hand)
        self.body = nn.Linear(MOTION_WIDTH, body)
        time_dim = MOTION_WIDTH - SPEAKER_DIM
        self.time_embed = nn.Sequential(
            nn.Linear(1, MOTION_WIDTH), nn.SiLU(), nn.Linear(MOTION_WIDTH, time_dim)
        )
        self.style_embed = SpeakerEmbedding()
        self.seed_prj_hand = nn.Linear(hand, MOTION_WIDTH)
        self.seed_prj_body = nn.Linear(body, MOTION_WIDTH)
        self.hubert_prj = nn.Sequential(
            nn.Linear(SPEECH_DIM, MOTION_WIDTH), nn.SiLU(), nn.Linear(MOTION_WIDTH, MOTION_WIDTH)
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
        """Predict clean motion from x_t, noise at t = 0 and data at 1."""
        condition = torch.cat([self.time_embed(t[:, None]), self.style_embed(speaker)], dim=-1)
        speech_tokens = self.hubert_prj(speech)
        whole = torch.cat([x_t, expression], dim=-1)
        branches = (
            (HAND_CHANNELS, self.in_hand, self.in_x_hand, self.hand_fuse, self.seed_prj_hand,
             self.transformer_hand, self.hand),
            (BODY_CHANNELS, self.in_body, self.in_x_body, self.body_fuse, self.seed_prj_body,
             self.transformer_body, self.body),
        )  # fmt: skip
        x_1 = torch.empty_like(x_t)
        for channels, part, all_of_it, fuse, region_seed, blocks, out in branches:
            own = list(channels)
            fused = fuse(torch.cat([part(x_t[..., own]), all_of_it(whole), speech_tokens], dim=-1))
            tokens = self.pos_enc(fused)
            seed_tokens = self.pos_enc(region_seed(seed[..., own]))
            for block in blocks:
                tokens = block(tokens, seed_tokens, condition)
            x_1[..., own] = out(tokens)
        return x_1


_NETWORKS = {"motion": OfficialMotionNetwork, "expression": OfficialExpressionNetwork}


def make_network(part: OfficialNetwork) -> nn.Module:
    """Make an untrained network."""
    return _NETWORKS[part]()


def load_network(part: OfficialNetwork, path: Path) -> nn.Module:
    """Load a network from a file that has exactly its weights."""
    tensors = read_torch_checkpoint(path)
    with torch.device("meta"):
        wanted = make_network(part).state_dict()
    check_tensors(
        wanted,
        tensors,
        path.name,
        f"the authors' {part} network",
        "a file that their training script saved",
    )
    network = make_network(part)
    network.load_state_dict(tensors)
    return network.eval().requires_grad_(False)


_ADVICE = "see docs/official.md"


def check_official_files(base_folder: Path) -> Iterator[FileCheck]:
    """Yield a report on each network and the speech model, with paths relative to a folder."""
    for part in OFFICIAL_NETWORKS:
        name = f"official {part}"
        try:
            path = official_file(part)
            count = sum(each.numel() for each in load_network(part, path).parameters())
        except Exception as error:  # any fault of a file is reported
            yield FileCheck(name, error=error, advice=_ADVICE)
        else:
            detail = f"{path.relative_to(base_folder)}, {count / 1e6:.1f} M parameters"
            yield FileCheck(name, detail)
    try:
        official_encoder()
    except Exception as error:  # as above, for transformers
        yield FileCheck("official speech", error=error, advice=_ADVICE)
    else:
        yield FileCheck("official speech", "WavLM, HuBERT or prepared features were found")
