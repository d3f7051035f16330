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
        storage: LazyTensorStorage
        if memory_mapped:
            storage = LazyMemmapStorage(capacity)
        else:
            storage = LazyTensorStorage(capacity, device="cpu")
        super().__init__(storage=storage)
        self._rows = batch_size
        self._observed = keys
        self._sampled_to = torch.device(device)
        self._gamma = gamma
        self._n_step = n_step
        self._goals = goals
        outcome = [("next", key) for key in (*keys, "reward", "terminated")]
        self._keys = [*keys, "action", *outcome]
        in_hindsight = goals is not None and goals.hindsight > 0
        self._has_links = n_step > 1 or in_hindsight
        self._none = capacity  # index of the missing successor
        # The last entry is the missing successor's own one: a chain that has ended stays there.
        links = capacity + 1 if self._has_links else 0
        self._successor = torch.full((links,), self._none)
        self._last: dict[int, Tensor] = {}  # by robot, of each of its copies
        self._augment = list[Transform]()

    @property
    def batch_size(self) -> int:
        """Transitions per `sample`."""
        return self._rows

    def empty_like(self, capacity: int) -> "TransitionReplayBuffer":
        """An empty buffer of the same kind for ``capacity`` transitions, not in a file."""
        kind = (capacity, self._rows, self._observed, False, self._sampled_to)
        empty = type(self)(
            *kind,
            gamma=self._gamma,
            n_step=self._n_step,
            goals=self._goals,
        )
        empty._augment += self._augment
        return empty

    def append_transform(
        self,
        transform: Transform,
        **_: Any,
    ) -> "TransitionReplayBuffer":
        """Transform the batches that are sampled; transitions are stored as they are."""
        self._augment.append(transform)
        return self

    def extend(
        self,
        frames: TensorDictBase,
        *,
        robot: int | None = 0,
        **_: Any,
    ) -> Tensor:
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
            time = frames.shape[-1]
            places = index
            if lost is not None:
                # steps without an outcome are not stored: what came before them gets no successor
                places = torch.full(lost.shape, self._none).masked_scatter(~lost.cpu(), index)
            done = frames["next", "done"].cpu()
            self._link(places.view(-1, time), done.view(-1, time), robot)
        return index

    def _link(
        self,
        indices: Tensor,
        done: Tensor,
        robot: int,
    ) -> None:
        """Link successive transitions, stored at ``indices`` ``[copies, time]``, to each other and
        to the robot's last ones."""
        last = self._last.get(robot)
        if last is not None and len(last) == len(indices):
            self._successor[last] = indices[:, 0]
        # afterwards, as the last ones may have been overwritten
        self._successor[indices] = self._none
        if indices.shape[1] > 1:
            self._successor[indices[:, :-1]] = torch.where(done[:, :-1], self._none, indices[:, 1:])
        # other robots' last transitions, if these were overwritten, have no successor
        for other, ends in self._last.items():
            is_overwritten = torch.isin(ends, indices)
            self._last[other] = torch.where(is_overwritten, self._none, ends)
        self._last[robot] = torch.where(done[:, -1], self._none, indices[:, -1])
        # Those above may have written to it, where a last transition is missing or a link was lost.
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
        self,
        batch_size: int | None = None,
        *,
        batches: int = 0,
        **_: Any,
    ) -> TensorDictBase:
        """Uniformly drawn transitions, relabelled, summed over n steps, transformed; ``batches``
        equal ones, if given."""
        batch = super().sample(batch_size or self._rows)
        index = batch.pop("index")
        if self._goals is not None or self._n_step > 1:
            # shares of goals hold for each batch, not for the rows drawn at once
            size = len(index) // batches if batches else min(self._rows, len(index))
            batch = self._augmented(batch, index, size)
        for transform in self._augment:
            batch = transform(batch)
        return batch.to(self._sampled_to)

    def _augmented(
        self,
        batch: TensorDictBase,
        index: Tensor,
        size: int,
    ) -> TensorDictBase:
        """Rows ``[batch]``, which may be several batches of ``size``, relabelled and summed over n
        steps."""
        chain = [index]
        known = [torch.ones_like(index, dtype=torch.bool)]
        for _ in range(1, self._n_step):
            chain.append(self._successor[chain[-1]])
            known.append(chain[-1] != self._none)
        rows: Any
        if self._n_step == 1:
            rows = batch[None]
        else:
            # a missing successor reads some row, which the mask leaves out of the sum
            existing = torch.stack(chain).clamp_max(len(self) - 1)
            rows = self._storage.get(existing)
        # before rewards are summed: all n of them are those of the new goal
        if self._goals is not None:
            self._relabel(
                self._goals,
                rows,
                index,
                size,
            )
        if self._n_step == 1:
            return batch
        return self._summed(rows, torch.stack(known))

    def _relabel(
        self,
        goals: GoalRelabelling,
        rows: TensorDictBase,
        index: Tensor,
        size: int,
    ) -> None:
        """Relabel shares of each batch in rows ``[n, batches * size]``."""
        count = len(index) // size
        in_hindsight = round(size * goals.hindsight)
        end = min(size, in_hindsight + round(size * goals.new_goals))
        if not end:
            return
        # Rows are drawn uniformly, so that the first of a batch are as good as any: the first get
        # goals in hindsight, the next ones new goals.
        new = [goals.draw(count, end - in_hindsight, device=index.device)]
        if in_hindsight:
            reached_entries = [reached for _, reached in goals.layout.goals]
            by_batch = index[: count * size].view(count, size)
            observed = self._observed_later(by_batch[:, :in_hindsight])  # [count, share, n]
            new.insert(0, observed[..., reached_entries])
        rows_by_batch = rows[:, : count * size].view(len(rows), count, size)
        goals.relabel(rows_by_batch[:, :, :end], torch.cat(new, 1))

    def _observed_later(self, index: Tensor) -> Tensor:
        """For each index an observation up to `HORIZON` steps later, or its own outcome if the
        episode ends before."""
        steps = torch.randint(
            1,
            HORIZON + 1,
            index.shape,
            device=index.device,
        )
        later = index
        # all rows follow their links step by step; those that have gone far enough stay
        for step in range(1, HORIZON + 1):
            later = torch.where(steps >= step, self._successor[later], later)
        later = torch.where(later == self._none, index, later)
        observed: Tensor = self._storage.get(later.flatten())["next", "observation"]
        return observed.view(*index.shape, -1)

    def _summed(
        self,
        rows: TensorDictBase,
        known: Tensor,
    ) -> TensorDictBase:
        """Transitions over up to n steps, from rows ``[n, batch]`` with the mask ``known``."""
        terminated = rows["next", "terminated"].squeeze(-1)  # [n, batch]
        # A step counts if it and all before it are known and none before it has terminated; new
        # goals may have moved where an episode terminates.
        continues = torch.cat((torch.ones_like(known[:1]), ~terminated[:-1]))
        counted = (known & continues).cumprod(0).bool()
        exponents = torch.arange(len(rows), device=known.device)[:, None]
        discount = self._gamma**exponents  # [n, 1]
        rewards = rows["next", "reward"].squeeze(-1)
        reward = (rewards * discount * counted).sum(0)
        # the value is bootstrapped from what followed the last step that counts
        steps = counted.sum(0)
        each_row = torch.arange(rows.shape[1], device=known.device)
        last = rows[steps - 1, each_row]["next"]
        # TorchRL's losses read the count beside "next"; some keep only "next" and read it there
        after = last.clone().update(
            {"reward": reward[:, None], "steps_to_next_obs": steps[:, None]}
        )
        return rows[0].clone().update({"next": after, "steps_to_next_obs": steps[:, None]})

    def links(self) -> dict[str, Any]:
        """Successor links, for a checkpoint."""
        if not self._has_links:
            return {}
        # Of the first robot only: an episode that ran in a fleet does not go on after a resume.
        return {"successor": self._successor[: len(self)].clone(), "last": self._last.get(0)}

    def load_links(self, state: dict[str, Any]) -> None:
        """Inverse of `links`, after the transitions are loaded. Raises ValueError or KeyError for
        another state."""
        if not self._has_links:
            return
        last = state["last"]
        # a file may hold anything, and an index outside would fail only in some later batch
        for indices in (state["successor"], torch.empty(0) if last is None else last):
            is_outside = (indices < 0) | (indices > self._none)
            if bool(is_outside.any()):
                raise ValueError("a successor is missing")
        self._successor[: len(self)] = state["successor"].cpu()
        self._last = {} if last is None else {0: last.cpu()}


def make_replay_buffer(
    env: EnvBase,
    settings: OffPolicySettings,
    device: torch.device | str,
) -> TransitionReplayBuffer:
    """The replay buffer of the settings for an environment."""
    layout = layout_of(env)
    goals = relabelling(env, settings.hindsight, settings.new_goals)
    return TransitionReplayBuffer(
        settings.buffer_size,
        settings.batch_size,
        layout.keys,
        settings.memory_mapped,
        device,
        gamma=settings.gamma,
        n_step=settings.n_step,
        goals=goals,
    )
