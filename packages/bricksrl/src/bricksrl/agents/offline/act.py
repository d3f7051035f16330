"""Action chunking with transformers (ACT, Zhao et al., 2023), with TorchRL's model and loss.

A chunk is the actions of several steps, predicted together; the diffusion policy has the same.
"""

from dataclasses import dataclass
from typing import Annotated, Any

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule, TensorDictModuleBase
from torch import Tensor, nn
from torchrl.envs import EnvBase
from torchrl.modules.models import ACTModel
from torchrl.objectives import ACTLoss, LossModule

from bricksrl.agents.features.encoder import encode, encoder_keys, make_encoder
from bricksrl.agents.gradient_descent import GradientDescent, adam
from bricksrl.agents.networks import action_size
from bricksrl.agents.offline.imitation import ImitationLearner
from bricksrl.agents.settings import (
    IMAGES,
    PAPER,
    NotNegative,
    Positive,
    Presets,
    Range,
    Settings,
    ShareBelowOne,
)
from bricksrl.errors import DescriptionError


@dataclass(frozen=True)
class ChunkSettings(Settings):
    """Settings of policies with action chunks; they learn from a dataset only."""

    updates_per_step: Annotated[float, Positive] = 2.0
    """Updates for each robot step."""
    chunk: Annotated[int, Range(1, 1000)] = 8
    """Length of an action chunk."""
    executed: Annotated[int, Range(1, 1000)] = 1
    """Steps between predictions."""
    ensemble: Annotated[float | None, NotNegative] = 0.01
    """Extra weight of older chunks when overlapping chunks are averaged; none uses the newest
    only."""
    weight_decay: Annotated[float, NotNegative] = 1e-4
    """Decoupled weight decay."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.executed > self.chunk:
            raise DescriptionError(
                f"executed is {self.executed}; a chunk has only {self.chunk} actions"
            )


class ChunkPolicy(TensorDictModuleBase):  # type: ignore[misc]
    """A policy with action chunks; needs a `reset` at the start of an episode and after an
    intervention. Overlapping chunks are averaged with weights exp(-ensemble * i), i from the oldest
    (temporal ensemble of Zhao et al., 2023). ``network``: features ``[*batch, f]`` of the
    ``encoder`` to a chunk ``[*batch, k, m]``."""

    def __init__(
        self,
        encoder: nn.Module,
        network: nn.Module,
        settings: ChunkSettings,
    ) -> None:
        super().__init__()
        self.in_keys = encoder_keys(encoder)
        self.out_keys = ["action"]
        self.encoder = encoder
        self.network = network
        self._executed = settings.executed
        self._ensemble = settings.ensemble
        self._step = 0
        self._shape: torch.Size | None = None
        self._chunks: list[tuple[int, Tensor]] = []

    def reset(self) -> None:
        """Discard predictions: the next observation does not follow from the last action."""
        self._step = 0
        self._chunks.clear()

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        shape = tensordict[self.in_keys[0]].shape
        # another batch: its observations do not follow from the last ones
        if self._chunks and shape != self._shape:
            self.reset()
        self._shape = shape
        if self._step % self._executed == 0:
            features = encode(self.encoder, tensordict)
            self._chunks.append((self._step, self.network(features)))
        if self._ensemble is None:
            del self._chunks[:-1]
        # a chunk that has ended says nothing about this step; the newest never has, as no more of
        # a chunk is executed than there is
        self._chunks = [
            (start, chunk) for start, chunk in self._chunks if start + chunk.shape[-2] > self._step
        ]
        # what each says about this step, the oldest first: [*batch, m, chunks]
        predicted = [chunk[..., self._step - start, :] for start, chunk in self._chunks]
        actions = torch.stack(predicted, -1)
        self._step += 1
        places = torch.arange(actions.shape[-1], dtype=actions.dtype, device=actions.device)
        weights = torch.softmax(-(self._ensemble or 0.0) * places, 0)
        action = (actions @ weights).clamp(-1.0, 1.0)
        return tensordict.set("action", action)


def chunk_learner(
    policy: ChunkPolicy,
    loss: LossModule,
    settings: ChunkSettings,
    minimised: tuple[str, ...] | None = None,
) -> ImitationLearner:
    """The learner of a chunk policy: imitates a dataset, acts without dropout. ``minimised``: of
    `GradientDescent`."""
    descent = GradientDescent(
        loss,
        adam(loss.parameters(), settings, settings.weight_decay),
        minimised=minimised,
    )
    return ImitationLearner(
        policy,
        descent,
        settings.batch_size,
        settings.updates_per_step,
        settings.chunk,
    )


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
        # each head attends with an equal part of a token
        if self.width % self.heads:
            raise DescriptionError(
                f"heads is {self.heads}, which does not divide the width {self.width}; "
                "choose another"
            )


PRESETS = {
    "act": Presets(
        default=ACTSettings(),
        images=ACTSettings(**IMAGES, updates_per_step=1.0),
        # Zhao et al. 2023, appendix; ensemble, latent size and weight decay from their released
        # code
        paper=ACTSettings(
            **{**PAPER, "learning_rate": 1e-5, "batch_size": 8},
            updates_per_step=1.0,
            chunk=100,
            executed=1,
            ensemble=0.01,
            width=512,
            feedforward=3200,
            heads=8,
            encoder_layers=4,
            decoder_layers=7,
            dropout=0.1,
            latent=32,
            kl_weight=10.0,
            weight_decay=1e-4,
        ),
    )
}


class EncodedACTLoss(ACTLoss):  # type: ignore[misc]
    """TorchRL's loss on encoded features."""

    def __init__(
        self,
        actor: TensorDictModule,
        encoder: nn.Module,
        **kwargs: Any,
    ) -> None:
        super().__init__(actor, **kwargs)
        self.encoder = encoder
        self.set_keys(action_chunk="action")

    def forward(self, tensordict: TensorDictBase) -> TensorDict:
        # TorchRL's model reads one vector of this name, whatever the environment observes
        encoded = tensordict.select("action")
        encoded.set("observation", encode(self.encoder, tensordict))
        return super().forward(encoded)


class PredictedChunk(nn.Module):
    """The chunk predicted by TorchRL's ACT model at the latent's mean."""

    def __init__(self, model: ACTModel) -> None:
        super().__init__()
        self.model = model

    def forward(self, features: Tensor) -> Any:
        # without actions to encode the model takes the latent to be 0, its mean beforehand
        chunk, *_ = self.model(features)
        return chunk


def build(
    env: EnvBase,
    settings: ACTSettings,
    device: torch.device | str = "cpu",
) -> ImitationLearner:
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
    actor = TensorDictModule(
        model, in_keys=["observation", "action_chunk"], out_keys=["action_pred", "mu", "log_var"]
    ).to(device)
    loss = EncodedACTLoss(actor, encoder, kl_weight=settings.kl_weight).to(device)
    policy = ChunkPolicy(encoder, PredictedChunk(model), settings).to(device)
    # the sum: TorchRL reports its two parts under names that begin with "loss" too
    return chunk_learner(
        policy,
        loss,
        settings,
        minimised=("loss_act",),
    )
