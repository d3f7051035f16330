"""Replay: TorchRL's buffer with knowledge of which transition followed which, for hindsight relabelling and n-step returns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import LazyMemmapStorage, LazyTensorStorage, ReplayBuffer, TensorDictReplayBuffer
from torchrl.envs import EnvBase

from bricksrl.agents.chunks import action_chunks
from bricksrl.agents.encoder import ObservationLayout
from bricksrl.agents.images import shift_images
from bricksrl.agents.relabelling import GoalRelabelling
from bricksrl.agents.settings import OffPolicySettings
from bricksrl.errors import DescriptionError

HORIZON = 4
"""A goal in hindsight is what was reached up to so many steps later."""


class EpisodicReplayBuffer(TensorDictReplayBuffer):  # type: ignore[misc]
    """Uniform replay that knows the successor of each transition.

    Args:
        capacity: transitions; the oldest are overwritten first.
        keys: entries that are kept of a transition, those under "next" too.
        goals: how goals are relabelled in each batch; ``None`` for not.
        n_step: steps whose rewards are summed, discounted by ``gamma``; "steps_to_next_obs" then tells how many they were.
        shift_px: random shift of images.
        memory_mapped: keep the transitions in a temporary file.
    """

    def __init__(
        self,
        capacity: int,
        batch_size: int,
        keys: Sequence[str],
        *,
        gamma: float = 1.0,
        n_step: int = 1,
        goals: GoalRelabelling | None = None,
        shift_px: int = 0,
        memory_mapped: bool = False,
        device: torch.device | str = "cpu",
    ) -> None:
        super().__init__(storage=LazyMemmapStorage(capacity) if memory_mapped else LazyTensorStorage(capacity, device=device))
        self._rows = batch_size
        self._keys = [*keys, "action", *(("next", key) for key in (*keys, "reward", "terminated"))]
        self._device, self._none = torch.device(device), capacity
        self._gamma, self._n_step, self._goals, self._shift_px = gamma, n_step, goals, shift_px
        self._follows = n_step > 1 or (goals is not None and goals.hindsight > 0)
        # place of the transition that followed each one; `_none` where there is none, also as the place to write what is nothing
        self._successor = torch.full((capacity + 1,) if self._follows else (0,), self._none, device=self._device)
        self._last: dict[int, Tensor] = {}  # by robot, of each of its copies

    @property
    def batch_size(self) -> int:
        """Transitions that `sample` draws."""
        return self._rows

    @classmethod
    def of(cls, env: EnvBase, settings: OffPolicySettings, device: torch.device | str, **changes: Any) -> EpisodicReplayBuffer:
        """The replay buffer that settings ask for in an environment."""
        layout, task = ObservationLayout.of(env), getattr(env, "task", None)
        goals = None
        if task is not None and layout.goals and settings.hindsight + settings.new_goals > 0:
            goals = GoalRelabelling(task, layout, settings.hindsight, settings.new_goals)
        keys = ("observation", "image") if layout.image_px else ("observation",)
        kind: dict[str, Any] = {"gamma": settings.gamma, "n_step": settings.n_step, "goals": goals, "shift_px": settings.shift_px}
        kind |= {"memory_mapped": settings.memory_mapped, "device": device, "capacity": settings.buffer_size, **changes}
        return cls(batch_size=settings.batch_size, keys=keys, **kind)

    @classmethod
    def from_frames(
        cls, frames: TensorDictBase, batch_size: int, keys: Sequence[str], *, chunk: int = 0, device: torch.device | str = "cpu"
    ) -> EpisodicReplayBuffer:
        """A memory of recorded frames ``[time]``; with ``chunk`` the action of each is the next so many, ``[chunk, m]``."""
        if chunk:
            frames = frames.clone(recurse=False).set("action", action_chunks(frames, chunk))
        memory = cls(max(2, len(frames)), batch_size, keys, device=device)
        memory.extend(frames)
        return memory

    def extend(self, frames: TensorDictBase, *, robot: int = 0, **_: Any) -> Tensor:
        """Keep transitions ``[time]`` of one robot, or ``[copies, time]``, which go on where the last ones of each copy ended.

        Those of several robots may come in turn, each with the number of its ``robot``. A transition at which the link to the
        robot broke has no outcome: it is dropped, and nothing reaches across it.

        Raises:
            DescriptionError: it cannot hold so many.
        """
        frames = frames if frames.ndim == 2 else frames.reshape(1, -1)
        lost = frames["next"].get("link_lost", None)
        keep = None if lost is None or not bool(lost.any()) else ~lost.squeeze(-1)
        rows = frames.select(*self._keys)
        rows = rows.reshape(-1) if keep is None else rows[keep]
        if not len(rows):
            self._last.pop(robot, None)
            return torch.empty(0, dtype=torch.int64)
        if len(rows) > self._none:
            wanted = f"give buffer_size {len(rows)} or more"
            raise DescriptionError(f"{len(rows)} transitions at once do not fit into a replay buffer of {self._none}; {wanted}")
        at: Tensor = super().extend(rows.to(self._device)).to(self._device)
        if self._follows:
            self._link(at, keep, frames, robot)
        return at

    def _link(self, at: Tensor, keep: Tensor | None, frames: TensorDictBase, robot: int) -> None:
        """Note which transitions followed one another; ``at`` are the places of those that were kept."""
        if keep is None:
            places = at.view(frames.shape)
        else:
            places = torch.full(frames.shape, self._none, device=self._device)
            places[keep] = at
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
        batch: TensorDictBase = super().sample(batch_size or self._rows)
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

    def state_dict(self) -> dict[str, Any]:
        """The filled part of the memory, and where it goes on."""
        follows = {"successor": self._successor[: len(self)].clone(), "last": self._last.get(0)} if self._follows else {}
        return {**filled_part(self), **follows}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from `state_dict`; what is here is forgotten.

        Raises:
            ValueError, KeyError, RuntimeError: the state is that of another memory.
        """
        rows = rows_of(state, self._device)
        if len(rows) > self._none:
            raise ValueError(f"a memory of {len(rows)} transitions does not fit into one of {self._none}")
        self.empty()
        if len(rows):
            super().extend(rows)
        self._writer.load_state_dict(state["writer"])
        if self._follows:
            last = state["last"]
            for places in (state["successor"], torch.empty(0) if last is None else last):
                if bool(((places < 0) | (places > self._none)).any()):
                    raise ValueError("a transition follows from one that is not there")
            self._successor[: len(self)] = state["successor"].to(self._device)
            self._last = {} if last is None else {0: last.to(self._device)}


def filled_part(memory: ReplayBuffer) -> dict[str, Any]:
    """The rows of any replay buffer, and where it goes on, fit for a checkpoint."""
    rows = dict(memory[range(len(memory))].flatten_keys(".").items()) if len(memory) else {}
    return {"rows": rows, "writer": dict(memory.writer.state_dict())}


def rows_of(state: dict[str, Any], device: torch.device) -> TensorDictBase:
    """The rows in what `filled_part` gave."""
    rows = dict(state["rows"])
    return TensorDict(rows, [len(next(iter(rows.values()), ()))], device=device).unflatten_keys(".")
