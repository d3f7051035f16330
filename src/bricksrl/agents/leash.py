"""An actor that was taken from elsewhere, held near what it did there until its new critics know better.

Critics that know nothing lead an actor astray in its first updates, and one step of Adam for each of its weights is already a
long way: within an episode it has forgotten everything. So it is drawn back to the policy that it started from, the less the
longer it learns: the constraint of offline agents (Fujimoto and Gu 2021), whose pull is relaxed on the robot (Beeson and Montana
2022). The pull is measured by the slope of the values, so that it means the same whatever the size of the rewards.
"""

from __future__ import annotations

import copy
from typing import Any

from torch import Tensor

from bricksrl.agents.lean.passes import Pass
from bricksrl.agents.networks import StackedMLP

STEPS = 2000
"""Robot steps until nothing is left of it."""
REACH = 2.0
"""How far from the policy the actor then may get, before the tanh: anywhere."""


class Leash:
    """Holds an actor near the policy that ``body`` is now.

    Args:
        rows: batch size.
        updates: of the actor, until it is free.
    """

    def __init__(self, body: StackedMLP, action_size: int, rows: int, updates: int) -> None:
        self._policy = copy.deepcopy(body).requires_grad_(False)
        self._following = Pass(self._policy, rows, training=False)
        self._means = slice(action_size)
        self._updates, self._made = updates, 0

    @property
    def is_over(self) -> bool:
        """Whether the actor is free."""
        return self._made >= self._updates

    def pull(self, features: Tensor, outputs: Tensor, of_outputs: Tensor) -> None:
        """Add its pull to the gradient ``of_outputs`` ``[batch, >= m]`` by an actor's ``outputs``, of which the means come first.

        In balance the actor is as far away from the policy as the leash is long now.
        """
        self._made += 1
        length = REACH * self._made / self._updates
        slope, away = of_outputs[:, self._means], (outputs - self._following.forward(features)[0])[:, self._means]
        slope += away * (slope.square().mean().sqrt() / length)

    def state_dict(self) -> dict[str, Any]:
        """All that `load_state_dict` needs."""
        return {"policy": self._policy.state_dict(), "made": self._made}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from `state_dict`."""
        self._policy.load_state_dict(state["policy"])
        self._made = int(state["made"])
