"""Kinematic simulation of an arena: robots on two wheels as points with a heading, many copies in one batch.

It has no hubs and no contacts: robots slide along walls and pass through one another. It serves for fast training; policies are
evaluated in the arena itself.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch
from tensordict import TensorDictBase
from torchrl.envs import EnvBase

from bricksrl.envs.arenas.arena_specs import frame, joined_actions, set_specs
from bricksrl.envs.arenas.arena_task import ArenaState, ArenaTask
from bricksrl.envs.env_interface import BricksEnv
from bricksrl.envs.simulation import batch_shape, resolve_device
from bricksrl.errors import DescriptionError

if TYPE_CHECKING:
    from torch import Tensor

LAG = (0.2, 0.6)
"""Range of the share of a command that is carried out in the next step, as motors speed up; drawn for each episode."""
NOISE = 0.03
"""Standard deviation of a wheel's travel, as a share of the largest command."""
MAX_DRAWS = 2000
"""Number of times that starts too near to one another are drawn again."""
MARGIN_M = 0.07
"""Least distance of a robot's middle from a wall."""


class ArenaSimulation(BricksEnv, EnvBase):  # type: ignore[misc]
    """Copies ``[copies]`` of a task without loads. Raises DescriptionError if the task has no simulation, or ``copies`` is
    invalid; RunError if there is no such device."""

    task: ArenaTask  # type: ignore[assignment]

    def __init__(self, task: ArenaTask, copies: int, *, seed: int | None = None, device: torch.device | str = "cpu") -> None:
        device = resolve_device(device)
        super().__init__(batch_size=batch_shape(copies), device=device)
        self.task = task
        travel_deg, track, radius = [], [], []
        for contestant, interface in zip(task.arena.robots, task.interfaces, strict=True):
            base = contestant.robot.drive_base
            if base is None or task.arena.loads:
                raise DescriptionError(f"{task.id}: only robots with a drive base, and no loads, are simulated so")
            travel_deg.append([command.high for command in interface.commands])
            track.append(base.axle_track_mm / 1000)
            radius.append(base.wheel_diameter_mm / 2000)
        self._way_m = torch.deg2rad(torch.tensor(travel_deg, device=device)) * torch.tensor(radius, device=device)[:, None]
        self._track_m = torch.tensor(track, device=device)
        places = [contestant.place for contestant in task.arena.robots]
        bounds = torch.tensor([[place.x_m, place.y_m, place.heading_deg] for place in places], device=device)
        bounds[:, 2] = -torch.deg2rad(bounds[:, 2].flip(-1))  # clockwise in a place, counter-clockwise in a state
        self._low, self._high = bounds.unbind(-1)
        set_specs(self, task)
        self._rng = torch.Generator(device=self.device)
        self._set_seed(seed)
        n = len(task.robots)
        self._state = ArenaState(torch.zeros(copies, n, 3, device=device), torch.zeros(copies, n, 2, device=device))
        self._lag = torch.zeros(copies, 1, 1, device=device)
        self._last_command = torch.zeros(copies, n, 2, device=device)
        self._step_count = torch.zeros(copies, 1, dtype=torch.int64, device=device)

    def _set_seed(self, seed: int | None) -> None:
        self._seed = seed
        if seed is None:
            self._rng.seed()
        else:
            self._rng.manual_seed(seed)

    def _uniform(self, *shape: int) -> Tensor:
        return torch.rand(shape, generator=self._rng, device=self.device)

    def _starts(self, count: int) -> Tensor:
        """Poses ``[count, robots, 3]`` that keep the arena's gap. Raises TwinError if none are found."""
        poses = torch.empty(count, *self._low.shape, device=self.device)
        near = torch.ones(count, dtype=torch.bool, device=self.device)
        for _ in range(MAX_DRAWS):
            poses[near] = self._low + self._uniform(int(near.sum()), *self._low.shape) * (self._high - self._low)
            distances = torch.cdist(poses[..., :2], poses[..., :2]) + 1e6 * torch.eye(poses.shape[1], device=self.device)
            near = distances.amin((-1, -2)) < self.task.arena.gap_m
            if not bool(near.any()):
                return poses
        raise self.task.arena.too_narrow()

    def _reset(self, tensordict: TensorDictBase | None = None, **_kwargs: Any) -> TensorDictBase:
        mask = None if tensordict is None else tensordict.get("_reset", None)
        is_reset = torch.ones(self.batch_size, dtype=torch.bool, device=self.device) if mask is None else mask.squeeze(-1)
        count = int(is_reset.sum())
        if count:
            poses, moved = self._state.poses.clone(), self._state.moved.clone()
            poses[is_reset], moved[is_reset] = self._starts(count), 0.0
            self._state = ArenaState(poses, moved)
            self._last_command[is_reset] = 0.0
            self._lag[is_reset] = LAG[0] + (LAG[1] - LAG[0]) * self._uniform(count, 1, 1)
            self._step_count[is_reset] = 0
        return self._out()

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        task, before = self.task, self._state
        actions = joined_actions(task, tensordict)
        noise = NOISE * torch.randn(actions.shape, generator=self._rng, device=self.device)
        moved = (1.0 - self._lag) * actions + self._lag * self._last_command + noise
        self._last_command = actions
        left_m, right_m = (moved * self._way_m).unbind(-1)
        x, y, heading = before.poses.unbind(-1)
        turn, forward = (right_m - left_m) / self._track_m, (left_m + right_m) / 2.0
        middle = heading + turn / 2.0
        x, y = x + forward * middle.cos(), y + forward * middle.sin()
        if task.arena.half_size_m is not None:
            half_x, half_y = task.arena.half_size_m
            x = x.clamp(-half_x + MARGIN_M, half_x - MARGIN_M)
            y = y.clamp(-half_y + MARGIN_M, half_y - MARGIN_M)
        self._state = ArenaState(torch.stack((x, y, heading + turn), -1), moved)
        self._step_count += 1
        terminated = task.terminated(self._state)
        truncated = self._step_count >= task.max_steps
        return self._out(task.reward(before, self._state), terminated, truncated)

    def _out(self, *outcome: Tensor) -> TensorDictBase:
        link_lost = torch.zeros(*self.batch_size, 1, dtype=torch.bool, device=self.device)
        return frame(self.task, self._state, link_lost, *outcome, device=self.device)
