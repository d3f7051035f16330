"""Behaviour cloning with TorchRL's loss."""

from dataclasses import dataclass
from typing import Annotated

import torch
from tensordict import TensorDictParams
from torchrl.envs import EnvBase
from torchrl.objectives import BCLoss

from bricksrl.agents.features.encoder import make_encoder
from bricksrl.agents.gradient_descent import GradientDescent, adam
from bricksrl.agents.networks import action_size, action_spec, deterministic_policy, make_body
from bricksrl.agents.offline.imitation import ImitationLearner
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
) -> ImitationLearner:
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
    descent = GradientDescent(loss, adam(loss.parameters(), settings))
    return ImitationLearner(
        actor,
        descent,
        settings.batch_size,
        settings.updates_per_step,
    )
