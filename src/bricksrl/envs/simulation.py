"""Kinematic simulation: a task without a robot, many times at once on any device.

Each commanded motor turns by its command, at once: ``angle += command``. Endless motors wrap into 0..360 degrees, joints stop at
their range, as on the hub. Channels without a motor read 0.
"""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Binary, Bounded, Composite, Unbounded
from torchrl.envs import EnvBase

from bricksrl.envs.kinematics import Kinematics
from bricksrl.envs.nominal import NominalBounded
from bricksrl.envs.task import Task
from bricksrl.errors import DescriptionError
from bricksrl.hub.interface import MotorAngle, RunAngle


class SimulatedEnv(EnvBase):  # type: ignore[misc]
    """``batch_size`` independent copies of a task; keys and specs are those of :class:`~bricksrl.envs.env.HubEnv`.

    Args:
        task: all its commands turn motors, and all its motor channels are commanded.
        kinematics: the noise.
        batch_size: number of copies; 0 for one without a batch dimension.
        device: where the tensors live.
        seed: of starts, goals and noise.

    Raises:
        DescriptionError: the task has commands or motors that kinematics cannot move.
    """

    def __init__(
        self,
        task: Task,
        kinematics: Kinematics,
        *,
        batch_size: int = 0,
        device: str | torch.device = "cpu",
        seed: int | None = None,
    ) -> None:
        super().__init__(batch_size=(batch_size,) if batch_size else (), device=torch.device(device))
        self.task = task
        self._kinematics = kinematics
        self._rng = torch.Generator(self.device)
        self._plan(task)
        self._make_specs()
        self.set_seed(seed if seed is not None else int(torch.seed() % 2**31))
        rows = max(batch_size, 1)
        self._state = torch.zeros(rows, len(task.entries), device=self.device)
        self._steps = torch.zeros(rows, 1, dtype=torch.int32, device=self.device)

    def _plan(self, task: Task) -> None:
        """Turn the task's commands and channels into tensors, one entry a command."""
        commands, channels = task.interface.commands, task.interface.channels
        columns = {channel.motor: i for i, channel in enumerate(channels) if isinstance(channel, MotorAngle)}
        if not all(isinstance(command, RunAngle) and command.motor in columns for command in commands) or len(columns) > len(
            commands
        ):
            raise DescriptionError(f"{task.id} cannot be simulated; every motor needs a RunAngle command and an angle channel")
        angles = [channels[columns[command.motor]] for command in commands if isinstance(command, RunAngle)]

        def tensor(values: list[float]) -> Tensor:
            return torch.tensor(values, dtype=torch.float32, device=self.device)

        self._middle = tensor([(c.low + c.high) / 2 for c in commands])
        self._half = tensor([(c.high - c.low) / 2 for c in commands])
        self._low, self._high = tensor([a.low for a in angles]), tensor([a.high for a in angles])
        self._wraps = torch.tensor([isinstance(a, MotorAngle) and a.wraps for a in angles], device=self.device)
        self._columns = torch.tensor([columns[c.motor] for c in commands if isinstance(c, RunAngle)], device=self.device)
        entries = task.entries
        drawn = set(self._columns.tolist()) | set(range(len(channels), len(entries)))
        # Entries that a reset draws uniformly; the others read 0.
        self._start_low = tensor([e.low if i in drawn else 0.0 for i, e in enumerate(entries)])
        self._start_span = tensor([e.high - e.low if i in drawn else 0.0 for i, e in enumerate(entries)])
        self._whole = tensor([0.0] * len(channels) + [float(h.whole) for h in task.host_entries]).bool()

    def _make_specs(self) -> None:
        entries, shape = self.task.entries, self.batch_size
        bounds = [torch.tensor([getattr(e, side) for e in entries], device=self.device) for side in ("low", "high")]
        low, high = (bound.expand(*shape, len(entries)) for bound in bounds)
        nominal = torch.tensor([e.nominal for e in entries], device=self.device)
        self.observation_spec = Composite(observation=NominalBounded(low, high, nominal=nominal), shape=shape)
        self.action_spec = Bounded(-1.0, 1.0, shape=(*shape, len(self.task.interface.commands)), device=self.device)
        self.reward_spec = Unbounded(shape=(*shape, 1), device=self.device)
        flag = Binary(1, shape=(*shape, 1), dtype=torch.bool, device=self.device)
        self.done_spec = Composite(done=flag, terminated=flag.clone(), truncated=flag.clone(), shape=shape)

    def _set_seed(self, seed: int | None) -> None:
        self._rng.manual_seed(0 if seed is None else seed)

    def _reset(self, tensordict: TensorDictBase | None = None, **_kwargs: Any) -> TensorDictBase:
        mask = tensordict.get("_reset", None) if tensordict is not None else None
        if mask is None:
            self._state = self._draw()
            self._steps = torch.zeros_like(self._steps)
        else:
            mask = mask.view(-1, 1)
            self._state = torch.where(mask, self._draw(), self._state)
            self._steps = self._steps.masked_fill(mask, 0)
        return TensorDict({"observation": self._out(self._state)}, self.batch_size, device=self.device)

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        action = tensordict.get("action").detach().view(self._state.shape[0], -1).clamp(-1.0, 1.0)
        previous, self._state = self._state, self._move(self._state, action)
        self._steps = self._steps + 1
        terminated = self.task.terminated(self._state)
        truncated = self._steps >= self.task.max_steps
        out = {
            "observation": self._state,
            "reward": self.task.reward(previous, action, self._state),
            "terminated": terminated,
            "truncated": truncated,
            "done": terminated | truncated,
        }
        return TensorDict({key: self._out(value) for key, value in out.items()}, self.batch_size, device=self.device)

    def _move(self, state: Tensor, action: Tensor) -> Tensor:
        """The next observation ``[rows, n]``; the action ``[rows, m]`` stays as it is."""
        noise = torch.randn(action.shape, generator=self._rng, device=self.device) * (self._kinematics.noise * self._half)
        turn = action * self._half + self._middle
        on_action = self._kinematics.noise_on == "action"
        angles = self._bounded(state[:, self._columns] + (turn + noise if on_action else turn))
        if not on_action:
            angles = self._bounded(angles + noise)
        moved = state.clone()
        moved[:, self._columns] = angles
        return moved

    def _bounded(self, angles: Tensor) -> Tensor:
        return torch.where(self._wraps, angles.remainder(360.0), angles.clamp(self._low, self._high))

    def _draw(self) -> Tensor:
        """Random starts ``[rows, n]``."""
        share = torch.rand(self._state.shape, generator=self._rng, device=self.device)
        drawn = self._start_low + share * self._start_span
        whole = (self._start_low + share * (self._start_span + 1)).floor()
        return torch.where(self._whole, whole, drawn)

    def _out(self, rows: Tensor) -> Tensor:
        return rows if self.batch_size else rows[0]
