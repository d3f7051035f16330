"""Anchor: what holds an actor near the policy that it was taught.

New critics mislead the actor, and Adam's first steps are large: without a constraint what was
taught is lost within an episode. An anchor therefore pulls the actor back to the policy that it
began with, less over time: the constraint of offline agents (Fujimoto and Gu, 2021), relaxed on the
robot (Beeson and Montana, 2022). Scaling by the value's gradient makes it independent of the reward
scale.
"""

import copy

import torch
from torch import Tensor, nn

STEPS = 2000
"""Robot steps until the actor is free."""
REACH = 2.0
"""Distance from the first policy at that time, before the tanh."""
REACH_ON_BASE = 0.4
"""The same of what is added to a base, which is all that acts at first."""


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
    """A decreasing pull of an actor's mean towards the current policy of ``actor``, until it is
    free after ``updates`` updates, ``reach`` away. ``actor``: features to outputs; the first
    ``action_size`` are the mean before the tanh."""

    def __init__(
        self,
        actor: nn.Module,
        action_size: int,
        updates: int,
        reach: float = REACH,
    ) -> None:
        super().__init__()
        self.policy = copy.deepcopy(actor).requires_grad_(False)
        self._size = action_size
        self._updates = updates
        self._reach = reach

    def forward(
        self,
        features: Tensor,
        out: Tensor,
    ) -> Tensor:
        """The actor's outputs, whose gradient gets the pull. In equilibrium the distance is the one
        allowed by now."""
        # nothing is learned from what has no gradient, and nothing is counted
        if not out.requires_grad or self.updates_made >= self._updates:
            return out
        self.updates_made += 1
        reach = self._reach * self.updates_made / self._updates
        moved = out.detach() - self.policy(features)
        offset = moved[..., : self._size]

        def add_pull(gradient: Tensor) -> Tensor:
            # of the mean; that of the scales, after it, stays as it is
            slope = gradient[..., : self._size]
            # as strong as the slope where the offset is the reach, whatever the unit of rewards
            strength = slope.square().mean().sqrt() / reach
            pulled = slope + offset * strength
            return torch.cat((pulled, gradient[..., self._size :]), -1)

        out.register_hook(add_pull)
        return out


def layers_of(network: nn.Module) -> list[Tensor]:
    """Parameters of a network's layers in order, weights before biases, outputs first."""
    layers: list[Tensor] = []
    for module in network.modules():
        layers += module.parameters(recurse=False)
    return layers
