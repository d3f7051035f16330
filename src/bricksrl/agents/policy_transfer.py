"""Policy transfer: the policy of one algorithm as that of another, which goes on learning in its own way (warm start).

Critics that know nothing lead an actor astray in its first updates, and one step of Adam for each of its weights is already a
long way: within an episode it has forgotten everything. So an anchor draws it back to the policy that it started from, the less
the longer it learns: the constraint of offline agents (Fujimoto and Gu, 2021), which is relaxed on the robot (Beeson and Montana,
2022). The pull is scaled by the gradient of the values, so that it means the same whatever the size of the rewards.
"""

from __future__ import annotations

import copy
import math

import torch
from torch import Tensor, nn

from bricksrl.agents.actor_critic import ActorCriticLoss
from bricksrl.agents.learner import Learner
from bricksrl.agents.networks import Actor
from bricksrl.agents.sac import SACLoss

STEPS = 2000
"""Robot steps until the actor is free."""
REACH = 2.0
"""Distance from the policy that the actor then may have, before the tanh: any."""
MARGIN = 1.2
"""Standard deviation of the actions where the policy had none, as a multiple of the least one: below that it is not learned."""
ALPHA = 0.01
"""Temperature at most where the policy had none: entropy is not to outweigh what the policy can do; it is learned from there."""


class PolicyFormError(Exception):
    """One network cannot stand for the other; whoever knows where they are from tells the user."""


@torch.no_grad()
def transfer_policy(learner: Learner, source: Learner) -> None:
    """Make the policy of ``source`` that of ``learner``, which has learned nothing yet and is held near it at first.

    A policy with a standard deviation of its own keeps it where the learner has one, and so does the temperature.

    Raises:
        PolicyFormError: their networks differ in form.
    """
    loss = learner.loss
    if not isinstance(loss, ActorCriticLoss) or "image" in learner.policy.in_keys:
        raise PolicyFormError("that takes a network from observations to one action, and critics to learn on with")
    mine, theirs = _actor(learner), _actor(source)
    to, of = _layers(mine.body), _layers(theirs.body)
    if _form(to) != _form(of) or mine.encoder.size != theirs.encoder.size:
        here, there = f"{_form(of)} on {theirs.encoder.size} features", f"{_form(to)} on {mine.encoder.size} features"
        raise PolicyFormError(f"its network is {here}, not {there}")
    for target, given in zip(to, of, strict=True):
        size = min(len(target), len(given))
        target[:size] = given[:size]
    if isinstance(loss, SACLoss):
        size = len(to[-1]) // 2
        if len(of[-1]) == size:
            to[-2][size:] = 0.0
            to[-1][size:] = math.log(math.expm1(MARGIN * loss.settings.min_scale - 0.01)) - math.log(math.expm1(0.99))
        known = getattr(source.loss, "log_alpha", None)
        loss.log_alpha.copy_(loss.log_alpha.clamp_max(math.log(ALPHA)) if known is None else known)
    if hasattr(loss, "target_actor"):
        loss.target_actor.load_state_dict(loss.actor.state_dict())
    anchor(learner)


def anchor(learner: Learner) -> None:
    """Hold the learner's actor near what it is now until it has made the updates of `STEPS` robot steps."""
    loss = learner.loss
    if isinstance(loss, ActorCriticLoss):
        outputs = len(_layers(loss.actor)[-1])
        updates = max(1, round(STEPS * learner.updates_per_step / learner.actor_delay))
        loss.anchor = PolicyAnchor(loss.actor, outputs // 2 if isinstance(loss, SACLoss) else outputs, updates)


class PolicyAnchor(nn.Module):
    """Holds an actor's mean near the policy that ``actor`` is now.

    Args:
        actor: features to outputs of which the first ``action_size`` are the mean before the tanh.
        updates: of the actor, until it is free.
    """

    def __init__(self, actor: nn.Module, action_size: int, updates: int) -> None:
        super().__init__()
        self.policy = copy.deepcopy(actor).requires_grad_(False)
        self._size, self._updates, self._made = action_size, updates, 0

    @property
    def is_over(self) -> bool:
        """Whether the actor is free."""
        return self._made >= self._updates

    def forward(self, features: Tensor, out: Tensor) -> Tensor:
        """The actor's outputs, whose gradient gets the pull towards the policy added as it passes.

        In balance the actor is as far away from the policy as it may be after the updates that were made.
        """
        if not out.requires_grad or self.is_over:
            return out
        self._made += 1
        reach = REACH * self._made / self._updates
        away = (out.detach() - self.policy(features))[..., : self._size]

        def pulled(gradient: Tensor) -> Tensor:
            slope = gradient[..., : self._size]
            held = slope + away * (slope.square().mean().sqrt() / reach)
            return torch.cat((held, gradient[..., self._size :]), -1)

        out.register_hook(pulled)
        return out

    def get_extra_state(self) -> dict[str, int]:
        """The updates of the actor so far."""
        return {"made": self._made}

    def set_extra_state(self, state: dict[str, int]) -> None:
        """Inverse of `get_extra_state`."""
        self._made = int(state["made"])


def _actor(learner: Learner) -> Actor:
    found = [module for module in learner.policy.modules() if isinstance(module, Actor)]
    if not found:
        raise PolicyFormError("that takes a network from observations to one action")
    return found[0]


def _layers(network: nn.Module) -> list[Tensor]:
    """Parameters of its layers in their order, outputs first."""
    return [parameter for module in network.modules() for parameter in module.parameters(recurse=False)]


def _form(layers: list[Tensor]) -> str:
    """The form in words, but for how many numbers come out."""
    weights = [part for part in layers if part.ndim > 1]
    normalised = len(layers) // 2 - len(weights)
    units = "-".join(str(weight.shape[1]) for weight in weights)
    return f"{units} units with {normalised} normalisations" if normalised else f"{units} units"
