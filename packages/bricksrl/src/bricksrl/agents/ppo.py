"""Proximal policy optimisation (Schulman et al., 2017) with TorchRL's loss, for many simulated
copies."""

from dataclasses import dataclass
from typing import Annotated

import torch
from tensordict import TensorDictBase
from torchrl.data import LazyTensorStorage, SamplerWithoutReplacement, TensorDictReplayBuffer
from torchrl.envs import EnvBase
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from bricksrl.agents.features.encoder import make_encoder
from bricksrl.agents.gradient_descent import GradientDescent, adam
from bricksrl.agents.networks import action_size, action_spec, gaussian_policy, make_body
from bricksrl.agents.on_policy import OnPolicyLearner
from bricksrl.agents.operators import value_operator
from bricksrl.agents.settings import (
    IMAGES,
    PAPER,
    NotNegative,
    Positive,
    Presets,
    Range,
    Settings,
    Share,
)


@dataclass(frozen=True)
class PPOSettings(Settings):
    """Settings of PPO."""

    hidden: tuple[int, ...] = (64, 64)
    batch_size: Annotated[int, Range(1)] = 4096
    gamma: Annotated[float, Share] = 0.95
    """Discount of the next step's value."""
    gae_lambda: Annotated[float, Share] = 0.95
    """Weight of longer returns in the generalised advantage estimate."""
    steps: Annotated[int, Range(1)] = 10
    """Steps of each copy between updates."""
    passes: Annotated[int, Range(1)] = 2
    """Passes over the collected steps."""
    clip_epsilon: Annotated[float, Positive] = 0.2
    """Limit of the change of an action's probability per update."""
    entropy_coeff: Annotated[float, NotNegative] = 0.001
    """Weight of the policy's entropy."""
    max_grad_norm: Annotated[float, Positive] = 0.5
    """Limit of the gradient's norm."""
    min_scale: Annotated[float, Positive] = 0.1
    """Minimum standard deviation of an action before the tanh."""


PRESETS = {
    "ppo": Presets(
        default=PPOSettings(),
        images=PPOSettings(**IMAGES, gamma=0.9),
        # Schulman et al. 2017, table of the continuous control tasks
        paper=PPOSettings(
            **{**PAPER, "hidden": (64, 64), "batch_size": 64},
            gamma=0.99,
            gae_lambda=0.95,
            steps=2048,
            passes=10,
            entropy_coeff=0.0,
        ),
    )
}


def build(
    env: EnvBase,
    settings: PPOSettings,
    device: torch.device | str = "cpu",
) -> OnPolicyLearner:
    """PPO for an environment. Initialized from torch's global generator."""
    m = action_size(env)
    copies = max(1, env.batch_size.numel())
    encoder = make_encoder(env, settings)
    body = make_body(settings, encoder.size, 2 * m)
    policy = gaussian_policy(
        encoder,
        body,
        action_spec(env),
        min_scale=settings.min_scale,
        log_prob=True,
    ).to(device)
    # on the policy's encoder, which both losses train
    value_body = make_body(settings, encoder.size, 1)
    critic = value_operator(encoder, value_body).to(device)
    loss = ClipPPOLoss(
        policy,
        critic,
        clip_epsilon=settings.clip_epsilon,
        entropy_coeff=settings.entropy_coeff,
        normalize_advantage=True,
        loss_critic_type="l2",
    ).to(device)
    advantage = GAE(
        gamma=settings.gamma,
        lmbda=settings.gae_lambda,
        value_network=critic,
        device=device,
    )

    keys = loss.tensor_keys
    used_keys = [
        *policy.in_keys,
        keys.action,
        keys.sample_log_prob,
        keys.advantage,
        keys.value_target,
    ]

    def estimate(frames: TensorDictBase) -> TensorDictBase:
        # over time, and therefore before the frames are shuffled
        with torch.no_grad():
            estimated: TensorDictBase = advantage(frames)
        # the next states have served: what the loss does not read would double the memory
        return estimated.select(*used_keys)

    frames = settings.steps * copies
    memory = TensorDictReplayBuffer(
        storage=LazyTensorStorage(frames, device=device),
        # a pass meets each frame once
        sampler=SamplerWithoutReplacement(),
        # few copies collect less than a batch
        batch_size=min(settings.batch_size, frames),
    )
    descent = GradientDescent(
        loss,
        adam(loss.parameters(), settings),
        clip_norm=settings.max_grad_norm,
    )
    return OnPolicyLearner(
        policy,
        descent,
        memory,
        prepare=estimate,
        passes=settings.passes,
        frames_per_batch=settings.steps,
    )
