"""The environment: one task, run over one link to a hub."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Binary, Bounded, Composite, Unbounded
from torchrl.envs import EnvBase

from bricksrl.envs.connection import Connection, Reconnect
from bricksrl.envs.dead_reckoning import TargetTracker, start_pose
from bricksrl.envs.env_interface import BricksEnv, Timing
from bricksrl.envs.episode import EpisodeState, observe, with_numbers, with_truth
from bricksrl.envs.specs import NominalBounded
from bricksrl.envs.stop_flag import StopFlag
from bricksrl.envs.task import Task, never
from bricksrl.envs.vision.camera import Camera
from bricksrl.envs.vision.watch import Watch
from bricksrl.errors import BricksError, CameraError, DescriptionError, HubError, HubProgramError, StoppedError

if TYPE_CHECKING:
    from brickhub.hub.link.lockstep import HubLink
    from brickhub.hub.link.reading import Reading
    from brickhub.virtual.virtual_transport import VirtualHub
    from bricksrl.envs.odometry import Odometer

BLOCKED_TIMEOUT_S = 120.0
"""Time that a blocked robot waits for the obstacle to be removed."""
PAUSE_PERIOD_S = 0.2
"""Period of the reads during a pause, which keep the hub program's watchdog from ending it."""

_log = logging.getLogger(__name__)

_T = TypeVar("_T")


class HubEnv(BricksEnv, EnvBase):  # type: ignore[misc]
    """A task on a robot, as a TorchRL environment without batch dimensions.

    ===============  =======  =======  =====================================================
    key              shape    dtype    meaning
    ===============  =======  =======  =====================================================
    ``observation``  ``[n]``  float32  channels in order, then the host's entries
    ``image``        below    uint8    only for a task with a camera: ``[side, side, 3]``
    ``action``       ``[m]``  float32  in -1..1, mapped linearly to the command ranges;
                                       values outside are clamped
    ``reward``       ``[1]``  float32  reward of the task
    ``terminated``   ``[1]``  bool     end defined by the task
    ``truncated``    ``[1]``  bool     time limit, pause or lost link
    ``done``         ``[1]``  bool     terminated or truncated
    ``link_lost``    ``[1]``  bool     the link broke in this step
    ===============  =======  =======  =====================================================

    A reset places the robot and reads its sensors; it moves no motor. The first reset opens the link. A link that breaks in a
    step raises nothing: the link is closed, so that the motors stop, and the step ends the episode as truncated and
    ``link_lost``, with the previous observation; it must not be learned from. The next reset reopens the link, with retries as
    ``reconnect`` says.

    ``stop``, ``pause`` and ``resume`` may be called from any thread. A pause truncates the episode after the current step, so
    that no step spans it; the next reset waits for the end of the pause.

    Args:
        task: the task to run.
        connect: returns the connection, given a seed for a virtual robot. Called when the robot is first needed, and for a
            virtual robot again after each new seed, so that it starts from the same state.
        seed: seed of all random numbers; ``None`` for a fresh one.
    """

    task: Task
    robots = 1
    reconnect: Reconnect

    def __init__(self, task: Task, connect: Callable[[int], Connection], *, seed: int | None = None) -> None:
        super().__init__(batch_size=())
        self.task = task
        self._connect = connect
        self._connection: Connection | None = None
        self._watchers: list[Callable[[Connection], None]] = []
        self._episode: EpisodeState | None = None
        self._spans = [((c.high + c.low) / 2, (c.high - c.low) / 2) for c in task.interface.commands]
        self._make_specs()
        self.reconnect = Reconnect()
        self._stop_flag = StopFlag()
        self._set_seed(seed)
        self.is_closed = False

    @property
    def twin(self) -> VirtualHub | None:
        return self._connected().twin

    def watch(self, watcher: Callable[[Connection], None]) -> Callable[[], None]:
        self._watchers.append(watcher)
        if self._connection is not None:
            watcher(self._connection)
        return lambda: self._watchers.remove(watcher)

    def close(self, *, raise_if_closed: bool = True) -> None:
        """Stop the robot and close the link. May be called twice; a reset opens the link again."""
        super().close(raise_if_closed=raise_if_closed)
        self._close_link()

    def stop(self) -> None:
        self._stop_flag.stop()
        if self._connection is not None:
            self._connection.link.emergency_stop()

    def pause(self) -> None:
        self._stop_flag.pause()

    def resume(self) -> None:
        if self._connection is not None:
            self._connection.link.release()
        self._stop_flag.go_on()

    @property
    def is_paused(self) -> bool:
        return self._stop_flag.is_paused

    @property
    def is_cut(self) -> bool:
        return self._episode is not None and self._episode.is_cut

    def _make_specs(self) -> None:
        self._entries, self._observed = len(self.task.entries), self.task.observed_channels
        vector = NominalBounded.of(self.task.entries)
        self.observation_spec = Composite(observation=vector, link_lost=Binary(1, dtype=torch.bool))
        camera = self.task.camera
        if camera is not None:
            image = Bounded(0, 255, shape=(camera.image_px, camera.image_px, 3), dtype=torch.uint8)
            self.observation_spec.set("image", image)
        self.action_spec = Bounded(-1.0, 1.0, shape=(len(self._spans),))
        self.reward_spec = Unbounded(shape=(1,))
        flag = Binary(1, dtype=torch.bool)
        self.done_spec = Composite(done=flag, terminated=flag.clone(), truncated=flag.clone())

    def _set_seed(self, seed: int | None) -> None:
        self._seed = seed
        host, place, twin = np.random.SeedSequence(seed).spawn(3)
        self._host_rng, self._place_rng = np.random.default_rng(host), np.random.default_rng(place)
        self._twin_seed = int(twin.generate_state(1)[0])
        if self._connection is not None and self._connection.twin is not None:
            self._close_link()
            self._connection = None

    def _reset(self, _tensordict: TensorDictBase | None = None, **_kwargs: Any) -> TensorDictBase:
        while True:
            self.reconnect.before_try()
            try:
                state = self._begin()
            except HubError as error:
                if isinstance(error, HubProgramError) and self._connected().twin is not None:
                    raise  # a virtual hub's program is deterministic: retrying would fail again
                self.reconnect.failed(error)
            else:
                self.reconnect.answered(to_step=False)
                return state

    def _begin(self) -> TensorDictBase:
        reading = self._guarded(self._start)
        measured_s = self._connected().link.now_s() - reading.age_s
        self.is_closed = False
        drawn = [entry.draw(self._host_rng) for entry in self.task.sampled_entries]
        commands = [0.0] * len(self.task.command_entries)
        measured = [0.0] * len(self.task.measured_entries) + commands
        tracker = self._tracker(reading)
        observation = observe(self._channels(reading), drawn, measured, tracker)
        self._odometer.start(self._connected().link.now_s())
        self._odometer.forward_mm(self._connected().link.now_s(), reading.values)
        out = {"observation": observation.clone(), "link_lost": torch.zeros(1, dtype=torch.bool)}
        watch = None
        if self.task.camera is not None:
            watch = Watch(self.task.camera, self._host_rng, self._guarded(self._camera.frame))
            observation = with_numbers(observation, watch)
            out["image"] = torch.from_numpy(watch.image)
        self._episode = EpisodeState(drawn, observation, measured_s, commands, watch=watch, tracker=tracker)
        return TensorDict(out, batch_size=(), device=self.device)

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        episode = self._episode
        try:
            out = self._act(tensordict)
        except HubError as error:
            if episode is None:
                raise
            self.link_error = error
            self.reconnect.failed(error)
            return self._lost(episode)
        self.reconnect.answered(to_step=True)
        return out

    def _lost(self, episode: EpisodeState) -> TensorDictBase:
        """The outcome of a step in which the link broke: the previous observation, truncated."""
        no, yes = torch.zeros(1, dtype=torch.bool), torch.ones(1, dtype=torch.bool)
        out = {"observation": episode.observation[: self._entries].clone(), "reward": torch.zeros(1), "terminated": no}
        if episode.watch is not None:
            out["image"] = torch.from_numpy(episode.watch.image)
        out |= {"truncated": yes, "done": yes.clone(), "link_lost": yes.clone()}
        return TensorDict(out, batch_size=(), device=self.device)

    def _act(self, tensordict: TensorDictBase) -> TensorDictBase:
        action = tensordict["action"].detach().cpu().clamp(-1.0, 1.0)  # a copy: the agent's tensor is not changed
        commands = self._commands(action)
        task, episode = self.task, self._episode
        if episode is None:
            raise BricksError(f"{task.id} has no episode to step; reset the environment first")
        link = self._connected().link
        self._wait_while_blocked(episode)
        episode.age_s = link.now_s() - episode.measured_s
        if task.observes_commands:
            episode.commands = commands
        observation = self._measure(self._guarded(lambda: link.act(commands)), episode)
        reward = _single(task, "reward", task.reward(episode.observation, action, observation))
        if not all(map(math.isfinite, reward.flatten().tolist())):
            raise DescriptionError(
                f"the reward of {task.id} is {reward.tolist()} in step {episode.step_count + 1}, where the observation is "
                f"{observation.tolist()}; correct the task's reward"
            )
        terminated = _single(task, "terminated", task.terminated(observation))
        if terminated.dtype is not torch.bool:
            raise DescriptionError(f"terminated of {task.id} is {terminated.tolist()}, not true or false; compare")
        episode.observation = observation
        episode.step_count += 1
        if self._stop_flag.is_paused:
            episode.is_cut = True
            self._guarded(link.rest)
        truncated = torch.full_like(terminated, episode.is_cut or episode.step_count >= task.max_steps)
        out = {
            "observation": observation.clone(),  # a caller's in-place change must not alter episode.observation
            "reward": reward,
            "terminated": terminated,
            "truncated": truncated,
            "done": terminated | truncated,
            "link_lost": torch.zeros(1, dtype=torch.bool),
        }
        if task.has_hidden_entries:
            episode.task_observations.append(with_truth(observation, episode.tracker, self._entries))
        if episode.watch is not None:
            out["observation"] = observation[: self._entries].clone()
            out["image"] = torch.from_numpy(episode.watch.image)
        return TensorDict(out, batch_size=(), device=self.device)

    def _step_proc_data(self, next_tensordict_out: TensorDictBase) -> TensorDictBase:
        """Skip TorchRL's completion of ``_step``'s output, unless a task's functions return shapes that it has to correct."""
        if next_tensordict_out.get("reward").shape == next_tensordict_out.get("terminated").shape == (1,):
            return next_tensordict_out
        return super()._step_proc_data(next_tensordict_out)

    def _wait_while_blocked(self, episode: EpisodeState) -> None:
        """Read without moving until the task is no longer blocked; reading feeds the hub's watchdog. Raises HubError if still
        blocked after two minutes."""
        if self.task.blocked is never or not self.task.blocked(episode.observation):
            return
        link = self._connected().link
        _log.warning("%s: something is in the robot's way; it waits until that is gone", self.task.id)
        waited_s = 0.0
        while bool(self.task.blocked(episode.observation)):
            if waited_s > BLOCKED_TIMEOUT_S:
                self._close_link()
                raise HubError(f"{self.task.id}: something is in the robot's way for {BLOCKED_TIMEOUT_S:g} s; clear it and go on")
            reading = self._guarded(link.read)
            waited_s += reading.round_trip_s
            episode.observation = self._measure(reading, episode)

    def _measure(self, reading: Reading, episode: EpisodeState) -> torch.Tensor:
        """The observation for the task's functions after a step; reads odometer and camera only where the task uses them."""
        episode.measured_s = self._connected().link.now_s() - reading.age_s
        episode.hub_time_s = reading.hub_time_ms / 1000
        forward_mm: list[float] = []
        if self.task.walks or self.task.measured_entries:
            forward_mm = [self._odometer.forward_mm(self._connected().link.now_s(), reading.values)]
        measured = [*forward_mm[: len(self.task.measured_entries)], *episode.commands]
        if episode.tracker is not None:
            episode.tracker.follow(reading.values)
        observation = observe(self._channels(reading), episode.drawn, measured, episode.tracker)
        if episode.watch is None:
            return observation
        episode.watch.see(self._guarded(self._camera.frame))
        return with_numbers(observation, episode.watch)

    def _channels(self, reading: Reading) -> list[float]:
        """The channels that are in the observation."""
        return [reading.values[index] for index in self._observed]

    def task_observations(self, observations: torch.Tensor) -> torch.Tensor:
        """Input of the task's success and metrics for the observations ``[steps, n]`` of the whole current episode. Raises
        BricksError if the number of observations is not that of the current episode's steps.

        These are the observations; where the task's camera has a goal, with the camera's two distances appended; where the task
        has a target, with the true pose of a virtual robot.
        """
        if not self.task.has_hidden_entries:
            return observations
        stored = self._episode.task_observations if self._episode is not None else []
        if len(stored) != len(observations):
            raise BricksError(f"{self.task.id} judges an episode before the next reset, and not {len(observations)} other steps")
        return torch.stack(stored)

    @property
    def timing(self) -> Timing:
        if self._episode is None or not self._episode.step_count:
            raise BricksError(f"{self.task.id} has made no step yet; make one first")
        return Timing(self._episode.age_s, self._episode.hub_time_s)

    def walk_metrics(self) -> dict[str, float]:
        if self._episode is None:
            return {}
        tracker = self._episode.tracker
        return {**(self._odometer.metrics() if self.task.walks else {}), **({} if tracker is None else tracker.metrics())}

    def _tracker(self, reading: Reading) -> TargetTracker | None:
        """The tracker of the task's target for the new episode; ``None`` for a task without one."""
        task, twin = self.task, self._connected().twin
        if task.target is None:
            return None
        true_pose = None if twin is None else getattr(twin.body, "pose", None)
        start = start_pose(task.scene, task.id, true_pose, self._host_rng)
        return TargetTracker(task.target, task.robot, task.interface, true_pose, start, reading.values)

    @property
    def _camera(self) -> Camera:
        camera = self._connected().camera
        if camera is None:
            raise CameraError(f"{self.task.id} needs a camera, and the connection to the robot has none; give it one")
        return camera

    @property
    def _odometer(self) -> Odometer:
        return self._connected().odometer

    def _connected(self) -> Connection:
        if self._connection is None:
            self._connection = self._connect(self._twin_seed)
            for watcher in self._watchers:
                watcher(self._connection)
            if self._connection.twin is not None:
                self._connection.twin.in_reach = self.in_reach
            self._stop_flag.check()  # a stop requested before this had no link to act on
        return self._connection

    def _start(self) -> Reading:
        connection = self._connected()
        self._hold_still(connection.link)
        connection.link.open()  # without effect when it is open
        connection.place(self._place_rng)
        return connection.link.read()

    def _hold_still(self, link: HubLink) -> None:
        """Wait for the end of a pause; reading feeds the hub program's watchdog."""
        while not self._stop_flag.wait(PAUSE_PERIOD_S):
            if link.is_open:
                link.read()
        self._stop_flag.check()

    def _guarded(self, exchange: Callable[[], _T]) -> _T:
        """Run an exchange with hub or camera; on failure close the link: the motors stop, and the next reset reopens it."""
        try:
            return exchange()
        except (HubError, CameraError, StoppedError):
            self._close_link()
            raise

    def _close_link(self) -> None:
        self._episode = None
        if self._connection is not None:
            self._connection.link.close()
            if self._connection.camera is not None:
                self._connection.camera.close()

    def _commands(self, action: torch.Tensor) -> list[float]:
        if action.shape != (len(self._spans),):
            raise BricksError(f"{self.task.id} got an action of shape {list(action.shape)}; give [{len(self._spans)}]")
        return [middle + half * value for (middle, half), value in zip(self._spans, action.tolist(), strict=True)]


def _single(task: Task, name: str, value: Any) -> torch.Tensor:
    """What a function of a task returns for one observation. Raises DescriptionError unless it is a tensor with one number."""
    if not isinstance(value, torch.Tensor) or value.numel() != 1:
        given = f"of shape {list(value.shape)}" if isinstance(value, torch.Tensor) else repr(value)
        raise DescriptionError(f"{name} of {task.id} is {given}; compute a tensor of shape [1] from the observation")
    return value
