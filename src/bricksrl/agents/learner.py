"""What all agents share that learn step by step: their state and that of their policy, steps of optimisers, means of losses."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn

from bricksrl.agents.image_replay import ImageReplay
from bricksrl.agents.replay import ReplayRing
from bricksrl.errors import CheckpointError


class Learner(ABC):
    """A learner for one robot. Networks are made from torch's global generator."""

    actor: nn.Module
    replay: ReplayRing | ImageReplay
    prefill_episodes: int
    loss_names: tuple[str, ...]
    """Names of what ``learn`` returns."""
    _updates = 0

    @abstractmethod
    def _parts(self) -> dict[str, Any]:
        """Networks and optimisers by name: all that learning changes. Each has a ``state_dict`` and can load it."""

    def _policy(self) -> nn.Module:
        """All that acting depends on."""
        return self.actor

    def start_acting(self) -> None:  # noqa: B027  most have nothing in mind but their weights
        """Nothing is kept from one action to the next."""

    def end_episode(self) -> None:
        """What was remembered last is the last of its episode."""
        self.replay.end_episode()

    def policy_state(self) -> dict[str, Tensor]:
        """The policy's tensors, copied."""
        return {name: tensor.clone() for name, tensor in self._policy().state_dict().items()}

    def load_policy_state(self, state: dict[str, Tensor]) -> None:
        """Act as the agent whose `policy_state` this is."""
        self._policy().load_state_dict(state)

    def state_dict(self) -> dict[str, Any]:
        """Networks, optimisers, the filled part of the replay buffer, and the number of updates."""
        parts = {name: part.state_dict() for name, part in self._parts().items()}
        return {**parts, "replay": self.replay.state_dict(), "updates": self._updates}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from `state_dict`, into an agent that has learned nothing yet.

        Raises:
            CheckpointError: the state belongs to networks of another shape.
        """
        try:
            self._take_parts(state)
            self.replay.load_state_dict(state["replay"])
            self._updates = int(state["updates"])
        except (AttributeError, LookupError, OverflowError, RuntimeError, TypeError, ValueError) as error:
            reason = (str(error) or type(error).__name__).splitlines()[0]
            raise CheckpointError(f"the checkpoint does not fit this agent ({reason}); resume with the settings it had") from None

    def _take_parts(self, state: dict[str, Any]) -> None:
        for name, part in self._parts().items():
            part.load_state_dict(state[name])

    def _means(self, found: Sequence[tuple[Tensor, ...]]) -> dict[str, float]:
        """The mean of each number that `loss_names` names, over the updates that have it."""
        means = {}
        for place, name in enumerate(self.loss_names):
            values = [numbers[place] for numbers in found if len(numbers) > place]
            if values:
                means[name] = float(torch.stack(values).mean())
        return means


def step(optimiser: torch.optim.Optimizer, *losses: tuple[Tensor, list[Tensor]]) -> None:
    """One step down each loss for its own parameters only; parameters without a loss stay."""
    gradients = [torch.autograd.grad(loss, parameters) for loss, parameters in losses]
    optimiser.zero_grad()
    for (_, parameters), of_loss in zip(losses, gradients, strict=True):
        for parameter, gradient in zip(parameters, of_loss, strict=True):
            parameter.grad = gradient
    optimiser.step()
