"""What all agents share that learn from observations, and from a dataset of them too: remembering, studying."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import torch
from torch import Tensor

from bricksrl.agents.agent import Transition, Transitions
from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.learner import Learner
from bricksrl.agents.networks import ObservationEncoder
from bricksrl.agents.replay import ReplayRing
from bricksrl.agents.settings import LearnerSettings
from bricksrl.errors import DataError


class Student(Learner):
    """A learner from what one robot did, or what is in a dataset. Networks are made from torch's global generator."""

    replay: ReplayRing

    def __init__(self, layout: ObservationLayout, action_size: int, settings: LearnerSettings) -> None:
        self._common = settings
        self._action_size = action_size
        self.prefill_episodes = settings.prefill_episodes
        self.encoder = ObservationEncoder(layout, settings.angles, settings.goals)
        n = len(layout)
        self._widths = [n, action_size, n, 2]
        self.replay = ReplayRing(settings.replay_size, sum(self._widths))
        self._data: ReplayRing | None = None

    @property
    def sight(self) -> str:
        """What its networks see of an observation, in words."""
        return f"{self._common.angles} angles and {self._common.goals} goals"

    @abstractmethod
    def act(self, observation: Tensor, *, explore: bool) -> Tensor:
        """An action ``[m]`` in -1..1 for an observation ``[n]``; without ``explore`` the agent's best one."""

    @abstractmethod
    def make_updates(self, count: int) -> Sequence[tuple[Tensor, ...]]:
        """``count`` updates; of each the numbers that `loss_names` names."""

    def remember(self, transition: Transition) -> None:
        """Keep a transition, in physical units."""
        outcome = torch.tensor((transition.reward, float(transition.terminated)))
        parts = (transition.observation, transition.action, transition.next_observation, outcome)
        self.replay.add(parts, last=transition.last)

    def study(self, data: Transitions) -> None:
        """Learn from a dataset too: half of each batch is drawn from it, the whole as long as there is nothing of one's own.

        That is the symmetric sampling of RLPD (Ball et al. 2023). The dataset is no part of `state_dict`.

        Raises:
            DataError: there is nothing in it, or its observations or actions are those of another environment.
        """
        shapes = [list(part.shape[1:]) for part in (data.observation, data.action, data.next_observation)]
        if len(data) == 0 or shapes != [[width] for width in self._widths[:3]]:
            wanted = f"{self._widths[0]} numbers observed and {self._action_size} given"
            raise DataError(f"{len(data)} steps of {shapes[0]} numbers observed and {shapes[1]} given; the agent needs {wanted}")
        outcome = torch.stack((data.reward, data.terminated.float()), -1)
        self._data = ReplayRing(len(data), sum(self._widths))
        self._data.fill(torch.cat((data.observation, data.action, data.next_observation, outcome), -1), data.last)

    def update(self, count: int | None = None) -> dict[str, float]:
        """All updates of one robot step, or ``count``; returns the mean of each number that `loss_names` names."""
        if not self._sources():
            return {}
        return self._means(self.make_updates(count or self._common.updates_per_step))

    def _sources(self) -> list[ReplayRing]:
        return [ring for ring in (self.replay, self._data) if ring is not None and len(ring)]
