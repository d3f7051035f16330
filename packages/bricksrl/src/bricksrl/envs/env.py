"""The environment: one task, run over one link to a hub."""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Binary, Bounded
from torchrl.envs import EnvBase

from bricksrl.envs.connection import Connection, Reconnect
from bricksrl.envs.env_interface import BricksEnv, Timing
from bricksrl.envs.odometry import Odometer, SonarOdometer, TargetTracker, TrueOdometer, start_pose
from bricksrl.envs.specs import set_vector_specs
from bricksrl.envs.task import Task, never
from bricksrl.envs.vision.camera import Camera, Watch
from bricksrl.errors import BricksError, CameraError, DescriptionError, HubError, HubProgramError, StoppedError

if TYPE_CHECKING:
    from brickhub.hub.link.receiver import Reading
    from brickhub.virtual.virtual_transport import VirtualHub

BLOCKED_TIMEOUT_S = 120.0
"""Time that a blocked robot waits for the obstacle to be removed."""
PAUSE_PERIOD_S = 0.2
"""Period of the reads during a pause, which keep the hub program's watchdog from ending it."""

_log = logging.getLogger(__name__)

_T = TypeVar("_T")


@dataclass(slots=True)
class EpisodeState:
    """State that changes every step; not in the environment, where each attribute assignment costs ten microseconds.

    Attributes:
        drawn: sampled entries, constant for the episode.
        commands: the last ones, where they are observed.
        odometer: measures the distance travelled.
        tracker: position of the target; ``None`` for a task without a target.
        watch: the camera's view; ``None`` for a task without a camera.
        observation: the last one, as the task's functions get it.
        task_observations: what success and metrics get after each step; only with a camera or a target.
        is_cut: whether a pause truncated the episode.
        measured_s: the link's clock when the last observation was measured; ``hub_time_s`` is the hub's.
        age_s: age of the observation that the last action was chosen for.
    """

    drawn: list[float]
    commands: list[float]
    measured_s: float
    odometer: Odometer
    tracker: TargetTracker | None
    watch: Watch | None = None
    observation: torch.Tensor = field(default_factory=lambda: torch.empty(0))
    step_count: int = 0
    task_observations: list[torch.Tensor] = field(default_factory=list)
    is_cut: bool = False
    hub_time_s: float = 0.0
    age_s: float = 0.0

    def observe(self, channels: Sequence[float], forward_mm: Sequence[float]) -> torch.Tensor:
        """The observation ``[n]`` as the task's functions get it: channels, sampled entries, distance forward, last commands, the
        target's entries and the camera's distances."""
        target = () if self.tracker is None else self.tracker.entries()
        distances_px = () if self.watch is None else self.watch.numbers()
        values = (*channels, *self.drawn, *forward_mm, *self.commands, *target, *distances_px)
        return torch.from_numpy(np.array(values, dtype=np.float32))

    def with_truth(self, observation: torch.Tensor, end: int) -> torch.Tensor:
        """The observation with the target's entries, which end at index ``end``, replaced by their true values."""
        if self.tracker is None:
            return observation
        truth = torch.tensor(self.tracker.truth(), dtype=observation.dtype)
        return torch.cat((observation[: end - len(truth)], truth, observation[end:]))


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
        self._entries, self._observed = len(task.entries), task.observed_channels
        set_vector_specs(self, task)
        self.observation_spec["link_lost"] = Binary(1, dtype=torch.bool)
        for key, side_px in task.images.items():
            self.observation_spec[key] = Bounded(0, 255, (side_px, side_px, 3), dtype=torch.uint8)
        self._images: dict[str, torch.Tensor] = {}  # the last ones of sensors
        self.reconnect = Reconnect()
        self._changed = threading.Condition()
        self._is_stopped = self._is_paused = False
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
        with self._changed:
            self._is_stopped = True
            self._changed.notify_all()
        if self._connection is not None:
            self._connection.link.emergency_stop()

    def pause(self) -> None:
        with self._changed:
            self._is_paused = True

    def resume(self) -> None:
        if self._connection is not None:
            self._connection.link.release()
        with self._changed:
            self._is_stopped = self._is_paused = False
            self._changed.notify_all()

    @property
    def is_paused(self) -> bool:
        return self._is_paused

    @property
    def is_cut(self) -> bool:
        return self._episode is not None and self._episode.is_cut

    def _set_seed(self, seed: int | None) -> None:
        self._seed = seed
        host, place, twin = np.random.SeedSequence(seed).spawn(3)
        self._host_rng, self._place_rng = np.random.default_rng(host), np.random.default_rng(place)
        self._twin_seed = int(twin.generate_state(1)[0])
        if self._connection is not None and self._connection.twin is not None:
            self._close_link()
            self._connection = None

    def _reset(self, _tensordict: TensorDictBase | None = None, **_kwargs: Any) -> TensorDictBase:
        return self.reconnect.until_answered(
            self._begin,
            # A virtual hub's program is deterministic: retrying would fail again.
            is_final=lambda error: isinstance(error, HubProgramError) and self.twin is not None,
        )

    def _begin(self) -> TensorDictBase:
        reading = self._guarded(self._start)
        link, true_pose, task = self._connected().link, self._connected().true_pose, self.task
        measured_s = link.now_s() - reading.age_s
        self.is_closed = False
        drawn, tracker = [entry.draw(self._host_rng) for entry in task.sampled_entries], None
        if task.target is not None:
            start = start_pose(task.scene, task.id, true_pose, self._host_rng)
            tracker = TargetTracker(task.target, task.robot, task.interface, true_pose, start, reading.values)
        odometer = SonarOdometer(task.interface) if true_pose is None else TrueOdometer(true_pose, link.now_s())
        odometer.forward_mm(link.now_s(), reading.values)
        episode = EpisodeState(drawn, [0.0] * len(task.command_entries), measured_s, odometer, tracker)
        if task.camera is not None:
            episode.watch = Watch(task.camera, self._host_rng, self._guarded(self._camera.frame))
        self._episode = episode
        episode.observation = self._observation_at_start(episode, reading)
        return self._out(episode)

    def _observation_at_start(self, episode: EpisodeState, reading: Reading) -> torch.Tensor:
        """Hook: the first observation of an episode."""
        return episode.observe(self._channels(reading), [0.0] * len(self.task.measured_entries))

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        episode = self._episode
        try:
            out = self._act(tensordict)
        except HubError as error:
            if episode is None:
                raise
            self.link_error = error
            self.reconnect.failed(error)
            no, yes = torch.zeros(1, dtype=torch.bool), torch.ones(1, dtype=torch.bool)
            ends = {"terminated": no, "truncated": yes, "done": yes.clone(), "link_lost": yes.clone()}
            return self._out(episode, reward=torch.zeros(1), **ends)
        self.reconnect.recovered()
        return out

    def _act(self, tensordict: TensorDictBase) -> TensorDictBase:
        action = tensordict["action"].detach().cpu().clamp(-1.0, 1.0)  # a copy: the agent's tensor is not changed
        task, episode = self.task, self._episode
        if action.shape != (len(self._spans),):
            raise BricksError(f"{task.id} got an action of shape {list(action.shape)}; give [{len(self._spans)}]")
        commands = [middle + half * value for (middle, half), value in zip(self._spans, action.tolist(), strict=True)]
        if episode is None:
            raise BricksError(f"{task.id} has no episode to step; reset the environment first")
        link = self._connected().link
        self._wait_while_blocked(episode)
        episode.age_s = link.now_s() - episode.measured_s
        if task.observes_commands:
            episode.commands = commands
        observation, reward, terminated = self._outcome(episode, action, commands)
        if not all(map(math.isfinite, reward.flatten().tolist())):
            raise DescriptionError(
                f"the reward of {task.id} is {reward.tolist()} in step {episode.step_count + 1}, where the observation is "
                f"{observation.tolist()}; correct the task's reward"
            )
        if terminated.dtype is not torch.bool:
            raise DescriptionError(f"terminated of {task.id} is {terminated.tolist()}, not true or false; compare")
        episode.observation = observation
        episode.step_count += 1
        if self._is_paused:
            episode.is_cut = True
            self._guarded(link.rest)
        truncated = torch.full_like(terminated, episode.is_cut or episode.step_count >= task.max_steps)
        if task.has_hidden_entries:
            episode.task_observations.append(episode.with_truth(observation, self._entries))
        return self._out(episode, reward=reward, terminated=terminated, truncated=truncated, done=terminated | truncated)

    def _outcome(
        self, episode: EpisodeState, action: torch.Tensor, commands: list[float]
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Hook: carry out the commands; the observation after it, the reward and whether the episode is over."""
        task = self.task
        observation = self._measure(self._guarded(lambda: self._connected().link.act(commands)), episode)
        reward = _single(task, "reward", task.reward(episode.observation, action, observation))
        return observation, reward, _single(task, "terminated", task.terminated(observation))

    def _out(self, episode: EpisodeState, **outcome: torch.Tensor) -> TensorDictBase:
        """Output of a reset or, with its outcome, of a step; copied, as a caller's change must not alter ``episode``."""
        out = {"observation": episode.observation[: self._entries].clone(), "link_lost": torch.zeros(1, dtype=torch.bool)}
        out |= self._images
        if episode.watch is not None:
            out["image"] = torch.from_numpy(episode.watch.image)
        return TensorDict({**out, **outcome}, batch_size=(), device=self.device)

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
            forward_mm = [episode.odometer.forward_mm(self._connected().link.now_s(), reading.values)]
        if episode.tracker is not None:
            episode.tracker.follow(reading.values)
        if episode.watch is not None:
            episode.watch.see(self._guarded(self._camera.frame))
        return episode.observe(self._channels(reading), forward_mm[: len(self.task.measured_entries)])

    def _channels(self, reading: Reading) -> list[float]:
        """The channels that are in the observation, and the readings of sensors on the computer; notes their images."""
        values = [reading.values[index] for index in self._observed]
        for reader in self._connected().sensors:
            sensor, (sensed, age_s) = reader.sensor, self._guarded(reader.latest)
            if sensor.image_px:
                self._images[sensor.name] = torch.tensor(sensed)
            values += [*(() if sensor.image_px else sensed), *((age_s,) if sensor.observes_age else ())]
        return values

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
        walked = self._episode.odometer.metrics() if self.task.walks else {}
        return walked if self._episode.tracker is None else {**walked, **self._episode.tracker.metrics()}

    @property
    def _camera(self) -> Camera:
        camera = self._connected().camera
        if camera is None:
            raise CameraError(f"{self.task.id} needs a camera, and the connection to the robot has none; give it one")
        return camera

    def _connected(self) -> Connection:
        if self._connection is None:
            self._connection = self._connect(self._twin_seed)
            for watcher in self._watchers:
                watcher(self._connection)
            if self._connection.twin is not None:
                self._connection.twin.in_reach = self.in_reach
            self._check_stop()  # a stop requested before this had no link to act on
        return self._connection

    def _start(self) -> Reading:
        """Place the robot and read its sensors, after the end of a pause, in which reading feeds the hub program's watchdog."""
        connection = self._connected()
        while not self._waited(PAUSE_PERIOD_S):
            if connection.link.is_open:
                connection.link.read()
        self._check_stop()
        connection.link.open()  # without effect when it is open
        for reader in connection.sensors:
            reader.open()
        connection.place(self._place_rng)
        return connection.link.read()

    def _waited(self, timeout_s: float) -> bool:
        """Wait for the end of a pause, or a stop; True if there is no pause or there is a stop."""
        with self._changed:
            return self._changed.wait_for(lambda: self._is_stopped or not self._is_paused, timeout_s)

    def _check_stop(self) -> None:
        """Raise StoppedError if a stop is requested."""
        if self._is_stopped:
            raise StoppedError("the robot was stopped by hand; call resume() when it may move again")

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
            for reader in self._connection.sensors:
                reader.close()
            if self._connection.camera is not None:
                self._connection.camera.close()


def _single(task: Task, name: str, value: Any) -> torch.Tensor:
    """What a function of a task returns for one observation. Raises DescriptionError unless it is a tensor with one number."""
    if not isinstance(value, torch.Tensor) or value.numel() != 1:
        given = f"of shape {list(value.shape)}" if isinstance(value, torch.Tensor) else repr(value)
        raise DescriptionError(f"{name} of {task.id} is {given}; compute a tensor of shape [1] from the observation")
    return value
