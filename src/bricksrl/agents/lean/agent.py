"""What the agents share that learn without autograd."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

from torch import Tensor

from bricksrl.agents.lean.flat import Flat
from bricksrl.agents.off_policy import Batch, OffPolicyAgent


class LeanAgent(OffPolicyAgent):
    """An off-policy agent whose networks lie in `Flat` pieces of memory."""

    flats: Sequence[Flat]
    """All of them."""

    @abstractmethod
    def learn_in_turn(self, batches: Sequence[Batch], *, actor: bool) -> list[tuple[Tensor, ...]]:
        """An update of the critics with each batch, of the actor with the last."""

    def learn(self, batch: Batch, *, actor: bool) -> tuple[Tensor, ...]:
        """One update."""
        return self.learn_in_turn([batch], actor=actor)[0]

    def load_policy_state(self, state: dict[str, Tensor]) -> None:
        """Act as the agent whose `policy_state` this is."""
        super().load_policy_state(state)
        self._refresh()

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from `state_dict`."""
        super().load_state_dict(state)
        self._refresh()

    def _refresh(self) -> None:
        for flat in self.flats:
            flat.refresh()
