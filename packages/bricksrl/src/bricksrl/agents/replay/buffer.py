"""Replay buffer of transitions, with successor links for hindsight relabelling and n-step returns.

Reward and termination are pure functions of the observation, and goals do not affect motion, so
goals can be replaced afterwards (hindsight, Andrychowicz et al., 2017).
"""

from collections.abc import Sequence
from typing import Any

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import LazyMemmapStorage, LazyTensorStorage, TensorDictReplayBuffer
from torchrl.envs import EnvBase, Transform

from bricksrl.agents.replay.goals import GoalRelabelling, relabelling
from bricksrl.agents.settings import OffPolicySettings
from bricksrl.envs.rollout import lost_links, with_outcome
from bricksrl.envs.transforms import layout_of
from bricksrl.errors import DescriptionError

HORIZON = 4
"""Hindsight goals are reached at most this number of steps later."""


class TransitionReplayBuffer(TensorDictReplayBuffer):  # type: ignore[misc]
    """Uniform replay of ``capacity`` transitions with observations of ``keys``; the oldest are
    overwritten first.

    Transitions are in the computer's memory, or with ``memory_mapped`` in a temporary file: a
    graphics card seldom has room for all. Samples are moved to ``device``. ``n_step``: steps whose
    rewards are summed with discount ``gamma``; "steps_to_next_obs" is their actual number.
    ``goals``: relabelling of each batch. Where a batch needs what followed, successors are linked.
    """

    def __init__(
        self,
        capacity: int,
        batch_size: int,
        keys: Sequence[str],
        memory_mapped: bool = False,
        device: torch.device | str = "cpu",
        *,
        gamma: float = 1.0,
        n_step: int = 1,
        goals: GoalRelabelling | None = None,
    ) -> None:
        super().__init__(
            storage=LazyMemmapStorage(capacity)
            if memory_mapped
            else LazyTensorStorage(capacity, device="cpu")
        )
        self._rows = batch_size
        self._observed = keys
        self._sampled_to = torch.device(device)
        self._gamma = gamma
        self._n_step = n_step
        self._goals = goals
        self._keys = [*keys, "action", *(("next", key) for key in (*keys, "reward", "terminated"))]
        self._has_links = n_step > 1 or (goals is not None and goals.hindsight > 0)
        self._none = capacity  # index of the missing successor
        self._successor = torch.full((capacity + 1,) if self._has_links else (0,), self._none)
        self._last: dict[int, Tensor] = {}  # by robot, of each of its copies
        self._augment = list[Transform]()

    @property
    def batch_size(self) -> int:
        """Transitions per `sample`."""
        return self._rows

    def empty_like(self, capacity: int) -> "TransitionReplayBuffer":
        """An empty buffer of the same kind for ``capacity`` transitions, not in a file."""
        kind = (capacity, self._rows, self._observed, False, self._sampled_to)
        empty = type(self)(*kind, gamma=self._gamma, n_step=self._n_step, goals=self._goals)
        empty._augment += self._augment
        return empty

    def append_transform(self, transform: Transform, **_: Any) -> "TransitionReplayBuffer":
        """Transform the batches that are sampled; transitions are stored as they are."""
        self._augment.append(transform)
        return self

    def extend(self, frames: TensorDictBase, *, robot: int | None = 0, **_: Any) -> Tensor:
        """Store transitions ``[time]`` or ``[copies, time]`` that continue the last ones of each
        copy of this robot, unless the link was lost; of no robot: without links. Returns indices.
        Raises DescriptionError if they do not fit."""
        lost = lost_links(frames)
        rows = with_outcome(frames.select(*self._keys), lost)
        if not len(rows):
            self.end_episodes(robot)
            return torch.empty(0, dtype=torch.int64)
        if len(rows) > self._none:
            message = (
                f"{len(rows)} transitions at once do not fit into a replay buffer of {self._none}"
            )
            raise DescriptionError(f"{message}; give buffer_size {len(rows)} or more")
        index: Tensor = super().extend(rows.to("cpu"))
        if self._has_links and robot is not None:
            places = index
            time = frames.shape[-1]
            if lost is not None:
                places = torch.full(lost.shape, self._none).masked_scatter(~lost.cpu(), index)
            self._link(places.view(-1, time), frames["next", "done"].cpu().view(-1, time), robot)
        return index

    def _link(self, indices: Tensor, done: Tensor, robot: int) -> None:
        """Link successive transitions, stored at ``indices`` ``[copies, time]``, to each other and
        to the robot's last ones."""
        last = self._last.get(robot)
        if last is not None and len(last) == len(indices):
            self._successor[last] = indices[:, 0]
        # afterwards, as the last ones may have been overwritten
        self._successor[indices] = self._none
        if indices.shape[1] > 1:
            self._successor[indices[:, :-1]] = torch.where(done[:, :-1], self._none, indices[:, 1:])
        for other, ends in self._last.items():  # overwritten transitions have no successor
            self._last[other] = torch.where(torch.isin(ends, indices), self._none, ends)
        self._last[robot] = torch.where(done[:, -1], self._none, indices[:, -1])
        self._successor[self._none] = self._none

    def empty(self, empty_write_count: bool = True) -> None:
        """Remove all transitions."""
        super().empty(empty_write_count)
        self._successor.fill_(self._none)
        self._last.clear()

    def end_episodes(self, robot: int | None = None) -> None:
        """Do not link the next transitions of this robot, or of any, to the previous ones."""
        for ended in list(self._last) if robot is None else [robot]:
            self._last.pop(ended, None)

    def sample(
        self, batch_size: int | None = None, *, batches: int = 0, **_: Any
    ) -> TensorDictBase:
        """Uniformly drawn transitions, relabelled, summed over n steps, transformed; ``batches``
        equal ones, if given."""
        batch = super().sample(batch_size or self._rows)
        index = batch.pop("index")
        if self._goals is not None or self._n_step > 1:
            batch = self._augmented(
                batch, index, len(index) // batches if batches else min(self._rows, len(index))
            )
        for transform in self._augment:
            batch = transform(batch)
        return batch.to(self._sampled_to)

    def _augmented(self, batch: TensorDictBase, index: Tensor, size: int) -> TensorDictBase:
        """Rows ``[batch]``, which may be several batches of ``size``, relabelled and summed over n
        steps."""
        chain = [index]
        known = [torch.ones_like(index, dtype=torch.bool)]
        for _ in range(1, self._n_step):
            chain.append(self._successor[chain[-1]])
            known.append(chain[-1] != self._none)
        rows = (
            batch[None]
            if self._n_step == 1
            else self._storage.get(torch.stack(chain).clamp_max(len(self) - 1))
        )
        if self._goals is not None:
            self._relabel(self._goals, rows, index, size)
        return batch if self._n_step == 1 else self._summed(rows, torch.stack(known))

    def _relabel(
        self, goals: GoalRelabelling, rows: TensorDictBase, index: Tensor, size: int
    ) -> None:
        """Relabel shares of each batch in rows ``[n, batches * size]``."""
        count = len(index) // size
        in_hindsight = round(size * goals.hindsight)
        end = min(size, in_hindsight + round(size * goals.new_goals))
        if not end:
            return
        new = [goals.draw(count, end - in_hindsight, device=index.device)]
        if in_hindsight:
            reached = [reached for _, reached in goals.layout.goals]
            new.insert(
                0,
                self._observed_later(index[: count * size].view(count, size)[:, :in_hindsight])[
                    ..., reached
                ],
            )
        goals.relabel(
            rows[:, : count * size].view(len(rows), count, size)[:, :, :end], torch.cat(new, 1)
        )

    def _observed_later(self, index: Tensor) -> Tensor:
        """For each index an observation up to `HORIZON` steps later, or its own outcome if the
        episode ends before."""
        steps = torch.randint(1, HORIZON + 1, index.shape, device=index.device)
        later = index
        for step in range(1, HORIZON + 1):
            later = torch.where(steps >= step, self._successor[later], later)
        later = torch.where(later == self._none, index, later)
        observed: Tensor = self._storage.get(later.flatten())["next", "observation"]
        return observed.view(*index.shape, -1)

    def _summed(self, rows: TensorDictBase, known: Tensor) -> TensorDictBase:
        """Transitions over up to n steps, from rows ``[n, batch]`` with the mask ``known``."""
        terminated = rows["next", "terminated"].squeeze(-1)
        continues = torch.cat((torch.ones_like(known[:1]), ~terminated[:-1]))
        counted = (known & continues).cumprod(0).bool()
        discount = self._gamma ** torch.arange(len(rows), device=known.device)[:, None]
        reward = (rows["next", "reward"].squeeze(-1) * discount * counted).sum(0)
        steps = counted.sum(0)
        last = rows[steps - 1, torch.arange(rows.shape[1], device=known.device)]["next"]
        # TorchRL's losses read the count beside "next"; some keep only "next" and read it there
        after = last.clone().update(
            {"reward": reward[:, None], "steps_to_next_obs": steps[:, None]}
        )
        return rows[0].clone().update({"next": after, "steps_to_next_obs": steps[:, None]})

    def links(self) -> dict[str, Any]:
        """Successor links, for a checkpoint."""
        return (
            {"successor": self._successor[: len(self)].clone(), "last": self._last.get(0)}
            if self._has_links
            else {}
        )

    def load_links(self, state: dict[str, Any]) -> None:
        """Inverse of `links`, after the transitions are loaded. Raises ValueError or KeyError for
        another state."""
        if not self._has_links:
            return
        last = state["last"]
        for indices in (state["successor"], torch.empty(0) if last is None else last):
            if bool(((indices < 0) | (indices > self._none)).any()):
                raise ValueError("a successor is missing")
        self._successor[: len(self)] = state["successor"].cpu()
        self._last = {} if last is None else {0: last.cpu()}


def make_replay_buffer(
    env: EnvBase, settings: OffPolicySettings, device: torch.device | str
) -> TransitionReplayBuffer:
    """The replay buffer of the settings for an environment."""
    layout = layout_of(env)
    goals = relabelling(env, settings.hindsight, settings.new_goals)
    args = (settings.buffer_size, settings.batch_size, layout.keys, settings.memory_mapped, device)
    return TransitionReplayBuffer(*args, gamma=settings.gamma, n_step=settings.n_step, goals=goals)
