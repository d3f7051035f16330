"""Action chunking with transformers (ACT, Zhao et al., 2023), with TorchRL's model and loss."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.envs import EnvBase
from torchrl.modules.models import ACTModel
from torchrl.objectives import ACTLoss

from bricksrl.agents.chunks import ChunkPolicy, ChunkSettings, chunk_learner
from bricksrl.agents.encoder import encode, make_encoder
from bricksrl.agents.learner import Learner
from bricksrl.agents.networks import action_size
from bricksrl.agents.settings import NotNegative, Positive, Range, ShareBelowOne
from bricksrl.errors import DescriptionError


@dataclass(frozen=True)
class ACTSettings(ChunkSettings):
    """Settings of ACT."""

    learning_rate: Annotated[float, Positive] = 5e-4
    batch_size: Annotated[int, Range(1)] = 32
    width: Annotated[int, Range(1, 4096)] = 64
    """Size of a token."""
    feedforward: Annotated[int, Range(1, 16384)] = 128
    """Units of the feedforward layers."""
    heads: Annotated[int, Range(1, 64)] = 4
    """Attention heads; the width must be a multiple."""
    encoder_layers: Annotated[int, Range(1, 32)] = 1
    """Layers of the latent's encoder."""
    decoder_layers: Annotated[int, Range(1, 32)] = 1
    """Layers that predict the chunk."""
    dropout: Annotated[float, ShareBelowOne] = 0.1
    """Dropout rate in the transformers during training."""
    latent: Annotated[int, Range(1, 1024)] = 8
    """Size of the latent, which distinguishes different actions in equal situations."""
    kl_weight: Annotated[float, NotNegative] = 10.0
    """Weight of the latent's KL divergence from a normal."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.width % self.heads:
            raise DescriptionError(f"heads is {self.heads}, which does not divide the width {self.width}; choose another")


class EncodedACTLoss(ACTLoss):  # type: ignore[misc]
    """TorchRL's loss on encoded features."""

    def __init__(self, actor: TensorDictModule, encoder: nn.Module, **kwargs: Any) -> None:
        super().__init__(actor, **kwargs)
        self.encoder = encoder
        self.set_keys(action_chunk="action")

    def forward(self, tensordict: TensorDictBase) -> TensorDict:
        return super().forward(tensordict.select("action").set("observation", encode(self.encoder, tensordict)))


class PredictedChunk(nn.Module):
    """The chunk predicted by TorchRL's ACT model at the latent's mean."""

    def __init__(self, model: ACTModel) -> None:
        super().__init__()
        self.model = model

    def forward(self, features: Tensor) -> Tensor:
        chunk: Tensor = self.model(features)[0]
        return chunk


def build(env: EnvBase, settings: ACTSettings, device: torch.device | str = "cpu") -> Learner:
    """ACT for an environment. Initialized from torch's global generator."""
    encoder = make_encoder(env, settings)
    model = ACTModel(
        obs_dim=encoder.size,
        action_dim=action_size(env),
        chunk_size=settings.chunk,
        hidden_dim=settings.width,
        nheads=settings.heads,
        num_encoder_layers=settings.encoder_layers,
        num_decoder_layers=settings.decoder_layers,
        latent_dim=settings.latent,
        dropout=settings.dropout,
        dim_feedforward=settings.feedforward,
    )
    actor = TensorDictModule(model, in_keys=["observation", "action_chunk"], out_keys=["action_pred", "mu", "log_var"]).to(device)
    loss = EncodedACTLoss(actor, encoder, kl_weight=settings.kl_weight).to(device)
    return chunk_learner(ChunkPolicy(encoder, PredictedChunk(model), settings).to(device), loss, settings, descend=("loss_act",))
