"""The agent that draws its actions uniformly: the yardstick below all others, and the way to collect random data."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from bricksrl.agents.agent import Transition


class RandomAgent:
    """Uniform actions in -1..1, whatever it sees. It has no best action, so it draws in evaluation too."""

    prefill_episodes = 0

    def __init__(self, action_size: int) -> None:
        self._action_size = action_size

    def start_acting(self) -> None:
        """Nothing is kept from one action to the next."""

    def act(self, observation: Tensor, *, explore: bool) -> Tensor:
        """A uniform action ``[m]``."""
        del observation, explore
        return 2.0 * torch.rand(self._action_size) - 1.0

    def remember(self, transition: Transition) -> None:
        """Forget it: this agent does not learn."""

    def end_episode(self) -> None:
        """Nothing was remembered."""

    def update(self) -> dict[str, float]:
        """Nothing to learn, no losses."""
        return {}

    def state_dict(self) -> dict[str, Any]:
        """Empty: the generator's state is saved with the run."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Nothing to take over."""

    def policy_state(self) -> dict[str, Tensor]:
        """Empty: every such agent acts alike."""
        return {}

    def load_policy_state(self, state: dict[str, Tensor]) -> None:
        """Nothing to take over."""
