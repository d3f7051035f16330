"""Replay buffer of transitions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import LazyMemmapStorage, LazyTensorStorage, TensorDictReplayBuffer
from torchrl.envs import EnvBase

from bricksrl.agents.settings import OffPolicySettings
from bricksrl.envs.specs import ObservationLayout
from bricksrl.errors import DescriptionError


class TransitionReplayBuffer(TensorDictReplayBuffer):  # type: ignore[misc]
    """Uniform replay of ``capacity`` transitions with observations of ``keys``; the oldest are overwritten first.
    ``memory_mapped``: store in a temporary file; ``device``: of the samples, and of the transitions that are not in a file."""

    def __init__(
        self, capacity: int, batch_size: int, keys: Sequence[str], memory_mapped: bool = False, device: torch.device | str = "cpu"
    ) -> None:
        super().__init__(storage=LazyMemmapStorage(capacity) if memory_mapped else LazyTensorStorage(capacity, device=device))
        self._capacity, self._rows, self._observed, self._sampled_to = capacity, batch_size, keys, torch.device(device)
        self._device = torch.device("cpu") if memory_mapped else self._sampled_to
        self._kind: dict[str, Any] = {}  # further arguments of a subclass
        self._keys = [*keys, "action", *(("next", key) for key in (*keys, "reward", "terminated"))]

    @property
    def batch_size(self) -> int:
        """Transitions per `sample`."""
        return self._rows

    def extend(self, frames: TensorDictBase, *, robot: int = 0, **_: Any) -> Tensor:
        """Store transitions ``[time]`` or ``[copies, time]``. Returns indices. Raises DescriptionError if they do not fit."""
        rows = with_outcome(frames.select(*self._keys), link_lost(frames))
        if not len(rows):
            return torch.empty(0, dtype=torch.int64)
        if len(rows) > self._capacity:
            message = f"{len(rows)} transitions at once do not fit into a replay buffer of {self._capacity}"
            raise DescriptionError(f"{message}; give buffer_size {len(rows)} or more")
        indices: Tensor = super().extend(rows.to(self._device)).to(self._device)
        return indices

    def sample(self, batch_size: int | None = None, **_: Any) -> TensorDictBase:
        """Uniformly drawn transitions with "index"."""
        return self._on_device(super().sample(batch_size or self._rows))

    def empty_like(self, capacity: int) -> TransitionReplayBuffer:
        """An empty buffer of the same kind for ``capacity`` transitions, not in a file."""
        return type(self)(capacity, self._rows, self._observed, device=self._sampled_to, **self._kind)

    def _on_device(self, batch: TensorDictBase) -> TensorDictBase:
        return batch if self._device == self._sampled_to else batch.to(self._sampled_to)


def link_lost(frames: TensorDictBase) -> Tensor | None:
    """Frames with a lost link, or ``None`` if there is no link."""
    lost = frames["next"].get("link_lost", None)
    return None if lost is None else lost.squeeze(-1)


def with_outcome(frames: TensorDictBase, lost: Tensor | None) -> TensorDictBase:
    """Frames as rows, without those with a lost link: they have no outcome."""
    return frames.reshape(-1) if lost is None else frames[~lost]


def cut_at_lost_links(frames: TensorDictBase) -> TensorDictBase:
    """Frames ``[*copies, time]`` where those before a lost link end their episodes: estimates must not look across."""
    lost = link_lost(frames)
    if lost is not None and bool(lost.any()):
        frames = frames.clone()
        frames["next", "done"][..., :-1, :] |= lost[..., 1:, None]
    return frames


def make_replay_buffer(env: EnvBase, settings: OffPolicySettings, device: torch.device | str) -> TransitionReplayBuffer:
    """The replay buffer of the settings for an environment."""
    layout = ObservationLayout.of(env)
    keys = ("observation", "image") if layout.image_px else ("observation",)
    args = (settings.buffer_size, settings.batch_size, keys, settings.memory_mapped, device)
    has_goals = bool(layout.goals) and settings.hindsight + settings.new_goals > 0
    shift_px = settings.shift_px if layout.image_px else 0
    if not has_goals and settings.n_step == 1 and not shift_px:
        return TransitionReplayBuffer(*args)
    from bricksrl.agents.replay.episodic_buffer import EpisodicReplayBuffer, GoalRelabelling

    goals = GoalRelabelling(env.task, layout, settings.hindsight, settings.new_goals) if has_goals else None
    return EpisodicReplayBuffer(*args, gamma=settings.gamma, n_step=settings.n_step, goals=goals, shift_px=shift_px)
