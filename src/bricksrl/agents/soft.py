"""What SAC and CrossQ share: a stochastic actor that is paid for its entropy, at a learned temperature."""

from __future__ import annotations

import functools
import math
from abc import abstractmethod
from collections.abc import Sequence

import torch
from torch import Tensor, nn

from bricksrl.agents.lean import gaussian
from bricksrl.agents.lean.agent import LeanAgent
from bricksrl.agents.lean.flat import Learned
from bricksrl.agents.lean.passes import Pass
from bricksrl.agents.networks import Actor
from bricksrl.agents.off_policy import Batch
from bricksrl.agents.presets import CrossQSettings, SACSettings


class Temperature(nn.Module):
    """The weight of the entropy, learned so that the entropy stays at ``target_entropy``."""

    def __init__(self, initial: float, target_entropy: float) -> None:
        super().__init__()
        self.log_alpha = nn.Parameter(torch.tensor(math.log(initial)))
        self.target_entropy = target_entropy

    def alpha(self) -> Tensor:
        """The temperature, as a constant."""
        return self.log_alpha.detach().exp()

    def weight(self) -> float:
        """The same as a number."""
        return math.exp(self.log_alpha.item())

    def loss(self, entropy: Tensor) -> Tensor:
        """What to descend for an entropy, a constant."""
        return self.log_alpha * (entropy - self.target_entropy)


def sample_action(loc: Tensor, scale: Tensor) -> tuple[Tensor, Tensor]:
    """A reparametrised draw ``[*batch, m]`` from a tanh-squashed normal, and its log-probability ``[*batch]``, for autograd."""
    noise = torch.randn_like(loc)
    x = torch.addcmul(loc, scale, noise)
    log_normal = -0.5 * noise.square() - scale.log() - 0.5 * math.log(2 * math.pi)
    return x.tanh(), (log_normal - gaussian.log_slope(x)).sum(-1)


class SoftAgent(LeanAgent):
    """An agent with such an actor."""

    loss_names: tuple[str, ...] = ("critic_loss", "actor_loss", "entropy", "alpha")
    settings: SACSettings | CrossQSettings
    actor: Actor
    temperature: Temperature
    learned_critics: Learned
    learned_actor: Learned
    """Actor and temperature."""

    def make_passes(self) -> None:
        """The ways through the actor, once it is `learned_actor`: to act, to foresee, and to climb."""
        body, rows = self.actor.body, self.settings.batch_size
        self._acting = Pass(body, 1, training=False)
        self._foreseeing = functools.cache(functools.partial(Pass, body, flat=self.learned_actor, training=False))
        self._climbing = Pass(body, rows, self.learned_actor)
        self._of_log_alpha = self.learned_actor.gradient(self.temperature.log_alpha)

    def act(self, observation: Tensor, *, explore: bool) -> Tensor:
        """A drawn action ``[m]`` with ``explore``, else the mode of the policy."""
        with torch.no_grad():
            out = self._acting.forward(self.encoder.forward(observation)[None])
            return gaussian.act(out[0, 0], self.settings.min_scale, explore=explore)

    @torch.no_grad()
    def learn_in_turn(self, batches: Sequence[Batch], *, actor: bool) -> list[tuple[Tensor, ...]]:
        """An update of the critics with each batch, of the actor with the last."""
        rows = self.settings.batch_size
        outs = [self._foreseeing(rows * len(batches)).forward(torch.cat([batch.next_features for batch in batches]))]
        if actor:
            self._outputs = self._climbing.forward(batches[-1].features)
            outs.append(self._outputs)
        out = outs[0][0] if len(outs) == 1 else torch.cat([out[0].mT for out in outs], -1).mT
        drawn = gaussian.draw(out, self.settings.min_scale, torch.randn(len(out), self._action_size))
        found = []
        for place, batch in enumerate(batches):
            of_batch = slice(place * rows, (place + 1) * rows)
            numbers = self.descend_critics(batch, drawn.action[of_batch], drawn.log_prob[of_batch])
            if actor and place == len(batches) - 1:
                numbers += self._move_actor(batch, drawn.last(rows))  # by the critics as they were before this update
            self.move_critics()
            found.append(numbers)
        return found

    @abstractmethod
    def descend_critics(self, batch: Batch, next_action: Tensor, next_log_prob: Tensor) -> tuple[Tensor, ...]:
        """Gradients of the critics, for an action ``[batch, m]`` after each step; returns their loss, and what else to tell."""

    @abstractmethod
    def climb(self, features: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
        """What the critics think of actions ``[batch, m]``, on average, and its gradient by them, turned to descend."""

    @abstractmethod
    def move_critics(self) -> None:
        """A step of the critics down their gradients."""

    def descend_actor(self, batch: Batch, drawn: gaussian.Draw) -> tuple[Tensor, Tensor]:
        """Gradients of actor and temperature, for a draw from the actor's last outputs; returns the loss and the entropy."""
        alpha, entropy = self.temperature.weight(), -drawn.log_prob.mean()
        value, of_outputs = self.lead(batch, drawn, alpha / len(drawn.action))
        self.pull(batch.features, self._outputs[0], of_outputs)
        self._climbing.backward(of_outputs[None])
        torch.sub(entropy, self.temperature.target_entropy, out=self._of_log_alpha)
        return torch.add(value, entropy, alpha=alpha).neg_(), entropy

    def lead(self, batch: Batch, drawn: gaussian.Draw, of_log_prob: float) -> tuple[Tensor, Tensor]:
        """What the actor is to raise beside its entropy, and the gradient ``[batch, 2 m]`` of both by its outputs."""
        value, of_action = self.climb(batch.features, drawn.action)
        return value, drawn.backward(of_action, of_log_prob)

    def _move_actor(self, batch: Batch, drawn: gaussian.Draw) -> tuple[Tensor, ...]:
        numbers = self.descend_actor(batch, drawn)
        self.learned_actor.step()
        return *numbers, self.temperature.alpha()
