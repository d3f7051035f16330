"""Environments of several robots: virtual ones in one world, and a kinematic simulation of many
copies.

The simulation has no hubs and no contacts: robots on two wheels are points with a heading, which
slide along walls and pass through one another. It serves for fast training; policies are evaluated
in the arena itself.
"""

import functools
import math
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Binary, Bounded, Composite, Unbounded
from torchrl.envs import EnvBase

from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.robot_link import Reading
from brickhub.hub.messages import HeardNumber
from brickhub.seed import derive_seed
from brickhub.virtual.air import Air
from brickhub.virtual.link_radio import PLACEMENT_MS
from brickhub.virtual.virtual_transport import VirtualHub
from bricksrl.envs.arenas.arena_task import WHEELS, ArenaState, ArenaTask
from bricksrl.envs.arenas.simulated_air import SimulatedAir
from bricksrl.envs.connection import Reconnect
from bricksrl.envs.env_interface import BricksEnv
from bricksrl.envs.simulation import batch_shape, reseed, resolve_device
from bricksrl.envs.specs import NominalBounded, clamped, end_specs
from bricksrl.errors import BricksError, DescriptionError, HubError, StoppedError
from bricktwin.twin.mujoco_arena import ArenaWorld
from bricktwin.twin.physics import Physics

LAG = (0.2, 0.6)
"""Range of the share of a command that is carried out in the next step, as motors speed up; drawn
for each episode."""
NOISE = 0.03
"""Standard deviation of a wheel's travel, as a share of the largest command."""
MAX_DRAWS = 2000
"""Number of times that starts too near to one another are drawn again."""
MARGIN_M = 0.07
"""Least distance of a robot's middle from a wall."""


class GroupedEnv(BricksEnv, EnvBase):  # type: ignore[misc]
    """Several robots of a task, as a TorchRL environment with groups, in its multi-agent
    conventions.

    ==========================  =================  =======================================
    key                         shape              meaning
    ==========================  =================  =======================================
    ``(group, observation)``    ``[robots, n]``    of each robot of the group
    ``(group, action)``         ``[robots, m]``    in -1..1: of two wheels, then what it tells
    ``(group, reward)``         ``[robots, 1]``    of each robot
    ``terminated``, ...         ``[1]``            of the episode, as for one robot
    ``link_lost``               ``[1]``            the link to one of them broke in this step
    ``success``                 ``[1]``            of the task, in this state
    ==========================  =================  =======================================
    """

    task: ArenaTask  # type: ignore[assignment]

    def __init__(
        self,
        task: ArenaTask,
        copies: tuple[int, ...] = (),
        device: torch.device | None = None,
    ) -> None:
        super().__init__(batch_size=copies, device=device)
        self.task = task
        self.group_map = {group: list(names) for group, names in task.groups.items()}
        observations = {}
        actions = {}
        rewards = {}
        ends = [end for entry in task.entries for end in (entry.low, entry.high)]
        is_bounded = all(math.isfinite(end) for end in ends)
        for group, names in task.groups.items():
            shape = (*copies, len(names))
            if is_bounded:
                vector = NominalBounded.of(task.entries, shape, device)
            else:
                vector = Unbounded((*shape, len(task.entries)))
            observations[group] = Composite(observation=vector, shape=shape)
            action = Bounded(-1.0, 1.0, (*shape, task.action_size))
            actions[group] = Composite(action=action, shape=shape)
            rewards[group] = Composite(reward=Unbounded((*shape, 1)), shape=shape)
        flag = Binary(1, shape=(*copies, 1), dtype=torch.bool)
        self.observation_spec = Composite(
            **observations,
            link_lost=flag,
            success=flag.clone(),
            shape=copies,
            device=device,
        )
        self.action_spec = Composite(
            **actions,
            shape=copies,
            device=device,
        )
        self.reward_spec = Composite(
            **rewards,
            shape=copies,
            device=device,
        )
        self.done_spec = end_specs(copies, device)
        self._step_count = torch.zeros(
            *copies,
            1,
            dtype=torch.int64,
            device=device,
        )

    def _actions(self, tensordict: TensorDictBase) -> Tensor:
        """Actions ``[*batch, robots, m]`` in the arena's order, `clamped`."""
        task = self.task
        parts = [torch.empty(0)] * len(self.task.robots)
        for group, names in task.groups.items():
            shape = (*tensordict.batch_size, len(names), task.action_size)
            actions = clamped(tensordict[group, "action"], shape, f"{group} of {task.id}")
            # The robots of a group need not stand side by side in the arena.
            for index, action in zip(task.places(group), actions.unbind(-2), strict=True):
                parts[index] = action
        return torch.stack(parts, -2)

    def _outcome(
        self,
        before: ArenaState,
        state: ArenaState,
    ) -> TensorDictBase:
        """Output of a step between two states."""
        self._step_count += 1
        return self._frame(state, self.task.reward(before, state), self.task.terminated(state))

    def _frame(
        self,
        state: ArenaState,
        reward: Any = None,
        terminated: Any = None,
        *,
        is_lost: bool = False,
    ) -> TensorDictBase:
        """Output of a reset or, with the reward and the end of a step, of a step. Raises
        DescriptionError if a function of the task returns something else than a tensor of the right
        shape and type."""
        task = self.task
        batch = self.batch_size
        robots = len(task.robots)
        observation = self._checked(
            "observe",
            task.observe(state),
            robots,
            len(task.entries),
        )
        success = self._checked("success", task.success(state), 1)
        lost = torch.full((*batch, 1), is_lost, device=self.device)
        per_robot = {"observation": observation}
        flags = {"link_lost": lost, "success": success}
        if reward is not None:
            per_robot["reward"] = self._checked("reward", reward, robots, 1)
            terminated = self._checked("terminated", terminated, 1)
            truncated = lost | (self._step_count >= task.max_steps)
            flags |= {
                "terminated": terminated,
                "truncated": truncated,
                "done": terminated | truncated,
            }
        groups = {}
        for group, names in task.groups.items():
            places = task.places(group)
            values = {name: value[..., places, :] for name, value in per_robot.items()}
            groups[group] = TensorDict(values, (*batch, len(names)))
        return TensorDict({**flags, **groups}, batch, device=self.device)

    def _checked(
        self,
        name: str,
        value: Any,
        *shape: int,
    ) -> Tensor:
        """The checked result of a function of the task: flags ``[*batch, 1]``, or numbers of each
        robot ``[*batch, robots, n]``."""
        dtype = torch.bool if len(shape) == 1 else torch.float32
        shape = (*self.batch_size, *shape)
        if not isinstance(value, Tensor):
            given = f"{value!r:.40}"
        elif value.shape == shape and value.dtype == dtype:
            return value
        else:
            given = f"of shape {list(value.shape)} and {value.dtype}"
        raise DescriptionError(
            f"{name} of {self.task.id} is {given}; compute a tensor of shape {list(shape)} "
            f"and {dtype}"
        )


class ArenaEnv(GroupedEnv):
    """Virtual robots in one world: a step commands all hubs, then reads all.

    A broken link ends the episode for all: the step is truncated and marked ``link_lost``, all
    links are closed, so that all motors stop, and the next reset tries to open them again as set by
    ``reconnect``.

    Args:
        seed: seed of all random numbers; ``None`` for a different one each time.
        physics: physics of all robots.
        realtime: run in real time.
        deaf: whether no hub hears another.
    """

    reconnect: Reconnect

    def __init__(
        self,
        task: ArenaTask,
        *,
        seed: int | None = None,
        physics: Physics | None = None,
        realtime: bool = False,
        deaf: bool = False,
    ) -> None:
        super().__init__(task)
        self._deaf = deaf
        self._physics = physics
        self._realtime = realtime
        self._world: ArenaWorld | None = None
        self._hubs: list[VirtualHub] = []
        self._links: list[HubLink] = []
        self._state: ArenaState | None = None
        self.reconnect = Reconnect()
        spans = [
            [(command.low, command.high) for command in interface.commands]
            for interface in task.interfaces
        ]
        ranges = torch.tensor(spans)  # [robots, commands, ends]
        self._low = ranges[..., 0]
        self._high = ranges[..., 1]
        self._set_seed(seed)
        self.is_closed = False

    def _set_seed(self, seed: int | None) -> None:
        self._seed = seed
        place, world, drawn = np.random.SeedSequence(seed).spawn(3)
        self._place_rng = np.random.default_rng(place)
        self._drawn_rng = np.random.default_rng(drawn)
        self._world_seed = int(world.generate_state(1)[0])
        self._close_links()
        self._world = None

    @property
    def world(self) -> ArenaWorld:
        """World of the robots; `set_seed` replaces it."""
        if self._world is None:
            self._world = self._made_world()
        return self._world

    def _made_world(self) -> ArenaWorld:
        """A world, with a hub and a link of each of its robots."""
        world = ArenaWorld(self.task.arena, self._physics, self._world_seed)
        self._hubs = []
        self._links = []
        for number, body in enumerate(world.bodies):
            seed = derive_seed(self._world_seed, "link", number)
            hub = VirtualHub(body, realtime=self._realtime, seed=seed)
            # The host writes to all hubs at once, and not to each after another has answered.
            hub.waits_for_acknowledgement = False
            self._hubs.append(hub)
            self._links.append(HubLink(hub, body.robot, self.task.interfaces[number]))
        world.runners = [hub.run_on_until for hub in self._hubs]
        if not self._deaf:
            antennas = [hub.machine.antenna for hub in self._hubs]
            distance_m = functools.partial(_distance_m, world)
            air = Air(antennas, distance_m, derive_seed(self._world_seed, "air"))
            world.on_time.append(air.carry)
        return world

    @property
    def has_stopped(self) -> bool:
        return not any(hub.machine.is_driven for hub in self._hubs)

    def hub(self, robot: str) -> VirtualHub:
        """Hub of a robot, by its name."""
        assert self.world is not None  # noqa: S101  making it makes the hubs
        return self._hubs[self.task.robots.index(robot)]

    def _reset(
        self,
        _tensordict: TensorDictBase | None = None,
        **_kwargs: Any,
    ) -> TensorDictBase:
        return self._frame(self.reconnect.until_answered(self._begin))

    def _begin(self) -> ArenaState:
        world = self.world
        try:
            for link in self._links:
                link.open()
            now_ms = max(hub.machine.time_ms for hub in self._hubs)
            # Placing the robots by hand takes time, in which their programs go on.
            for hub in self._hubs:
                hub.run_on_until(now_ms + PLACEMENT_MS)
            world.place(self._place_rng)
            readings = self._first_readings()
        except (HubError, StoppedError):
            self._close_links()
            raise
        self._angles = self._wheels(readings)
        drawn = self._draw()
        if self.task.mark is not None:
            world.put_marks(self.task.mark(drawn).tolist())
        self._state = ArenaState(
            self._poses(),
            torch.zeros(len(self._links), WHEELS),
            self._heard(readings),
            drawn,
        )
        self._step_count.zero_()
        return self._state

    def _first_readings(self) -> list[Reading]:
        """Readings at the start of an episode."""
        if not self.task.told:
            return [link.read() for link in self._links]
        # The hubs still tell what they were told last, in another episode.
        return self._exchange([[0.0] * self.task.action_size] * len(self._links))

    def _exchange(self, commands: list[list[float]]) -> list[Reading]:
        """Readings after a step with these commands, ``[robots][commands]``."""
        # All robots are commanded before one is read, so that they move at the same time.
        for link, values in zip(self._links, commands, strict=True):
            link.send(values)
        return [link.receive() for link in self._links]

    def _draw(self) -> Tensor:
        """Numbers that are drawn at the start of an episode, ``[n]``."""
        drawn = [self._drawn_rng.uniform(low, high) for low, high in self.task.drawn]
        return torch.tensor(drawn, dtype=torch.float32)

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        before = self._state
        if before is None:
            raise BricksError(f"{self.task.id} has no episode to step; reset the environment first")
        actions = self._actions(tensordict)
        commands = self._low + (actions + 1.0) / 2.0 * (self._high - self._low)
        try:
            readings = self._exchange(commands.tolist())
        except HubError as error:
            # The last observation stands for all robots, and is truncated.
            self.link_error = error
            self.reconnect.failed(error)
            self._close_links()
            no_reward = torch.zeros(len(self._links), 1)
            not_terminated = torch.zeros(1, dtype=torch.bool)
            return self._frame(
                before,
                no_reward,
                not_terminated,
                is_lost=True,
            )
        except StoppedError:
            self._close_links()
            raise
        self.reconnect.recovered()
        angles = self._wheels(readings)
        # A wheel turns by less than half a turn in a step, which is why wrapped angles tell its
        # direction.
        turned_deg = (angles - self._angles + 180.0) % 360.0 - 180.0
        self._angles = angles
        self._state = ArenaState(
            self._poses(),
            turned_deg / self._high[:, :WHEELS],
            self._heard(readings),
            before.drawn,
        )
        return self._outcome(before, self._state)

    def _heard(self, readings: list[Reading]) -> Tensor:
        """What each robot has heard, ``[robots, n]``."""
        heard = []
        for reading, interface in zip(readings, self.task.interfaces, strict=True):
            pairs = zip(interface.channels, reading.values, strict=True)
            heard.append([value for channel, value in pairs if isinstance(channel, HeardNumber)])
        return torch.tensor(heard)

    def _wheels(self, readings: list[Reading]) -> Tensor:
        """Angles of the left and the right wheel, ``[robots, 2]``."""
        angles_deg = []
        for reading, interface in zip(readings, self.task.interfaces, strict=True):
            index = interface.angle_indices
            left_deg = reading.values[index["left"]]
            right_deg = reading.values[index["right"]]
            angles_deg.append([left_deg, right_deg])
        return torch.tensor(angles_deg)

    def _poses(self) -> Tensor:
        poses = []
        for pose in self.world.poses():
            # Headings are clockwise in the world, but counter-clockwise in a state.
            heading = -math.radians(pose.heading_deg)
            poses.append((pose.x_m, pose.y_m, heading))
        return torch.tensor(poses, dtype=torch.float32)

    def _close_links(self) -> None:
        self._state = None
        for link in self._links:
            link.close()

    def close(self, *, raise_if_closed: bool = True) -> None:
        """Stop all robots. May be called twice; a reset opens the links again."""
        super().close(raise_if_closed=raise_if_closed)
        self._close_links()


def _distance_m(
    world: ArenaWorld,
    one: int,
    other: int,
) -> float:
    """Distance of two robots."""
    here = world.bodies[one].pose()
    there = world.bodies[other].pose()
    return math.hypot(here.x_m - there.x_m, here.y_m - there.y_m)


class ArenaSimulation(GroupedEnv):
    """Copies ``[copies]`` of a task without loads; ``deaf``: whether no robot hears another. Raises
    DescriptionError if the task has no simulation, or ``copies`` is invalid; RunError if there is
    no such device."""

    def __init__(
        self,
        task: ArenaTask,
        copies: int,
        *,
        seed: int | None = None,
        device: torch.device | str = "cpu",
        deaf: bool = False,
    ) -> None:
        device = resolve_device(device)
        super().__init__(task, batch_shape(copies), device)
        travel_deg = []
        track_m = []
        radius_m = []
        for contestant, interface in zip(task.arena.robots, task.interfaces, strict=True):
            base = contestant.robot.drive_base
            if base is None or task.arena.loads:
                raise DescriptionError(
                    f"{task.id}: only robots with a drive base, and no loads, are simulated so"
                )
            travel_deg.append([command.high for command in interface.commands[:WHEELS]])
            track_m.append(base.axle_track_mm / 1000)
            radius_m.append(base.wheel_diameter_mm / 2000)
        travel = torch.deg2rad(torch.tensor(travel_deg, device=device))  # [robots, 2]
        self._way_m = travel * torch.tensor(radius_m, device=device)[:, None]
        self._track_m = torch.tensor(track_m, device=device)
        places = [contestant.place for contestant in task.arena.robots]
        ranges = [[place.x_m, place.y_m, place.heading_deg] for place in places]
        bounds = torch.tensor(ranges, device=device)  # [robots, 3, ends]
        # Headings are clockwise in a place, but counter-clockwise in a state.
        headings_deg = bounds[:, 2]
        bounds[:, 2] = -torch.deg2rad(headings_deg.flip(-1))
        self._low, self._high = bounds.unbind(-1)
        self._rng = torch.Generator(device=self.device)
        self._deaf = deaf
        self._air: SimulatedAir | None = None
        self._set_seed(seed)
        robots = len(task.robots)
        self._state = ArenaState(
            poses=torch.zeros(copies, robots, 3, device=device),
            moved=torch.zeros(copies, robots, WHEELS, device=device),
            heard=torch.zeros(copies, robots, task.heard_size, device=device),
            drawn=torch.zeros(copies, len(task.drawn), device=device),
        )
        self._lag = torch.zeros(copies, 1, 1, device=device)
        self._last_command = torch.zeros(
            copies,
            robots,
            WHEELS,
            device=device,
        )

    def _set_seed(self, seed: int | None) -> None:
        self._seed = seed
        reseed(self._rng, seed)
        if self.task.told and not self._deaf:
            self._air = SimulatedAir(
                copies=self.batch_size[0],
                robots=len(self.task.robots),
                told=self.task.told,
                step_ms=self.task.interfaces[0].settle.longest_ms,
                seed=self._rng.initial_seed(),
            )

    def _uniform(self, *shape: int) -> Tensor:
        return torch.rand(shape, generator=self._rng, device=self.device)

    def _starts(self, count: int) -> Tensor:
        """Poses ``[count, robots, 3]`` that keep the arena's gap. Raises TwinError if none are
        found."""
        poses = torch.empty(count, *self._low.shape, device=self.device)
        span = self._high - self._low
        # A robot's distance from itself is no gap, so a large number hides it.
        itself = 1e6 * torch.eye(poses.shape[1], device=self.device)
        near = torch.ones(count, dtype=torch.bool, device=self.device)
        for _ in range(MAX_DRAWS):
            # Only copies whose robots are too near to one another are drawn again.
            share = self._uniform(int(near.sum()), *self._low.shape)
            poses[near] = self._low + share * span
            places = poses[..., :2]
            distances = torch.cdist(places, places) + itself  # [count, robots, robots]
            near = distances.amin((-1, -2)) < self.task.arena.gap_m
            if not bool(near.any()):
                return poses
        raise self.task.arena.too_narrow()

    def _reset(
        self,
        tensordict: TensorDictBase | None = None,
        **_kwargs: Any,
    ) -> TensorDictBase:
        mask = None if tensordict is None else tensordict.get("_reset", None)
        if mask is None:
            is_reset = torch.ones(self.batch_size, dtype=torch.bool, device=self.device)
        else:
            is_reset = mask.squeeze(-1)
        if bool(is_reset.any()):
            self._start(is_reset)
        return self._frame(self._state)

    def _start(self, is_reset: Tensor) -> None:
        """Draw new starts, and a new lag, for copies; the state before is not changed."""
        count = int(is_reset.sum())
        poses = self._state.poses.clone()
        moved = self._state.moved.clone()
        poses[is_reset] = self._starts(count)
        moved[is_reset] = 0.0
        heard = self._state.heard.clone()
        if self._air is not None:
            heard[is_reset] = self._air.restart(is_reset)
        drawn = self._state.drawn.clone()
        for index, (low, high) in enumerate(self.task.drawn):
            drawn[is_reset, index] = low + (high - low) * self._uniform(count)
        self._state = ArenaState(
            poses,
            moved,
            heard,
            drawn,
        )
        self._last_command[is_reset] = 0.0
        low, high = LAG
        self._lag[is_reset] = low + (high - low) * self._uniform(count, 1, 1)
        self._step_count[is_reset] = 0

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        before = self._state
        actions, told = self._actions(tensordict).split((WHEELS, self.task.told), -1)
        noise = NOISE * torch.randn(actions.shape, generator=self._rng, device=self.device)
        # Motors need time to speed up, so a part of the last command is still carried out.
        moved = (1.0 - self._lag) * actions + self._lag * self._last_command + noise
        self._last_command = actions
        # Driving along the chord of an arc, which points to the middle of the two headings, ends in
        # the same place.
        left_m, right_m = (moved * self._way_m).unbind(-1)
        x, y, heading = before.poses.unbind(-1)
        turn = (right_m - left_m) / self._track_m
        forward = (left_m + right_m) / 2.0
        middle = heading + turn / 2.0
        x = x + forward * middle.cos()
        y = y + forward * middle.sin()
        if self.task.arena.half_size_m is not None:
            half_x, half_y = self.task.arena.half_size_m
            x = x.clamp(-half_x + MARGIN_M, half_x - MARGIN_M)
            y = y.clamp(-half_y + MARGIN_M, half_y - MARGIN_M)
        poses = torch.stack((x, y, heading + turn), -1)
        heard = before.heard if self._air is None else self._air.step(told)
        self._state = ArenaState(
            poses,
            moved,
            heard,
            before.drawn,
        )
        return self._outcome(before, self._state)
