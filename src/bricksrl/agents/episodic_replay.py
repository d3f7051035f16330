"""Episodic replay: a buffer that knows which transition followed which, for hindsight relabelling and n-step returns.

A task's reward and its end are pure functions of the observation, and a goal moves nothing: with another goal a step is as if it
had been made for that one (hindsight, Andrychowicz et al., 2017).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from tensordict import TensorDictBase
from torch import Tensor

from bricksrl.agents.images import shift_images
from bricksrl.agents.replay import TransitionReplayBuffer, link_lost
from bricksrl.envs.specs import ObservationLayout
from bricksrl.envs.task import Task

HORIZON = 4
"""A goal in hindsight is what was reached up to so many steps later."""


@dataclass(frozen=True)
class GoalRelabelling:
    """Other goals for what was done.

    Attributes:
        hindsight: share of each batch whose goals become what was reached some steps later.
        new_goals: share of each batch that gets goals drawn uniformly from their range.
    """

    task: Task
    layout: ObservationLayout
    hindsight: float
    new_goals: float

    def relabel_batch(self, rows: TensorDictBase, at: Tensor, size: int, observed_later: Callable[[Tensor], Tensor]) -> None:
        """Relabel the shares of rows ``[n, batch]``, which may be several batches of ``size`` in a row.

        Args:
            at: places ``[batch]`` of the rows in the memory.
            observed_later: places ``[*some]`` to observations ``[*some, o]`` that followed them.
        """
        count = len(at) // size
        in_hindsight = round(size * self.hindsight)
        end = in_hindsight + round(size * self.new_goals)
        if not end:
            return
        goals = [self.draw(count, end - in_hindsight, device=at.device)]
        if in_hindsight:
            reached = [reached for _, reached in self.layout.goals]
            goals.insert(0, observed_later(at.view(count, size)[:, :in_hindsight])[..., reached])
        self.relabel(rows.view(len(rows), count, size)[:, :, :end], torch.cat(goals, 1))

    def draw(self, *batch: int, device: torch.device) -> Tensor:
        """Uniformly random goals ``[*batch, g]``."""
        ends = (self.layout.low, self.layout.high)
        low, high = (torch.tensor([end[goal] for goal, _ in self.layout.goals], device=device) for end in ends)
        return low + torch.rand(*batch, len(low), device=device) * (high - low)

    def relabel(self, rows: TensorDictBase, goals: Tensor) -> None:
        """Write goals ``[*batch, g]`` into rows ``[n, *batch]``, and the rewards and ends that follow from them."""
        places = [goal for goal, _ in self.layout.goals]
        after = rows["next"]
        for observation in (rows["observation"], after["observation"]):
            observation[..., places] = goals
        after["reward"].copy_(self.task.reward(rows["observation"], rows["action"], after["observation"]))
        after["terminated"].copy_(self.task.terminated(after["observation"]))


class EpisodicReplayBuffer(TransitionReplayBuffer):
    """Uniform replay that knows the successor of each transition.

    Args:
        goals: how goals are relabelled in each batch; ``None`` for not.
        n_step: steps whose rewards are summed, discounted by ``gamma``; "steps_to_next_obs" then tells how many they were.
        shift_px: random shift of images.
        size, kind: capacity, size of a batch, keys and the like, as of `TransitionReplayBuffer`.
    """

    def __init__(
        self,
        *size: Any,
        gamma: float = 1.0,
        n_step: int = 1,
        goals: GoalRelabelling | None = None,
        shift_px: int = 0,
        **kind: Any,
    ) -> None:
        super().__init__(*size, **kind)
        self._gamma, self._n_step, self._goals, self._shift_px = gamma, n_step, goals, shift_px
        self._follows = n_step > 1 or (goals is not None and goals.hindsight > 0)
        self._none = self._capacity  # the place of what is not there, also to write what is nothing
        self._successor = torch.full((self._none + 1,) if self._follows else (0,), self._none, device=self._device)
        self._last: dict[int, Tensor] = {}  # by robot, of each of its copies

    def extend(self, frames: TensorDictBase, *, robot: int = 0, **_: Any) -> Tensor:
        """Keep transitions, which go on where the last ones of this robot, and of each of its copies, ended.

        Those of several robots may come in turn. Nothing reaches across a transition at which the link to the robot broke.
        """
        frames = frames if frames.ndim == 2 else frames.reshape(1, -1)
        at = super().extend(frames)
        if not len(at):
            self._last.pop(robot, None)
        elif self._follows:
            self._link(at, frames, robot)
        return at

    def _link(self, at: Tensor, frames: TensorDictBase, robot: int) -> None:
        """Note which transitions followed one another; ``at`` are the places of those that were kept."""
        lost = link_lost(frames)
        if lost is None:
            places = at.view(frames.shape)
        else:
            places = torch.full(frames.shape, self._none, device=self._device)
            places[~lost] = at
        done = frames["next", "done"].squeeze(-1).to(self._device)
        last = self._last.get(robot)
        if last is not None and len(last) == len(places):
            self._successor[last] = places[:, 0]
        self._successor[places] = self._none  # after that: the last ones may be among those that were overwritten
        if places.shape[1] > 1:
            self._successor[places[:, :-1]] = torch.where(done[:, :-1], self._none, places[:, 1:])
        for other, ends in self._last.items():  # what was overwritten is followed by nothing
            self._last[other] = torch.where(torch.isin(ends, at), self._none, ends)
        self._last[robot] = torch.where(done[:, -1], self._none, places[:, -1])
        self._successor[self._none] = self._none

    def empty(self, empty_write_count: bool = True) -> None:
        """Forget all transitions."""
        super().empty(empty_write_count)
        self._successor.fill_(self._none)
        self._last.clear()

    def end_episodes(self, robot: int | None = None) -> None:
        """Nothing that is kept next, of this robot or of any, follows from what was kept last."""
        for ended in list(self._last) if robot is None else [robot]:
            self._last.pop(ended, None)

    def sample(self, batch_size: int | None = None, **_: Any) -> TensorDictBase:
        """Transitions drawn uniformly, relabelled, summed over n steps and their images shifted, as the buffer was made for."""
        batch = super().sample(batch_size)
        at = batch.pop("index")
        if self._goals is not None or self._n_step > 1:
            batch = self._augmented(batch, at)
        if self._shift_px:
            for part in (batch, batch["next"]):
                part["image"] = shift_images(part["image"], self._shift_px)
        return batch

    def _augmented(self, batch: TensorDictBase, at: Tensor) -> TensorDictBase:
        chain, known = [at], [torch.ones_like(at, dtype=torch.bool)]
        for _ in range(1, self._n_step):
            chain.append(self._successor[chain[-1]])
            known.append(chain[-1] != self._none)
        rows = batch[None] if self._n_step == 1 else self._storage.get(torch.stack(chain).clamp_max(len(self) - 1))
        if self._goals is not None:  # batches for several updates may be drawn at once; each gets its share
            self._goals.relabel_batch(rows, at, min(self._rows, len(at)), self._observed_later)
        return batch if self._n_step == 1 else self._summed(rows, torch.stack(known))

    def _observed_later(self, at: Tensor) -> Tensor:
        """For each place what was observed up to `HORIZON` steps later, or at the last step of its episode before."""
        steps, there = torch.randint(1, HORIZON + 1, at.shape, device=at.device), at
        for step in range(1, HORIZON + 1):
            there = torch.where(steps >= step, self._successor[there], there)
        later = torch.where(there == self._none, at, there)
        observed: Tensor = self._storage.get(later.flatten())["next", "observation"]
        return observed.view(*at.shape, -1)

    def _summed(self, rows: TensorDictBase, known: Tensor) -> TensorDictBase:
        """Transitions over up to n steps, from rows ``[n, batch]`` of which some are not ``known``."""
        terminated = rows["next", "terminated"].squeeze(-1)
        begun = torch.cat((torch.ones_like(known[:1]), ~terminated[:-1]))
        counted = (known & begun).cumprod(0).bool()
        discount = self._gamma ** torch.arange(len(rows), device=known.device)[:, None]
        reward = (rows["next", "reward"].squeeze(-1) * discount * counted).sum(0)
        steps = counted.sum(0)
        last = rows[steps - 1, torch.arange(rows.shape[1], device=known.device)]["next"]
        # losses of TorchRL's read the count beside "next"; some keep nothing but "next" of what they get, and find it there
        after = last.clone().update({"reward": reward[:, None], "steps_to_next_obs": steps[:, None]})
        return rows[0].clone().update({"next": after, "steps_to_next_obs": steps[:, None]})

    def links(self) -> dict[str, Any]:
        """What followed what, for a checkpoint."""
        return {"successor": self._successor[: len(self)].clone(), "last": self._last.get(0)} if self._follows else {}

    def load_links(self, state: dict[str, Any]) -> None:
        """Inverse of `links`, once the transitions are there.

        Raises:
            ValueError, KeyError: the state is that of another memory.
        """
        if not self._follows:
            return
        last = state["last"]
        for places in (state["successor"], torch.empty(0) if last is None else last):
            if bool(((places < 0) | (places > self._none)).any()):
                raise ValueError("a transition follows from one that is not there")
        self._successor[: len(self)] = state["successor"].to(self._device)
        self._last = {} if last is None else {0: last.to(self._device)}
