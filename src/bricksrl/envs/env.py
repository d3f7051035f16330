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
from bricksrl.envs.episode import EpisodeState, Timing, observe, with_numbers, with_truth
from bricksrl.envs.specs import NominalBounded
from bricksrl.envs.stop_flag import StopFlag
from bricksrl.envs.task import Task, never
from bricksrl.envs.vision.camera import Camera, Watch
from bricksrl.errors import BricksError, CameraError, DescriptionError, HubError, HubProgramError, StoppedError

if TYPE_CHECKING:
    from bricksrl.envs.odometry import Odometer
    from bricksrl.hub.link.lockstep import HubLink
    from bricksrl.hub.link.reading import Reading
    from bricksrl.virtual_hub.transport import VirtualHub

BLOCKED_TIMEOUT_S = 120.0
"""How long a robot waits for its way to be cleared."""
PAUSE_PERIOD_S = 0.2
"""How often a robot that holds still hears from us, so that the program on its hub goes on."""

_log = logging.getLogger(__name__)

_T = TypeVar("_T")


class HubEnv(EnvBase):  # type: ignore[misc]
    """A task on a robot, as a TorchRL environment without batch dimensions.

    ===============  =======  =======  =====================================================
    key              shape    dtype    meaning
    ===============  =======  =======  =====================================================
    ``observation``  ``[n]``  float32  channels in their order, then the host's entries
    ``image``        below    uint8    only for a task with a camera: ``[side, side, 3]``
    ``action``       ``[m]``  float32  in -1..1, mapped linearly to the command ranges;
                                       what lies beyond is clamped
    ``reward``       ``[1]``  float32  the task's
    ``terminated``   ``[1]``  bool     the task's own end
    ``truncated``    ``[1]``  bool     the time limit
    ``done``         ``[1]``  bool     either
    ``link_lost``    ``[1]``  bool     the link broke in this step
    ===============  =======  =======  =====================================================

    A reset places the robot, reads its sensors and moves nothing. The first reset opens the link. A link that breaks in a step is
    data: the link is closed, so that the motors stop, and the step ends the episode as truncated and marked ``link_lost``; it
    shows what was seen before, and is nothing to learn from. The next reset opens the link again, and tries for as long as
    ``reconnect`` says.

    ``in_reach`` of a virtual robot may be set before the first reset: as long as it returns False the link is broken.

    ``stop``, ``pause`` and ``resume`` may be called from any thread. A pause ends the episode after the step at hand, as
    truncated, so that no step reaches across it; the next reset waits for the end of the pause.

    Args:
        task: what is to be learned.
        connect: gives the robot. It gets a seed, for a virtual one, and is called when the robot is first needed; for a
            virtual robot again after each new seed, so that it starts from the same state.
        seed: of everything random; ``None`` for another one every time.
    """

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
        self.in_reach: Callable[[], bool] = lambda: True
        self.link_error: HubError | None = None
        self._stop_flag = StopFlag()
        self._set_seed(seed)
        self.is_closed = False

    @property
    def twin(self) -> VirtualHub | None:
        """The virtual hub; ``None`` where the robot is real. A new seed brings a new one."""
        return self._robot().twin

    def watch(self, watcher: Callable[[Connection], None]) -> Callable[[], None]:
        """Have a function told each robot of this environment, the one at hand included; a new seed brings a new virtual one.

        Returns:
            What ends that.
        """
        self._watchers.append(watcher)
        if self._connection is not None:
            watcher(self._connection)
        return lambda: self._watchers.remove(watcher)

    def close(self, *, raise_if_closed: bool = True) -> None:
        """Stop the robot and let go of the hub. May be called twice; a reset opens the link again."""
        super().close(raise_if_closed=raise_if_closed)
        self._close_link()

    def stop(self) -> None:
        """Stop motors and program at once, in the middle of a step too; step and reset raise StoppedError until `resume`.

        Raises:
            HubError: the hub could not be told; its watchdog then stops the motors.
        """
        self._stop_flag.stop()
        if self._connection is not None:
            self._connection.link.emergency_stop()

    def pause(self) -> None:
        """Have the robot hold still from the end of the step at hand on, until `resume`."""
        self._stop_flag.pause()

    def resume(self) -> None:
        """After `pause` or `stop`: the robot may move again, with the next reset."""
        if self._connection is not None:
            self._connection.link.release()
        self._stop_flag.go_on()

    @property
    def is_paused(self) -> bool:
        """True if the robot is to hold still."""
        return self._stop_flag.is_paused

    @property
    def is_cut(self) -> bool:
        """True if a pause ended the episode at hand."""
        return self._episode is not None and self._episode.is_cut

    def _make_specs(self) -> None:
        self._entries, self._observed = len(self.task.entries), list(self.task.observed_channels)
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
                if isinstance(error, HubProgramError) and self._robot().twin is not None:
                    raise  # the program of a virtual hub does the same every time
                self.reconnect.failed(error)
            else:
                self.reconnect.answered(to_step=False)
                return state

    def _begin(self) -> TensorDictBase:
        reading = self._guarded(self._start)
        measured_s = self._robot().link.now_s() - reading.age_s
        self.is_closed = False
        drawn = np.array([entry.draw(self._host_rng) for entry in self.task.sampled_entries], dtype=np.float32)
        measured = np.zeros(len(self.task.measured_entries), dtype=np.float32)
        tracker = self._tracker(reading)
        observation = observe(reading.values[self._observed], drawn, measured, tracker)
        self._odometer.start(self._robot().link.now_s())
        self._odometer.forward_mm(self._robot().link.now_s(), reading.values)
        out = {"observation": observation.clone(), "link_lost": torch.zeros(1, dtype=torch.bool)}
        watch = None
        if self.task.camera is not None:
            watch = Watch(self.task.camera, self._host_rng, self._guarded(self._camera.frame))
            observation = with_numbers(observation, watch)
            out["image"] = torch.from_numpy(watch.image)
        self._episode = EpisodeState(drawn, observation, measured_s, watch=watch, tracker=tracker)
        return TensorDict(out, batch_size=())

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
        """The outcome of a step in which the link broke: nothing new, and the end of the episode."""
        no, yes = torch.zeros(1, dtype=torch.bool), torch.ones(1, dtype=torch.bool)
        out = {"observation": episode.observation[: self._entries].clone(), "reward": torch.zeros(1), "terminated": no}
        if episode.watch is not None:
            out["image"] = torch.from_numpy(episode.watch.image)
        return TensorDict({**out, "truncated": yes, "done": yes.clone(), "link_lost": yes.clone()}, batch_size=())

    def _act(self, tensordict: TensorDictBase) -> TensorDictBase:
        action = tensordict.get("action").detach().clamp(-1.0, 1.0)  # a copy: the agent's own tensor stays as it is
        commands = self._commands(action)
        task, episode = self.task, self._episode
        if episode is None:
            raise BricksError(f"{task.id} has no episode to step; reset the environment first")
        link = self._robot().link
        self._wait_while_blocked(episode)
        episode.age_s = link.now_s() - episode.measured_s
        observation = self._measure(self._guarded(lambda: link.act(commands)), episode)
        reward = task.reward(episode.observation, action, observation)
        if not all(map(math.isfinite, reward.flatten().tolist())):
            raise DescriptionError(
                f"the reward of {task.id} is {reward.tolist()} in step {episode.step_count + 1}, where the observation is "
                f"{observation.tolist()}; correct the task's reward"
            )
        terminated = task.terminated(observation)
        episode.observation = observation
        episode.step_count += 1
        if self._stop_flag.is_paused:
            episode.is_cut = True
            self._guarded(link.rest)
        truncated = torch.full_like(terminated, episode.is_cut or episode.step_count >= task.max_steps)
        out = {
            "observation": observation.clone(),  # whoever changes it in place does not change our previous one
            "reward": reward,
            "terminated": terminated,
            "truncated": truncated,
            "done": terminated | truncated,
            "link_lost": torch.zeros(1, dtype=torch.bool),
        }
        if task.is_judged_by_more:
            episode.judged.append(with_truth(observation, episode.tracker, self._entries))
        if episode.watch is not None:
            out["observation"] = observation[: self._entries].clone()
            out["image"] = torch.from_numpy(episode.watch.image)
        return TensorDict(out, batch_size=())

    def _step_proc_data(self, next_tensordict_out: TensorDictBase) -> TensorDictBase:
        """``_step`` leaves nothing to complete; where a task's own functions give other shapes, TorchRL puts them right."""
        if next_tensordict_out.get("reward").shape == next_tensordict_out.get("terminated").shape == (1,):
            return next_tensordict_out
        return super()._step_proc_data(next_tensordict_out)

    def _wait_while_blocked(self, episode: EpisodeState) -> None:
        """Read on, without moving, until nothing is in the way; reading keeps the hub from letting go of its motors.

        Raises:
            HubError: it is still there after two minutes.
        """
        if self.task.blocked is never or not self.task.blocked(episode.observation):
            return
        link = self._robot().link
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
        """What the task's functions get after a step; asks odometer and camera only where somebody wants to know."""
        episode.measured_s = self._robot().link.now_s() - reading.age_s
        episode.hub_time_s = reading.hub_time_ms / 1000
        forward_mm: list[float] = []
        if self.task.walks or self.task.measured_entries:
            forward_mm = [self._odometer.forward_mm(self._robot().link.now_s(), reading.values)]
        measured = np.array(forward_mm[: len(self.task.measured_entries)], dtype=np.float32)
        if episode.tracker is not None:
            episode.tracker.follow(reading.values)
        observation = observe(reading.values[self._observed], episode.drawn, measured, episode.tracker)
        if episode.watch is None:
            return observation
        episode.watch.see(self._guarded(self._camera.frame))
        return with_numbers(observation, episode.watch)

    def judged(self, observations: torch.Tensor) -> torch.Tensor:
        """What the task's success and metrics get for these observations ``[steps, n]`` of the episode at hand, of all its steps.

        It is the observations themselves, but what the camera found is added where it has a goal, and where a task's target is
        from a virtual robot is the truth.

        Raises:
            BricksError: the observations are those of another episode.
        """
        if not self.task.is_judged_by_more:
            return observations
        judged = self._episode.judged if self._episode is not None else []
        if len(judged) != len(observations):
            raise BricksError(f"{self.task.id} judges an episode before the next reset, and not {len(observations)} other steps")
        return torch.stack(judged)

    @property
    def timing(self) -> Timing:
        """Times of the last step.

        Raises:
            BricksError: none was made.
        """
        if self._episode is None or not self._episode.step_count:
            raise BricksError(f"{self.task.id} has made no step yet; make one first")
        return Timing(self._episode.age_s, self._episode.hub_time_s)

    def walk_metrics(self) -> dict[str, float]:
        """What only a virtual robot tells of this episode: its way, speed and straightness; the errors of its reckoning."""
        if self._episode is None:
            return {}
        tracker = self._episode.tracker
        return {**(self._odometer.metrics() if self.task.walks else {}), **({} if tracker is None else tracker.metrics())}

    def _tracker(self, reading: Reading) -> TargetTracker | None:
        """Whoever follows the way to the task's target in the episode that begins."""
        task, twin = self.task, self._robot().twin
        if task.target is None:
            return None
        true_pose = None if twin is None else getattr(twin.body, "pose", None)
        start = start_pose(task, true_pose, self._host_rng)
        return TargetTracker(task.target, task.robot, task.interface, true_pose, start, reading.values)

    @property
    def _camera(self) -> Camera:
        camera = self._robot().camera
        if camera is None:
            raise CameraError(f"{self.task.id} needs a camera, and the connection to the robot has none; give it one")
        return camera

    @property
    def _odometer(self) -> Odometer:
        return self._robot().odometer

    def _robot(self) -> Connection:
        if self._connection is None:
            self._connection = self._connect(self._twin_seed)
            for watcher in self._watchers:
                watcher(self._connection)
            if self._connection.twin is not None:
                self._connection.twin.in_reach = self.in_reach
            self._stop_flag.check()  # whoever wanted to stop the robot did not find it yet
        return self._connection

    def _start(self) -> Reading:
        robot = self._robot()
        self._hold_still(robot.link)
        robot.link.open()  # without effect when it is open
        robot.place(self._place_rng)
        return robot.link.read()

    def _hold_still(self, link: HubLink) -> None:
        """Wait for the end of a pause; reading keeps the program on the hub from ending."""
        while not self._stop_flag.wait(PAUSE_PERIOD_S):
            if link.is_open:
                link.read()
        self._stop_flag.check()

    def _guarded(self, exchange: Callable[[], _T]) -> _T:
        """Talk to hub or camera; when that fails, close the link, so that the motors stop and the next reset starts afresh."""
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
