"""What the agents share that learn without autograd."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

from torch import Tensor

from bricksrl.agents.lean.flat import Flat
from bricksrl.agents.leash import STEPS, Leash
from bricksrl.agents.networks import Actor
from bricksrl.agents.off_policy import Batch, OffPolicyAgent


class LeanAgent(OffPolicyAgent):
    """An off-policy agent whose networks lie in `Flat` pieces of memory."""

    actor: Actor
    flats: Sequence[Flat]
    """All of them."""
    leash: Leash | None = None
    """Where the policy was taken from another agent, what holds the actor near it at first."""

    @abstractmethod
    def learn_in_turn(self, batches: Sequence[Batch], *, actor: bool) -> list[tuple[Tensor, ...]]:
        """An update of the critics with each batch, of the actor with the last."""

    def learn(self, batch: Batch, *, actor: bool) -> tuple[Tensor, ...]:
        """One update."""
        return self.learn_in_turn([batch], actor=actor)[0]

    def begin_with_actor(self) -> None:
        """Go on from the actor, which came from elsewhere: it is held near what it does now, until the critics know something."""
        self._refresh()
        self.leash = self._new_leash()

    def pull(self, features: Tensor, outputs: Tensor, of_outputs: Tensor) -> None:
        """Add to the gradient by the actor's outputs what holds it."""
        if self.leash is not None:
            self.leash.pull(features, outputs, of_outputs)
            self.leash = None if self.leash.is_over else self.leash

    def state_dict(self) -> dict[str, Any]:
        """As of any learner, and what holds the actor."""
        state = super().state_dict()
        return state if self.leash is None else {**state, "leash": self.leash.state_dict()}

    def load_policy_state(self, state: dict[str, Tensor]) -> None:
        """Act as the agent whose `policy_state` this is."""
        super().load_policy_state(state)
        self._refresh()

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from `state_dict`."""
        super().load_state_dict(state)
        self._refresh()

    def _take_parts(self, state: dict[str, Any]) -> None:
        super()._take_parts(state)
        self.leash = None
        if "leash" in state:
            self.leash = self._new_leash()
            self.leash.load_state_dict(state["leash"])

    def _new_leash(self) -> Leash:
        common = self._common
        updates = max(1, STEPS * common.updates_per_step // common.actor_delay)
        return Leash(self.actor.body, self._action_size, common.batch_size, updates)

    def _refresh(self) -> None:
        for flat in self.flats:
            flat.refresh()
