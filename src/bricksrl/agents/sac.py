"""Soft actor-critic with a learned temperature, written out.

TorchRL's ``SACLoss`` computes the same losses (the tests hold the two together) in twice the time for networks of this size. The
robot waits for its agent to learn, so this one is lean: critics side by side, three gradients, one fused Adam.
"""

from __future__ import annotations

import math
from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor
from torch.nn import functional
from torchrl.data import LazyTensorStorage, ReplayBuffer

from bricksrl.agents.agent import Transition
from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.networks import ObservationEncoder, StackedCritics, make_actor
from bricksrl.agents.presets import SACSettings
from bricksrl.errors import CheckpointError


def sample_action(loc: Tensor, scale: Tensor) -> tuple[Tensor, Tensor]:
    """A reparametrised draw ``[*batch, m]`` from a tanh-squashed normal, and its log-probability ``[*batch]``."""
    noise = torch.randn_like(loc)
    x = torch.addcmul(loc, scale, noise)
    log_normal = -0.5 * noise.square() - scale.log() - 0.5 * math.log(2 * math.pi)
    # log(1 - tanh(x)^2), written so that it stays finite where tanh saturates
    log_slope = 2.0 * (math.log(2.0) - x - functional.softplus(-2.0 * x))
    return x.tanh(), (log_normal - log_slope).sum(-1)


class SACAgent:
    """SAC for one robot; see `SACSettings`. Networks are made from torch's global generator."""

    def __init__(self, layout: ObservationLayout, action_size: int, settings: SACSettings) -> None:
        self.settings = settings
        self.prefill_episodes = settings.prefill_episodes
        self.encoder = ObservationEncoder(layout, settings.angles)
        self.actor = make_actor(self.encoder.size, action_size, settings.hidden, settings.min_scale)
        self.critics, self.target_critics = (
            StackedCritics(
                self.encoder.size, action_size, settings.hidden, layer_norm=settings.layer_norm, dropout=settings.dropout
            )
            for _ in range(2)
        )
        self.target_critics.load_state_dict(self.critics.state_dict())
        self.target_critics.requires_grad_(False)
        self.log_alpha = torch.tensor(math.log(settings.initial_alpha), requires_grad=True)
        self.target_entropy = -float(action_size)
        self._critic_parameters: list[Tensor] = list(self.critics.parameters())
        self._target_parameters: list[Tensor] = list(self.target_critics.parameters())
        self._actor_parameters: list[Tensor] = list(self.actor.parameters())
        parameters = [*self._critic_parameters, *self._actor_parameters, self.log_alpha]
        self._optimiser = torch.optim.Adam(parameters, lr=settings.learning_rate, fused=True)
        self._replay = ReplayBuffer(storage=LazyTensorStorage(settings.replay_size))

    def act(self, observation: Tensor, *, explore: bool) -> Tensor:
        """A drawn action ``[m]`` with ``explore``, else the mode of the policy."""
        with torch.no_grad():
            loc, scale = self.actor(self.encoder(observation))
            x = torch.addcmul(loc, scale, torch.randn_like(loc)) if explore else loc
            return x.tanh()

    def remember(self, transition: Transition) -> None:
        """Keep a transition, already encoded: each is encoded once and sampled many times."""
        self._replay.add(
            TensorDict(
                {
                    "features": self.encoder(transition.observation),
                    "action": transition.action,
                    "reward": torch.tensor(transition.reward),
                    "next_features": self.encoder(transition.next_observation),
                    "terminated": torch.tensor(transition.terminated),
                }
            )
        )

    def update(self) -> dict[str, float]:
        """``updates_per_step`` updates; returns the mean of each loss, the temperature and the entropy."""
        count = self.settings.updates_per_step
        if len(self._replay) == 0:
            return {}
        batches = self._replay.sample(count * self.settings.batch_size).split(self.settings.batch_size)
        sums = [self._update_once(batch) for batch in batches]
        means = torch.stack([torch.stack(one) for one in sums]).mean(0).tolist()
        return dict(zip(("critic_loss", "actor_loss", "entropy", "alpha"), means, strict=True))

    def losses(self, batch: TensorDict) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Losses of critics, actor and temperature on a batch, and the policy's entropy there (all without shape).

        The batch holds "features", "next_features" ``[batch, f]``, "action" ``[batch, m]``, "reward", "terminated" ``[batch]``.
        """
        features, next_features = batch["features"], batch["next_features"]
        alpha = self.log_alpha.detach().exp()
        loc, scale = self.actor(torch.cat((features, next_features)))
        n = features.shape[0]
        with torch.no_grad():
            next_action, next_log_prob = sample_action(loc[n:], scale[n:])
            next_value = self.target_critics(next_features, next_action).amin(0) - alpha * next_log_prob
            target = batch["reward"] + self.settings.gamma * torch.where(batch["terminated"], 0.0, next_value)
        value = self.critics(features, batch["action"])
        critic_loss = (value - target).square().mean(-1).sum()
        action, log_prob = sample_action(loc[:n], scale[:n])
        actor_loss = (alpha * log_prob - self.critics(features, action).amin(0)).mean()
        entropy = -log_prob.detach().mean()
        alpha_loss = self.log_alpha * (entropy - self.target_entropy)
        return critic_loss, actor_loss, alpha_loss, entropy

    def _update_once(self, batch: TensorDict) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        critic_loss, actor_loss, alpha_loss, entropy = self.losses(batch)
        for loss, parameters in (
            (critic_loss, self._critic_parameters),
            (actor_loss, self._actor_parameters),  # the actor's loss passes through the critics and must not move them
            (alpha_loss, [self.log_alpha]),
        ):
            for parameter, gradient in zip(parameters, torch.autograd.grad(loss, parameters), strict=True):
                parameter.grad = gradient
        self._optimiser.step()
        with torch.no_grad():
            torch._foreach_lerp_(self._target_parameters, self._critic_parameters, self.settings.tau)
        return critic_loss.detach(), actor_loss.detach(), entropy, self.log_alpha.detach().exp()

    def state_dict(self) -> dict[str, Any]:
        """Networks, targets, temperature, optimiser, and the filled part of the replay buffer."""
        return {
            "actor": self.actor.state_dict(),
            "critics": self.critics.state_dict(),
            "target_critics": self.target_critics.state_dict(),
            "log_alpha": self.log_alpha.detach(),
            "optimiser": self._optimiser.state_dict(),
            "replay": self._replay[:].clone().to_dict() if len(self._replay) else {},
            "replay_writer": self._replay.writer.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from `state_dict`, into an agent that has learned nothing yet.

        Raises:
            CheckpointError: the state belongs to networks of another shape.
        """
        try:
            self.actor.load_state_dict(state["actor"])
            self.critics.load_state_dict(state["critics"])
            self.target_critics.load_state_dict(state["target_critics"])
            with torch.no_grad():
                self.log_alpha.copy_(state["log_alpha"])
            self._optimiser.load_state_dict(state["optimiser"])
            if state["replay"]:
                self._replay.extend(TensorDict.from_dict(state["replay"], auto_batch_size=True, batch_dims=1))
            self._replay.writer.load_state_dict(state["replay_writer"])
        except (KeyError, RuntimeError, ValueError) as error:
            reason = str(error).splitlines()[0]
            raise CheckpointError(f"the checkpoint does not fit this agent ({reason}); resume with the settings it had") from None
