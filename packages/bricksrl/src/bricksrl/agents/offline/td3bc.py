"""TD3+BC (Fujimoto and Gu, 2021): TD3 with an actor close to the data, with TorchRL's loss."""

from dataclasses import dataclass
from typing import Annotated

import torch
from torchrl.envs import EnvBase
from torchrl.objectives import SoftUpdate, TD3BCLoss

from bricksrl.agents.features.encoder import make_encoder
from bricksrl.agents.networks import action_size, action_spec, deterministic_policy, make_body
from bricksrl.agents.operators import critic_operator
from bricksrl.agents.replay.replay_learner import ReplayLearner, off_policy_learner
from bricksrl.agents.settings import (
    IMAGES_TARGETS,
    PAPER_TARGETS,
    OffPolicySettings,
    Positive,
    Presets,
    Range,
    TargetSettings,
)
from bricksrl.agents.td3 import PAPER_NOISE, DeterministicSettings


@dataclass(frozen=True)
class TD3BCSettings(DeterministicSettings, TargetSettings, OffPolicySettings):
    """Settings of TD3+BC; targets move with the actor."""

    learning_rate: Annotated[float, Positive] = 5e-4
    updates_per_step: Annotated[float, Positive] = 4.0
    actor_delay: Annotated[int, Range(1)] = 2
    value_weight: Annotated[float, Positive] = 2.5
    """Weight of the value, scaled to mean magnitude 1, relative to the squared distance from the
    data's action."""


PRESETS = {
    "td3bc": Presets(
        default=TD3BCSettings(),
        images=TD3BCSettings(**IMAGES_TARGETS),
        paper=TD3BCSettings(**PAPER_TARGETS, **PAPER_NOISE),
    )
}


def build(
    env: EnvBase,
    settings: TD3BCSettings,
    device: torch.device | str = "cpu",
) -> ReplayLearner:
    """TD3+BC for an environment. Initialized from torch's global generator."""
    m = action_size(env)
    encoder = make_encoder(env, settings)
    body = make_body(
        settings,
        encoder.size,
        m,
        norm=settings.actor_norm,
    )
    actor, policy = deterministic_policy(
        encoder,
        body,
        action_spec(env),
        noise=settings.exploration_noise,
    )
    # TorchRL makes the second critic from this one, with weights of its own
    critic_body = make_body(
        settings,
        encoder.size + m,
        1,
        norm=settings.critic_norm,
    )
    critic = critic_operator(encoder, critic_body)
    loss = TD3BCLoss(
        actor.to(device),
        critic.to(device),
        action_spec=action_spec(env).to(device),
        policy_noise=settings.target_noise,
        noise_clip=settings.target_noise_clip,
        alpha=settings.value_weight,
        loss_function="l2",
        # a loop over the critics, which is faster than TorchRL's vmap for so few
        deactivate_vmap=True,
    ).to(device)
    loss.make_value_estimator(gamma=settings.gamma)
    target = SoftUpdate(loss, tau=settings.tau)
    return off_policy_learner(
        env,
        settings,
        policy.to(device),
        loss,
        target,
        target_delay=settings.actor_delay,
    )
