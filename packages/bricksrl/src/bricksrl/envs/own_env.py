"""Environment that runs a user's ``BaseEnv``: link, lost links, stop, pause and time limit are
those of every robot."""

from typing import cast

import torch
from tensordict import TensorDict, TensorDictBase

from brickhub.hub.link.own_client import ClientLink
from brickhub.hub.link.robot_link import Reading
from bricksrl.envs.base_env import BaseEnv
from bricksrl.envs.env import HubEnv
from bricksrl.envs.episode_state import EpisodeState, Floats
from bricksrl.errors import DescriptionError


class OwnEnv(HubEnv):
    """A ``HubEnv`` whose observations, rewards and ends are those of a user's ``_reset`` and
    ``_step``."""

    @property
    def _own(self) -> BaseEnv:
        assert self.task.base_env is not None  # noqa: S101 - this class is chosen for it
        return self.task.base_env

    def _observation_at_start(
        self,
        episode: EpisodeState,
        reading: Reading,
    ) -> Floats:
        self._own.link = lambda: cast("ClientLink", self._connected().link)
        # The client has just answered, so its reset reads this answer and does not ask again.
        self._own.state = reading.values
        state = self._guarded(lambda: self._own._reset(None))
        first: Floats = self._observation_in(state).numpy()
        return first

    def _outcome(
        self,
        episode: EpisodeState,
        action: torch.Tensor,
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        commands = self._commanded(episode, action.tolist())
        # The paper's template takes and returns batches of one, so a dimension is added and
        # removed.
        before = TensorDict(
            {
                self._own.observation_key: episode.observation[None],
                "action": torch.tensor([commands]),
            },
            [1],
        )
        after = self._guarded(lambda: self._own._step(before))
        # This client does not send the hub's time.
        episode.measured_s = episode.hub_time_s = self._connected().link.now_s()
        ends = after.get("terminated", after.get("done", None))
        if ends is None or after.get("reward", None) is None:
            raise DescriptionError(
                f"_step of {self.task.id} returns no 'reward' or no 'done'; set both"
            )
        reward = after["reward"].reshape(1).float()
        return self._observation_in(after), reward, ends.reshape(1)

    def _observation_in(self, state: TensorDictBase) -> torch.Tensor:
        key = self._own.observation_key
        count = len(self.task.entries)
        observation = state.get(key, None)
        if observation is None or observation.numel() != count:
            raise DescriptionError(
                f"{self.task.id} returns no '{key}' of {count} numbers; return [1, {count}], as "
                "its spec says"
            )
        numbers: torch.Tensor = observation.detach().reshape(count).float()
        return numbers
