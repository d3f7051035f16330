"""Where an agent learns: here in the robot's loop, one step after the other. `bricksrl.training.beside` is the other way."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable

    from torch import Tensor

    from bricksrl.agents.agent import Agent, Transition


@dataclass(frozen=True)
class Pace:
    """How learning follows the robot; both count robot steps, each of which asks for the updates that the settings name.

    Attributes:
        asked: steps that updates are due for.
        done: steps whose updates were made; never more.
    """

    asked: int = 0
    done: int = 0

    @property
    def share(self) -> float | None:
        """Updates made, as a share of those that are due; ``None`` before any is."""
        return self.done / self.asked if self.asked else None

    def to_dict(self) -> dict[str, int]:
        """Plain values, fit for a checkpoint."""
        return asdict(self)


class Learner(Protocol):
    """An agent that acts, and learns in some place, as a run sees it."""

    @property
    def prefill_episodes(self) -> int:
        """Episodes of random actions at the start."""

    @property
    def pace(self) -> Pace:
        """How far learning has come."""

    def start_acting(self) -> None:
        """As `Agent.start_acting`."""

    def act(self, observation: Tensor, *, explore: bool) -> Tensor:
        """As `Agent.act`."""

    def remember(self, transition: Transition) -> None:
        """As `Agent.remember`."""

    def end_episode(self) -> None:
        """As `Agent.end_episode`."""

    def update(self) -> dict[str, float]:
        """Ask for the updates of one robot step; returns the means of what updates have told since it was last called."""

    def save(self, path: Path, state: dict[str, Any]) -> None:
        """Write a checkpoint: ``state``, and all of the agent as it is now; elsewhere perhaps a little later."""

    def finish(self, go_on: Callable[[], bool]) -> None:
        """The robot is done: make the updates that are due, while ``go_on`` says so, and have all checkpoints on the disk."""

    def close(self) -> None:
        """Let go of everything. May be called twice."""


class InTheLoop:
    """Learns where it is asked to, while the robot waits: repeatable, bit for bit."""

    def __init__(self, agent: Agent, pace: Pace) -> None:
        self._agent, self._steps = agent, pace.asked
        self.start_acting, self.act = agent.start_acting, agent.act
        self.remember, self.end_episode = agent.remember, agent.end_episode
        self.prefill_episodes, self.sees_images = agent.prefill_episodes, getattr(agent, "sees_images", False)

    @property
    def pace(self) -> Pace:
        """Never behind."""
        return Pace(self._steps, self._steps)

    def update(self) -> dict[str, float]:
        """Make the updates of one robot step."""
        self._steps += 1
        return self._agent.update()

    def save(self, path: Path, state: dict[str, Any]) -> None:
        """Write it, before this returns."""
        from bricksrl.training.checkpoint import save_checkpoint

        save_checkpoint(path, {**state, "agent": self._agent.state_dict(), "pace": self.pace.to_dict()})

    def finish(self, go_on: Callable[[], bool]) -> None:
        """Nothing is due."""

    def close(self) -> None:
        """Nothing to let go of."""
