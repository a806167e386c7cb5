"""The authors' expression model: speech and speaker to FLAME's coefficients, without chance."""

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from model.systems.official.layers import Positions, SpeakerEmbedding
from model.systems.official.sizes import EXPRESSION_DIM, SPEAKER_DIM, SPEECH_DIM

WIDTH = 512
NUM_LAYERS = 4
NUM_HEADS = 4


class OfficialExpressionNetwork(nn.Module):
    """Decoder layers whose memory is what goes into the first of them."""

    def __init__(self) -> None:
        super().__init__()
        layer = nn.TransformerDecoderLayer(
            WIDTH, NUM_HEADS, 2 * WIDTH, dropout=0.1, batch_first=True, norm_first=True
        )
        self.pos_enc = Positions(WIDTH)
        self.transformer_decoder = nn.TransformerDecoder(layer, NUM_LAYERS)
        self.audio_feature_map = nn.Linear(SPEECH_DIM + SPEAKER_DIM, WIDTH)
        self.vertice_map_r = nn.Linear(WIDTH, EXPRESSION_DIM)
        self.style_embed = SpeakerEmbedding()

    def forward(
        self, speech: Float[Tensor, "B T 1024"], speaker: Int[Tensor, " B"]
    ) -> Float[Tensor, "B T 100"]:
        """Expression coefficients of each frame."""
        style = self.style_embed(speaker)[:, None].expand(-1, speech.shape[1], -1)
        tokens = self.pos_enc(self.audio_feature_map(torch.cat([speech, style], dim=-1)))
        return self.vertice_map_r(self.transformer_decoder(tokens, tokens))
