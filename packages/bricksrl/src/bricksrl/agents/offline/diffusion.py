"""Diffusion policy (Chi et al., 2023): imitation by denoising action chunks, with TorchRL's actor
and loss."""

from collections import OrderedDict
from dataclasses import dataclass
from typing import Annotated

import torch
from tensordict import TensorDict, TensorDictBase
from torch import nn
from torchrl.envs import EnvBase
from torchrl.modules import DiffusionActor
from torchrl.objectives import DiffusionBCLoss

from bricksrl.agents.features.encoder import encode, make_encoder
from bricksrl.agents.networks import action_size, make_body
from bricksrl.agents.offline.act import ChunkPolicy, ChunkSettings, chunk_learner
from bricksrl.agents.offline.imitation import ImitationLearner
from bricksrl.agents.settings import IMAGES, PAPER, NotNegative, Presets, Range


@dataclass(frozen=True)
class DiffusionSettings(ChunkSettings):
    """Settings of the diffusion policy."""

    chunk: Annotated[int, Range(1, 1000)] = 4
    """Length of an action chunk."""
    ensemble: Annotated[float | None, NotNegative] = None
    """Extra weight of older chunks when overlapping chunks are averaged; none uses the newest
    only."""
    denoising_steps: Annotated[int, Range(1, 1000)] = 20
    """Denoising steps per chunk."""


PRESETS = {
    "diffusion": Presets(
        default=DiffusionSettings(),
        images=DiffusionSettings(**IMAGES, updates_per_step=1.0),
        paper=DiffusionSettings(**PAPER, updates_per_step=1.0),
    )
}


class EncodedChunks(DiffusionBCLoss):  # type: ignore[misc]
    """TorchRL's loss on encoded features and action chunks."""

    def __init__(
        self,
        actor: DiffusionActor,
        encoder: nn.Module,
    ) -> None:
        super().__init__(actor)
        self.encoder = encoder

    def forward(self, tensordict: TensorDictBase) -> TensorDict:
        chunk = tensordict["action"].flatten(-2)
        features = encode(self.encoder, tensordict)
        # TorchRL denoises one vector: the actions of a chunk, one after the other
        encoded = TensorDict({"observation": features, "action": chunk}, tensordict.batch_size)
        return super().forward(encoded)


def build(
    env: EnvBase,
    settings: DiffusionSettings,
    device: torch.device | str = "cpu",
) -> ImitationLearner:
    """The diffusion policy for an environment. Initialized from torch's global generator."""
    encoder = make_encoder(env, settings)
    m = action_size(env)
    size = m * settings.chunk
    # reads a noisy chunk, the features and the number of the denoising step
    score_network = make_body(settings, size + encoder.size + 1, size)
    actor = DiffusionActor(
        action_dim=size,
        score_network=score_network,
        num_steps=settings.denoising_steps,
        # at the last step nearly everything is noise, for any number of steps
        beta_end=min(0.999, 2.0 / settings.denoising_steps),
    ).to(device)
    loss = EncodedChunks(actor, encoder).to(device)
    as_chunk = nn.Unflatten(-1, (settings.chunk, m))
    denoised_chunk = nn.Sequential(OrderedDict(actor=actor, chunk=as_chunk))
    policy = ChunkPolicy(encoder, denoised_chunk, settings).to(device)
    return chunk_learner(policy, loss, settings)
