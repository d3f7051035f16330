"""Transformers that predict chunks: as many actions at once as the next steps need (Zhao et al. 2023, ACT)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from bricksrl.agents.presets import ACTSettings

_SPREAD = 0.02
"""Standard deviation of learned tokens and places at the start."""


class ChunkActor(nn.Module):
    """Features ``[batch, f]``, and a latent ``[batch, z]`` where there is one, to actions ``[batch, k, m]``.

    An encoder looks at the features and the latent, a token each; a decoder asks it for each step of the chunk.
    """

    def __init__(self, feature_size: int, action_size: int, settings: ACTSettings) -> None:
        super().__init__()
        width = settings.width
        self.see = nn.Linear(feature_size, width)
        self.intend = nn.Linear(settings.latent, width) if settings.latent else None
        self.places = _learned(1 + (settings.latent > 0), width)
        self.encoder = _encoder(settings)
        self.queries = _learned(settings.chunk, width)
        layer = nn.TransformerDecoderLayer(
            width, settings.heads, settings.feedforward, settings.dropout, batch_first=True, norm_first=True
        )
        self.decoder = nn.TransformerDecoder(layer, settings.decoder_layers, norm=nn.LayerNorm(width))
        self.head = nn.Linear(width, action_size)
        self._latent = settings.latent

    def forward(self, features: Tensor, latent: Tensor | None = None) -> Tensor:
        """Without a ``latent`` its mean, zero, is taken."""
        tokens = [self.see(features)]
        if self.intend is not None:
            tokens.append(self.intend(features.new_zeros(len(features), self._latent) if latent is None else latent))
        seen = self.encoder(torch.stack(tokens, 1) + self.places)
        out: Tensor = self.head(self.decoder(self.queries.expand(len(features), -1, -1), seen))
        return out


class ChunkReader(nn.Module):
    """Of what was done, what the features do not tell: mean and logarithm of the variance ``[batch, z]`` of a latent.

    It serves learning only: whoever shows something can mean this or that, and a mean of both is neither.
    """

    def __init__(self, feature_size: int, action_size: int, settings: ACTSettings) -> None:
        super().__init__()
        width = settings.width
        self.summary = _learned(1, width)
        self.see = nn.Linear(feature_size, width)
        self.read = nn.Linear(action_size, width)
        self.places = _learned(settings.chunk + 2, width)
        self.encoder = _encoder(settings)
        self.head = nn.Linear(width, 2 * settings.latent)

    def forward(self, features: Tensor, action: Tensor, known: Tensor) -> tuple[Tensor, Tensor]:
        """``action`` ``[batch, k, m]`` counts where ``known`` ``[batch, k]``, bool."""
        first = self.summary.expand(len(features), -1, -1)
        tokens = torch.cat((first, self.see(features)[:, None], self.read(action)), 1) + self.places
        unknown = torch.cat((known.new_zeros(len(features), 2), ~known), 1)
        mean, log_variance = self.head(self.encoder(tokens, src_key_padding_mask=unknown)[:, 0]).chunk(2, -1)
        return mean, log_variance


def _learned(count: int, width: int) -> nn.Parameter:
    return nn.Parameter(_SPREAD * torch.randn(count, width))


def _encoder(settings: ACTSettings) -> nn.TransformerEncoder:
    layer = nn.TransformerEncoderLayer(
        settings.width, settings.heads, settings.feedforward, settings.dropout, batch_first=True, norm_first=True
    )
    norm = nn.LayerNorm(settings.width)
    return nn.TransformerEncoder(layer, settings.encoder_layers, norm=norm, enable_nested_tensor=False)
