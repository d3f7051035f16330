"""Policy transfer (warm start): continue one algorithm from the policy of another.

New critics mislead the actor, and Adam's first steps are large: without a constraint the policy is lost within an episode. An
anchor therefore pulls the actor back to the initial policy, less over time: the constraint of offline agents (Fujimoto and Gu,
2021), relaxed on the robot (Beeson and Montana, 2022). Scaling by the value's gradient makes it independent of the reward scale.
"""

from __future__ import annotations

import copy
import math
from typing import Any

import torch
from torch import Tensor, nn

from bricksrl.agents.encoder import Encoder
from bricksrl.agents.learner import Learner
from bricksrl.agents.networks import Actor
from bricksrl.agents.sac import LEAST_SCALE, SCALE_SHIFT, ActorCriticLoss, SACLoss
from bricksrl.errors import RunError

STEPS = 2000
"""Robot steps until the actor is free."""
REACH = 2.0
"""Distance from the policy at that time, before the tanh."""
MARGIN = 1.2
"""Standard deviation, relative to the minimum, if the source has none; at the minimum it has no gradient."""
ALPHA = 0.01
"""Maximum initial temperature if the source has none, so that entropy does not outweigh the policy."""


class PolicyFormError(Exception):
    """One network cannot replace the other; the caller adds their origin to the message."""


@torch.no_grad()
def transfer_policy(learner: Learner, source: Learner) -> None:
    """Copy the policy of ``source``, with standard deviation and temperature if both have them, to the new ``learner``, and
    anchor it there. Raises PolicyFormError if their networks differ in form."""
    loss = learner.loss
    if not isinstance(loss, ActorCriticLoss) or "image" in learner.policy.in_keys:
        raise PolicyFormError("transfer needs critics and a network from observations to single actions")
    actor, old_actor = _actor(learner), _actor(source)
    layers, old_layers = _layers(actor.body), _layers(old_actor.body)
    if _form(layers) != _form(old_layers) or actor.encoder.size != old_actor.encoder.size:
        old_form = f"{_form(old_layers)} on {old_actor.encoder.size} features"
        raise PolicyFormError(f"its network is {old_form}, not {_form(layers)} on {actor.encoder.size} features")
    for layer, old_layer in zip(layers, old_layers, strict=True):
        size = min(len(layer), len(old_layer))
        layer[:size] = old_layer[:size]
    if isinstance(loss, SACLoss):
        size = len(layers[-1]) // 2
        if len(old_layers[-1]) == size:
            layers[-2][size:] = 0.0
            layers[-1][size:] = math.log(math.expm1(MARGIN * loss.settings.min_scale - LEAST_SCALE)) - SCALE_SHIFT
        old_log_alpha = getattr(source.loss, "log_alpha", None)
        loss.log_alpha.copy_(loss.log_alpha.clamp_max(math.log(ALPHA)) if old_log_alpha is None else old_log_alpha)
    if isinstance(actor.encoder, Encoder) and isinstance(old_actor.encoder, Encoder):
        actor.encoder.numbers.seen.load_state_dict(old_actor.encoder.numbers.seen.state_dict())
    if hasattr(loss, "target_actor"):
        loss.target_actor.load_state_dict(loss.actor.state_dict())
    anchor(learner)


def anchor(learner: Learner) -> None:
    """Hold the actor near its current policy for the updates of `STEPS` robot steps. Raises RunError if updates are compiled."""
    loss = learner.loss
    if isinstance(loss, ActorCriticLoss):
        if learner.gradients is not None:
            raise RunError("an anchored policy cannot be compiled; omit --compile")
        outputs = len(_layers(loss.actor)[-1])
        updates = max(1, round(STEPS * learner.updates_per_step / learner.actor_delay))
        loss.anchor = PolicyAnchor(loss.actor, outputs // 2 if isinstance(loss, SACLoss) else outputs, updates)


def restore(learner: Learner, state: dict[str, Any]) -> None:
    """Restore `Learner.state_dict` of a learner that may be anchored. Raises CheckpointError as `Learner.load_state_dict` does,
    RunError if an anchored one is compiled."""
    loss = state.get("loss")
    if isinstance(loss, dict) and any(str(name).startswith("anchor.") for name in loss):
        anchor(learner)
    learner.load_state_dict(state)


class CountedUpdates:
    """Module with the number of the actor's updates in its state."""

    updates_made = 0

    def get_extra_state(self) -> dict[str, int]:
        """The number."""
        return {"made": self.updates_made}

    def set_extra_state(self, state: dict[str, int]) -> None:
        """Inverse of `get_extra_state`."""
        self.updates_made = int(state["made"])


class PolicyAnchor(CountedUpdates, nn.Module):
    """A decreasing pull of an actor's mean towards the current policy of ``actor``, until it is free after ``updates`` updates.
    ``actor``: features to outputs; the first ``action_size`` are the mean before the tanh."""

    def __init__(self, actor: nn.Module, action_size: int, updates: int) -> None:
        super().__init__()
        self.policy = copy.deepcopy(actor).requires_grad_(False)
        self._size, self._updates = action_size, updates

    def forward(self, features: Tensor, out: Tensor) -> Tensor:
        """The actor's outputs, whose gradient gets the pull. In equilibrium the distance is the one allowed by now."""
        if not out.requires_grad or self.updates_made >= self._updates:
            return out
        self.updates_made += 1
        reach = REACH * self.updates_made / self._updates
        offset = (out.detach() - self.policy(features))[..., : self._size]

        def add_pull(gradient: Tensor) -> Tensor:
            slope = gradient[..., : self._size]
            pulled = slope + offset * (slope.square().mean().sqrt() / reach)
            return torch.cat((pulled, gradient[..., self._size :]), -1)

        out.register_hook(add_pull)
        return out


def _actor(learner: Learner) -> Actor:
    actor = next((module for module in learner.policy.modules() if isinstance(module, Actor)), None)
    if actor is None:
        raise PolicyFormError("transfer needs a network from observations to single actions")
    return actor


def _layers(network: nn.Module) -> list[Tensor]:
    """Parameters of the layers in order, outputs first."""
    return [parameter for module in network.modules() for parameter in module.parameters(recurse=False)]


def _form(layers: list[Tensor]) -> str:
    """Description of the form, without the number of outputs."""
    weights = [part for part in layers if part.ndim > 1]
    normalised = len(layers) // 2 - len(weights)
    units = "-".join(str(weight.shape[1]) for weight in weights)
    return f"{units} units with {normalised} normalisations" if normalised else f"{units} units"
