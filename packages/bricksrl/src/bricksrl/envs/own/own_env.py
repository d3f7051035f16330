"""Environment that runs a user's ``BaseEnv``: link, lost links, stop, pause and time limit are those of every robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch
from tensordict import TensorDict, TensorDictBase

from bricksrl.envs.env import EpisodeState, HubEnv
from bricksrl.errors import DescriptionError

if TYPE_CHECKING:
    from brickhub.hub.link.receiver import Reading
    from bricksrl.envs.own.base_env import BaseEnv


class OwnEnv(HubEnv):
    """A :class:`~bricksrl.envs.env.HubEnv` whose observations, rewards and ends are those of a user's ``_reset`` and ``_step``."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        assert self.task.base_env is not None  # noqa: S101 - this class is chosen for it
        self._inner: BaseEnv = self.task.base_env
        self._inner.link = lambda: self._connected().link
        self._state = TensorDict({}, [1])

    def _observation_at_start(self, episode: EpisodeState, reading: Reading) -> torch.Tensor:
        self._inner.begin(reading.values)
        return self._observed_in(self._guarded(lambda: self._inner._reset(None)))

    def _outcome(
        self, episode: EpisodeState, action: torch.Tensor, commands: list[float]
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        before = self._state.clone().set("action", torch.tensor([commands]))
        after = self._guarded(lambda: self._inner._step(before))
        link = self._connected().link
        episode.measured_s, episode.hub_time_s = link.now_s(), link.now_s()
        ends = after.get("terminated", after.get("done", None))
        if ends is None or after.get("reward", None) is None:
            raise DescriptionError(f"_step of {self.task.id} returns no 'reward' or no 'done'; set both")
        return self._observed_in(after), after["reward"].reshape(1).float(), ends.reshape(1)

    def _observed_in(self, state: TensorDictBase) -> torch.Tensor:
        key, count = self._inner.observation_key, len(self.task.entries)
        observation = state.get(key, None)
        if observation is None or observation.numel() != count:
            given = "nothing" if observation is None else f"shape {list(observation.shape)}"
            raise DescriptionError(f"{self.task.id} returns {given} as '{key}'; return [1, {count}], as its spec says")
        self._state = state.select(key)
        return observation.detach().reshape(count).float()
