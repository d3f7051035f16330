"""Twin delayed deep deterministic policy gradient (Fujimoto et al., 2018)."""

import copy
from dataclasses import dataclass
from typing import Annotated, Any

import torch
from tensordict import TensorDictBase
from torch import Tensor, nn
from torchrl.envs import EnvBase

from bricksrl.agents.actor_critic import ActorCriticLoss, Batch, Critics, PolyakUpdate, on_base
from bricksrl.agents.features.encoder import make_encoder
from bricksrl.agents.networks import action_size, action_spec, deterministic_policy, make_body
from bricksrl.agents.replay.replay_learner import ReplayLearner, off_policy_learner
from bricksrl.agents.settings import (
    IMAGES_TARGETS,
    PAPER_TARGETS,
    CriticSettings,
    Norm,
    NotNegative,
    OffPolicySettings,
    Positive,
    Presets,
    Range,
    TargetSettings,
)


@dataclass(frozen=True)
class DeterministicSettings:
    """Settings of deterministic actors, of TD3 and TD3+BC, in addition to those of target
    networks."""

    actor_norm: Norm = "none"
    """Normalisation in the actor, before each ReLU."""
    exploration_noise: Annotated[float, NotNegative] = 0.3
    """Standard deviation of the noise on the actions while exploring; actions are in -1..1."""
    target_noise: Annotated[float, NotNegative] = 0.1
    """Standard deviation of the noise on the target actor's actions."""
    target_noise_clip: Annotated[float, Positive] = 0.5
    """Limit of the target noise."""


PAPER_NOISE: dict[str, Any] = {"exploration_noise": 0.1, "target_noise": 0.2}
"""Noise of TD3's authors, which the BricksRL paper takes over."""


@dataclass(frozen=True)
class TD3Settings(DeterministicSettings, CriticSettings, TargetSettings, OffPolicySettings):
    """Settings of TD3; target networks are updated whenever the actor is."""

    learning_rate: Annotated[float, Positive] = 5e-4
    updates_per_step: Annotated[float, Positive] = 4.0
    actor_delay: Annotated[int, Range(1)] = 2
    """Updates of the critics for each one of the actor and of the targets."""
    tau: Annotated[float, Range(0.0, 1.0, above=True)] = 0.01
    start_value: bool = True
    """Start the critics at the mean value of the first transitions instead of at 0."""


PRESETS = {
    "td3": Presets(
        default=TD3Settings(),
        images=TD3Settings(**IMAGES_TARGETS),
        paper=TD3Settings(
            **PAPER_TARGETS,
            **PAPER_NOISE,
            start_value=False,
        ),
    )
}

MAX_DISCOUNT = 0.999
"""Largest discount whose horizon, ``1 / (1 - discount)`` steps, an episode can cover; with a
greater one the horizon is cut to that of this one."""


class TD3Loss(ActorCriticLoss):
    """Loss of TD3. Target actions get clipped noise; the actor maximises the first critic. The
    critics' loss and the encoder are those of `ActorCriticLoss`; with a base policy the actor's
    action is added to the base's. Tests compare it with TorchRL's ``TD3Loss``. ``actor``: features
    to actions before the tanh."""

    out_keys = ["loss_qvalue", "loss_actor"]  # noqa: RUF012  as in TorchRL

    def __init__(
        self,
        encoder: nn.Module,
        actor: nn.Module,
        critics: Critics,
        settings: TD3Settings,
    ) -> None:
        super().__init__(
            encoder,
            actor,
            critics,
            settings,
        )
        self.target_actor = copy.deepcopy(actor).requires_grad_(False)
        self.target_critics = copy.deepcopy(critics).requires_grad_(False)
        self.target_noise = settings.target_noise
        self.target_noise_clip = settings.target_noise_clip

    @torch.no_grad()
    def target_qvalue(self, batch: Batch) -> Tensor:
        """Reward plus discounted minimum value of the next state with a noisy action."""
        next_action = self.target_actor(batch.next_features).tanh()
        action = on_base(next_action, batch.next_base)
        # target policy smoothing (section 5.3 of TD3's paper): similar actions get similar values,
        # so that the actor cannot settle on a narrow peak that only an error of the critics made
        noise = self.target_noise * torch.randn_like(action)
        noise.clamp_(-self.target_noise_clip, self.target_noise_clip)
        noisy_action = (action + noise).clamp_(-1.0, 1.0)
        # clipped double Q-learning (section 4.2): a maximum over noisy values is too high, and the
        # lower one of two makes up for it
        next_values = self.target_critics(batch.next_features, noisy_action)  # [k, batch]
        next_value: Tensor = next_values.amin(0)
        return batch.reward + batch.discount * next_value

    @torch.no_grad()
    def start_at_mean_value(self, transitions: TensorDictBase) -> None:
        """Set the critics' last biases to the mean value of transitions, as 0 is far from most.

        This constant satisfies their Bellman equation, ``mean(reward) / (1 - gamma * mean(not
        terminated))``: LSTD with a constant as its only feature. A discount above `MAX_DISCOUNT`
        would give a value that no data support: then the horizon is at most that of
        `MAX_DISCOUNT`, and at most the number of transitions."""
        after = transitions["next"]
        goes_on = (~after["terminated"]).float().mean()
        ending = 1.0 - self.gamma * goes_on
        if self.gamma > MAX_DISCOUNT:
            least_ending = max(1.0 - MAX_DISCOUNT, 1.0 / len(transitions))
            ending = ending.clamp_min(least_ending)
        value = after["reward"].mean() / ending
        # the targets too: from 0 they would draw the critics back
        for critic in (*self.critics, *self.target_critics):
            last_layer = last_biased_layer(critic)
            if last_layer is not None:
                last_layer.bias.fill_(value)

    def actor_loss(self, batch: Batch) -> dict[str, Tensor]:
        """The negated value of the actor's actions by the first critic."""
        learned_action = self.actor_outputs(batch.features).tanh()
        action = on_base(learned_action, batch.base)
        # detached, as only the critics' loss trains the encoder
        features = batch.features.detach()
        # the first one alone, as in algorithm 1 of TD3's paper: the minimum is for targets
        values = self.critics[0](torch.cat((features, action), -1))
        return {"loss_actor": -values.mean()}


def last_biased_layer(network: nn.Module) -> nn.Linear | None:
    """The last linear layer with a bias; ``None`` if a user's network has none."""
    last = None
    for layer in network.modules():
        if isinstance(layer, nn.Linear) and layer.bias is not None:
            last = layer
    return last


def build(
    env: EnvBase,
    settings: TD3Settings,
    device: torch.device | str = "cpu",
) -> ReplayLearner:
    """TD3 for an environment. Initialized from torch's global generator."""
    action_count = action_size(env)
    encoder = make_encoder(env, settings)
    actor = make_body(
        settings,
        encoder.size,
        action_count,
        norm=settings.actor_norm,
    )
    # two critics, which differ by their random initial weights only
    both = [
        make_body(
            settings,
            encoder.size + action_count,
            1,
            norm=settings.critic_norm,
        )
        for _ in range(2)
    ]
    critics = Critics(both)
    _, policy = deterministic_policy(
        encoder,
        actor,
        action_spec(env),
        noise=settings.exploration_noise,
    )
    loss = TD3Loss(encoder, actor, critics, settings).to(device)
    moving_critics = (loss.critics, loss.target_critics)
    moving_actor = (loss.actor, loss.target_actor)
    target = PolyakUpdate(moving_critics, moving_actor, tau=settings.tau)
    begin = loss.start_at_mean_value if settings.start_value else None
    return off_policy_learner(
        env,
        settings,
        policy.to(device),
        loss,
        target,
        # "delayed": the targets move in the updates that include the actor (algorithm 1)
        target_delay=settings.actor_delay,
        begin=begin,
    )
