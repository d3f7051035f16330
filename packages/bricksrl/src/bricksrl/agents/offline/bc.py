"""Behaviour cloning with TorchRL's loss."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import torch
from tensordict import TensorDictBase, TensorDictParams
from torchrl.envs import EnvBase
from torchrl.envs.transforms import ActionChunkTransform
from torchrl.objectives import BCLoss

from bricksrl.agents.encoder import make_encoder
from bricksrl.agents.learner import Learner, adam
from bricksrl.agents.networks import action_size, action_spec, deterministic_policy, make_body
from bricksrl.agents.replay.buffer import TransitionReplayBuffer
from bricksrl.agents.settings import IMAGES, PAPER, Norm, Positive, Presets, Settings, ShareBelowOne


@dataclass(frozen=True)
class BCSettings(Settings):
    """Settings of behaviour cloning; it learns from a dataset only."""

    updates_per_step: Annotated[float, Positive] = 2.0
    """Updates for each robot step."""
    actor_norm: Norm = "layer"
    """Normalisation in the actor, before each ReLU."""
    dropout: Annotated[float, ShareBelowOne] = 0.01
    """Dropout rate in the actor during training."""


PRESETS = {
    "bc": Presets(
        default=BCSettings(),
        images=BCSettings(**IMAGES, updates_per_step=1.0),
        paper=BCSettings(**PAPER, updates_per_step=1.0),
    )
}


class ImitationLoss(BCLoss):  # type: ignore[misc]
    """TorchRL's loss with a missing annotation that it warns about."""

    target_actor_network_params: TensorDictParams


def build(
    env: EnvBase,
    settings: BCSettings,
    device: torch.device | str = "cpu",
) -> Learner:
    """Behaviour cloning for an environment. Initialized from torch's global generator."""
    encoder = make_encoder(env, settings)
    body = make_body(
        settings,
        encoder.size,
        action_size(env),
        norm=settings.actor_norm,
        dropout=settings.dropout,
    )
    actor, _ = deterministic_policy(
        encoder,
        body,
        action_spec(env),
        noise=0.0,
    )
    loss = ImitationLoss(actor.to(device), loss_function="l2").to(device)
    loss.set_keys(action="action")
    optimizer = adam(loss.parameters(), settings)
    return Learner(
        actor,
        loss,
        optimizer,
        updates_per_step=settings.updates_per_step,
        imitates=True,
    )


def recorded_memory(
    frames: TensorDictBase,
    batch_size: int,
    keys: Sequence[str],
    *,
    chunk: int = 0,
    device: torch.device | str = "cpu",
) -> TransitionReplayBuffer:
    """A buffer of recorded frames ``[time]``. With ``chunk``, actions are the next ``chunk`` ones
    ``[chunk, m]``; the last action of an episode is repeated."""
    if chunk:
        # the transform needs a batch beside time, and reads where episodes end
        whole = frames.select("action", ("next", "done"))[None]
        chunked = ActionChunkTransform(chunk, chunk_key="chunk")(whole)
        # a shallow copy: the caller's frames keep their single actions
        frames = frames.clone(recurse=False).set("action", chunked["chunk"][0])
    memory = TransitionReplayBuffer(
        max(2, len(frames)),
        batch_size,
        keys,
        device=device,
    )
    memory.extend(frames)
    return memory
