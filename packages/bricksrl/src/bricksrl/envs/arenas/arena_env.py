"""Environment of several virtual robots in one world: a step commands all hubs, then reads all."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from tensordict import TensorDictBase
from torchrl.envs import EnvBase

from brickhub.hub.link.team import TeamLink
from brickhub.virtual.virtual_transport import PLACEMENT_MS, VirtualHub
from bricksrl.envs.arenas.arena_specs import frame, joined_actions, set_specs
from bricksrl.envs.arenas.arena_task import ArenaState, ArenaTask
from bricksrl.envs.connection import Reconnect
from bricksrl.envs.env_interface import BricksEnv
from bricksrl.errors import BricksError, HubError, StoppedError
from bricktwin.twin.arena import ArenaWorld

if TYPE_CHECKING:
    from brickhub.hub.link.reading import Reading
    from bricktwin.twin.physics import Physics


class ArenaEnv(BricksEnv, EnvBase):  # type: ignore[misc]
    """Several robots of a task, as a TorchRL environment with groups; see `bricksrl.envs.arenas.arena_specs.set_specs`.

    A broken link ends the episode for all: the step is truncated and marked ``link_lost``, all links are closed, so that all
    motors stop, and the next reset tries to open them again as set by ``reconnect``.

    Args:
        seed: seed of all random numbers; ``None`` for a different one each time.
        physics: physics of all robots.
        realtime: run in real time.
    """

    task: ArenaTask  # type: ignore[assignment]
    reconnect: Reconnect

    def __init__(
        self, task: ArenaTask, *, seed: int | None = None, physics: Physics | None = None, realtime: bool = False
    ) -> None:
        super().__init__(batch_size=())
        self.task = task
        self._physics, self._realtime = physics, realtime
        self._world: ArenaWorld | None = None
        self._hubs: list[VirtualHub] = []
        self._links: list[TeamLink] = []
        self._state: ArenaState | None = None
        self._step_count = 0
        self.reconnect = Reconnect()
        spans = [[(c.low, c.high) for c in interface.commands] for interface in task.interfaces]
        self._low, self._high = torch.tensor(spans)[..., 0], torch.tensor(spans)[..., 1]
        set_specs(self, task)
        self._set_seed(seed)
        self.is_closed = False

    def _set_seed(self, seed: int | None) -> None:
        self._seed = seed
        place, world = np.random.SeedSequence(seed).spawn(2)
        self._place_rng = np.random.default_rng(place)
        self._world_seed = int(world.generate_state(1)[0])
        self._close_links()
        self._world = None

    @property
    def world(self) -> ArenaWorld:
        """World of the robots; `set_seed` replaces it."""
        if self._world is None:
            task = self.task
            self._world = ArenaWorld(task.arena, self._physics, self._world_seed)
            self._hubs = [VirtualHub(body, realtime=self._realtime) for body in self._world.bodies]
            self._world.runners = [hub.run_on_until for hub in self._hubs]
            self._links = [
                TeamLink(hub, body.robot, interface)
                for hub, body, interface in zip(self._hubs, self._world.bodies, task.interfaces, strict=True)
            ]
        return self._world

    def hub(self, robot: str) -> VirtualHub:
        """Hub of a robot, by its name."""
        assert self.world is not None  # noqa: S101  making it makes the hubs
        return self._hubs[self.task.robots.index(robot)]

    def _reset(self, _tensordict: TensorDictBase | None = None, **_kwargs: Any) -> TensorDictBase:
        while True:
            self.reconnect.before_try()
            try:
                self._begin()
            except HubError as error:
                self.reconnect.failed(error)
                self._close_links()
            except StoppedError:
                self._close_links()
                raise
            else:
                self.reconnect.answered(to_step=False)
                return self._out(torch.zeros(1, dtype=torch.bool))

    def _begin(self) -> None:
        world = self.world
        for link in self._links:
            link.open()
        now_ms = max(hub.machine.time_ms for hub in self._hubs)
        for hub in self._hubs:  # placing the robots by hand takes time
            hub.run_on_until(now_ms + PLACEMENT_MS)
        world.place(self._place_rng)
        self._angles = self._wheels([link.read() for link in self._links])
        self._state = ArenaState(self._poses(), torch.zeros(len(self._links), 2))
        self._step_count = 0

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        if self._state is None:
            raise BricksError(f"{self.task.id} has no episode to step; reset the environment first")
        actions = joined_actions(self.task, tensordict)
        commands = self._low + (actions + 1.0) / 2.0 * (self._high - self._low)
        try:
            for link, values in zip(self._links, commands.tolist(), strict=True):
                link.send(values)
            readings = [link.receive() for link in self._links]
        except HubError as error:
            return self._lost(error)
        except StoppedError:
            self._close_links()
            raise
        self.reconnect.answered(to_step=True)
        return self._outcome(readings)

    def _outcome(self, readings: list[Reading]) -> TensorDictBase:
        task, before = self.task, self._state
        assert before is not None  # noqa: S101  `_step` looked
        angles = self._wheels(readings)
        turned = (angles - self._angles + 180.0) % 360.0 - 180.0
        self._angles = angles
        self._state = ArenaState(self._poses(), turned / self._high)
        self._step_count += 1
        terminated = task.terminated(self._state)
        truncated = torch.full_like(terminated, self._step_count >= task.max_steps)
        return self._out(torch.zeros(1, dtype=torch.bool), task.reward(before, self._state), terminated, truncated)

    def _lost(self, error: HubError) -> TensorDictBase:
        """Outcome of a step in which a link broke: the last observation, truncated for all."""
        self.link_error = error
        self.reconnect.failed(error)
        no, yes = torch.zeros(1, dtype=torch.bool), torch.ones(1, dtype=torch.bool)
        out = self._out(yes, torch.zeros(len(self._links), 1), no, yes.clone())
        self._close_links()
        return out

    def _out(self, lost: torch.Tensor, *outcome: torch.Tensor) -> TensorDictBase:
        assert self._state is not None  # noqa: S101  callers have checked it
        return frame(self.task, self._state, lost, *outcome)

    def _wheels(self, readings: list[Reading]) -> torch.Tensor:
        """Angles of the left and the right wheel, ``[robots, 2]``."""
        indices = [interface.angle_indices for interface in self.task.interfaces]
        rows = zip(readings, indices, strict=True)
        return torch.tensor([[reading.values[index[name]] for name in ("left", "right")] for reading, index in rows])

    def _poses(self) -> torch.Tensor:
        poses = [(pose.x_m, pose.y_m, -math.radians(pose.heading_deg)) for pose in self.world.poses()]
        return torch.tensor(poses, dtype=torch.float32)

    def _close_links(self) -> None:
        self._state = None
        for link in self._links:
            link.close()

    def close(self, *, raise_if_closed: bool = True) -> None:
        """Stop all robots. May be called twice; a reset opens the links again."""
        super().close(raise_if_closed=raise_if_closed)
        self._close_links()
