"""What training and evaluation ask of an agent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from tensordict import TensorDictBase
    from torch import Tensor


@dataclass(frozen=True)
class Transition:
    """One step of one robot: ``observation`` ``[n]``, ``action`` ``[m]``, ``reward`` a number.

    For an agent that sees images an observation is a TensorDict, see `look`.
    """

    observation: Tensor
    action: Tensor
    reward: float
    next_observation: Tensor
    terminated: bool
    """True only where the task ended; a time limit is no end, values go on through it."""
    last: bool = False
    """Whether it is the last one of its episode, for whatever reason."""


@dataclass(frozen=True)
class Transitions:
    """``N`` steps in the order in which they were made: ``observation``, ``next_observation`` ``[N, n]``, ``action`` ``[N, m]``,
    the others ``[N]``. In physical units, actions in -1..1."""

    observation: Tensor
    action: Tensor
    reward: Tensor
    next_observation: Tensor
    terminated: Tensor
    """Bool; true only where the task ended."""
    last: Tensor
    """Bool; whether it is the last one of its episode, for whatever reason."""

    def __len__(self) -> int:
        return len(self.reward)


def look(agent: object, state: TensorDictBase) -> Tensor:
    """What of an environment's state an agent gets: the observation ``[n]``, and the image where it sees.

    The two then come as a TensorDict of ``observation`` and ``image``, uint8 ``[side, side, 3]``.
    """
    seen: Tensor = state.select("observation", "image") if getattr(agent, "sees_images", False) else state["observation"]
    return seen


class Agent(Protocol):
    """Decides and learns. Randomness comes from torch's global generator, so that its state is all there is to save."""

    prefill_episodes: int
    """Episodes at the start whose actions are drawn uniformly, before the agent acts and learns."""

    def start_acting(self) -> None:
        """What is seen next does not follow from the last action: an episode starts, or a human has given the robot back.

        Whatever acts has to say so. An agent that plans ahead forgets its plan here.
        """

    def act(self, observation: Tensor, *, explore: bool) -> Tensor:
        """An action ``[m]`` in -1..1 for an observation ``[n]``; without ``explore`` the agent's best one."""

    def remember(self, transition: Transition) -> None:
        """Keep a transition to learn from."""

    def end_episode(self) -> None:
        """What was remembered last is the last of its episode, whatever it said: the link to the robot broke there."""

    def update(self) -> dict[str, float]:
        """Learn, as often as the settings ask for one robot step; returns losses by name, nothing when it does not learn."""

    def state_dict(self) -> dict[str, Any]:
        """All that `load_state_dict` needs to go on exactly: tensors, numbers, strings, lists and dictionaries of them."""

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take over what `state_dict` gave."""

    def policy_state(self) -> dict[str, Tensor]:
        """All that `act` depends on, a copy: small, for an agent elsewhere that acts while this one learns."""

    def load_policy_state(self, state: dict[str, Tensor]) -> None:
        """Act as the agent whose `policy_state` this is."""
