"""The environment: one task, run over one link to a hub."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Binary, Bounded, Composite, Unbounded
from torchrl.envs import EnvBase

from bricksrl.envs.camera import Camera, Watch
from bricksrl.envs.nominal import NominalBounded
from bricksrl.envs.odometer import Odometer
from bricksrl.envs.task import Task, never
from bricksrl.envs.wish import Wish
from bricksrl.errors import BricksError, CameraError, HubError, StoppedError

if TYPE_CHECKING:
    from bricksrl.hub.link import HubLink
    from bricksrl.hub.reading import Reading
    from bricksrl.twin.virtual_hub import VirtualHub

BLOCKED_TIMEOUT_S = 120.0
"""How long a robot waits for its way to be cleared."""
PAUSE_PERIOD_S = 0.2
"""How often a robot that holds still hears from us, so that the program on its hub goes on."""

_log = logging.getLogger(__name__)

_T = TypeVar("_T")

Placement = Callable[[np.random.Generator], None]
"""Puts the robot where an episode starts. For a virtual robot a method, for a real one a hand."""


@dataclass(frozen=True)
class Connection:
    """A robot within reach.

    Attributes:
        link: to its hub; the environment opens and closes it.
        place: puts it where an episode starts, at every reset, while the link is open.
        odometer: tells how far it gets.
        twin: the virtual hub at the other end, for rendering; ``None`` where the robot is real.
        camera: what looks at it, for a task with a camera.
    """

    link: HubLink
    place: Placement
    odometer: Odometer
    twin: VirtualHub | None = None
    camera: Camera | None = None


@dataclass(frozen=True)
class Timing:
    """When a step happened.

    Attributes:
        age_s: how old the observation was that the action answered, when the action left.
        hub_time_s: the hub's clock when it measured the observation that followed.
    """

    age_s: float
    hub_time_s: float


@dataclass(slots=True)
class _Episode:
    """What changes from step to step; apart from the environment, where every assignment costs ten microseconds.

    Attributes:
        observation: the last one, as the task's functions get it.
        watch: what the camera shows; ``None`` for a task without one.
        judged: every observation that followed a step, as the task's functions get it; only where there is a camera.
        is_cut: whether a pause ended the episode.
        measured_s: the link's clock when the last observation was measured; ``hub_time_s`` the hub's.
        age_s: of the observation that the last action answered.
    """

    drawn: NDArray[np.float32]
    observation: torch.Tensor
    measured_s: float
    step_count: int = 0
    watch: Watch | None = None
    judged: list[torch.Tensor] = field(default_factory=list)
    is_cut: bool = False
    hub_time_s: float = 0.0
    age_s: float = 0.0


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
    ===============  =======  =======  =====================================================

    A reset places the robot, reads its sensors and moves nothing. The first reset opens the link. Errors of the link pass
    through; the link is then closed, so that the motors stop, and the next reset opens it again.

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
        self._episode: _Episode | None = None
        self._spans = [((c.high + c.low) / 2, (c.high - c.low) / 2) for c in task.interface.commands]
        self._make_specs()
        self._wish = Wish()
        self._set_seed(seed)
        self.is_closed = False

    @property
    def twin(self) -> VirtualHub | None:
        """The virtual hub; ``None`` where the robot is real. A new seed brings a new one."""
        return self._robot().twin

    def close(self, *, raise_if_closed: bool = True) -> None:
        """Stop the robot and let go of the hub. May be called twice; a reset opens the link again."""
        super().close(raise_if_closed=raise_if_closed)
        self._close_link()

    def stop(self) -> None:
        """Stop motors and program at once, in the middle of a step too; step and reset raise StoppedError until `resume`.

        Raises:
            HubError: the hub could not be told; its watchdog then stops the motors.
        """
        self._wish.stop()
        if self._connection is not None:
            self._connection.link.emergency_stop()

    def pause(self) -> None:
        """Have the robot hold still from the end of the step at hand on, until `resume`."""
        self._wish.pause()

    def resume(self) -> None:
        """After `pause` or `stop`: the robot may move again, with the next reset."""
        if self._connection is not None:
            self._connection.link.release()
        self._wish.go_on()

    @property
    def is_paused(self) -> bool:
        """Whether the robot is to hold still."""
        return self._wish.is_paused

    @property
    def is_cut(self) -> bool:
        """Whether a pause ended the episode at hand."""
        return self._episode is not None and self._episode.is_cut

    def _make_specs(self) -> None:
        entries = self.task.entries
        self._entries = len(entries)
        low, high = torch.tensor([e.low for e in entries]), torch.tensor([e.high for e in entries])
        nominal = torch.tensor([e.nominal for e in entries])
        self.observation_spec = Composite(observation=NominalBounded(low, high, nominal=nominal))
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
        reading = self._guarded(self._start)
        measured_s = self._robot().link.now_s() - reading.age_s
        self.is_closed = False
        drawn = np.array([entry.draw(self._host_rng) for entry in self.task.host_entries], dtype=np.float32)
        measured = np.zeros(len(self.task.measured_entries), dtype=np.float32)
        observation = _observe(reading, drawn, measured)
        self._odometer.start(self._robot().link.now_s())
        self._odometer.forward_mm(self._robot().link.now_s(), reading.values)
        out = {"observation": observation.clone()}
        watch = None
        if self.task.camera is not None:
            watch = Watch(self.task.camera, self._host_rng, self._guarded(self._camera.frame))
            observation = _with_numbers(observation, watch)
            out["image"] = torch.from_numpy(watch.image)
        self._episode = _Episode(drawn, observation, measured_s, watch=watch)
        return TensorDict(out, batch_size=())

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
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
        terminated = task.terminated(observation)
        episode.observation = observation
        episode.step_count += 1
        if self._wish.is_paused:
            episode.is_cut = True
            self._guarded(link.rest)
        truncated = torch.full_like(terminated, episode.is_cut or episode.step_count >= task.max_steps)
        out = {
            "observation": observation.clone(),  # whoever changes it in place does not change our previous one
            "reward": reward,
            "terminated": terminated,
            "truncated": truncated,
            "done": terminated | truncated,
        }
        if episode.watch is not None:
            episode.judged.append(observation)
            out["observation"] = observation[: self._entries].clone()
            out["image"] = torch.from_numpy(episode.watch.image)
        return TensorDict(out, batch_size=())

    def _step_proc_data(self, next_tensordict_out: TensorDictBase) -> TensorDictBase:
        """``_step`` leaves nothing to complete; where a task's own functions give other shapes, TorchRL puts them right."""
        if next_tensordict_out.get("reward").shape == next_tensordict_out.get("terminated").shape == (1,):
            return next_tensordict_out
        return super()._step_proc_data(next_tensordict_out)

    def _wait_while_blocked(self, episode: _Episode) -> None:
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

    def _measure(self, reading: Reading, episode: _Episode) -> torch.Tensor:
        """What the task's functions get after a step; asks odometer and camera only where somebody wants to know."""
        episode.measured_s = self._robot().link.now_s() - reading.age_s
        episode.hub_time_s = reading.hub_time_ms / 1000
        forward_mm: list[float] = []
        if self.task.walks or self.task.measured_entries:
            forward_mm = [self._odometer.forward_mm(self._robot().link.now_s(), reading.values)]
        measured = np.array(forward_mm[: len(self.task.measured_entries)], dtype=np.float32)
        observation = _observe(reading, episode.drawn, measured)
        if episode.watch is None:
            return observation
        episode.watch.see(self._guarded(self._camera.frame))
        return _with_numbers(observation, episode.watch)

    def judged(self, observations: torch.Tensor) -> torch.Tensor:
        """What the task's success and metrics get for these observations ``[steps, n]`` of the episode at hand, of all its steps.

        It is the observations themselves, but for a task whose camera has a goal, where what the camera found is added.

        Raises:
            BricksError: the observations are those of another episode.
        """
        if self.task.camera is None:
            return observations
        judged = self._episode.judged if self._episode is not None else []
        if len(judged) != len(observations):
            raise BricksError(f"{self.task.id} judges an episode before the next reset, and not {len(observations)} other steps")
        return torch.stack(judged)

    @property
    def timing(self) -> Timing:
        """Of the last step.

        Raises:
            BricksError: none was made.
        """
        if self._episode is None or not self._episode.step_count:
            raise BricksError(f"{self.task.id} has made no step yet; make one first")
        return Timing(self._episode.age_s, self._episode.hub_time_s)

    def walk_metrics(self) -> dict[str, float]:
        """Metres walked in this episode, speed and straightness, where the task walks and the robot is virtual."""
        return self._odometer.metrics() if self.task.walks and self._episode is not None else {}

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
            self._wish.check()  # whoever wanted to stop the robot did not find it yet
        return self._connection

    def _start(self) -> Reading:
        robot = self._robot()
        self._hold_still(robot.link)
        robot.link.open()  # without effect when it is open
        robot.place(self._place_rng)
        return robot.link.read()

    def _hold_still(self, link: HubLink) -> None:
        """Wait for the end of a pause; reading keeps the program on the hub from ending."""
        while not self._wish.wait(PAUSE_PERIOD_S):
            if link.is_open:
                link.read()
        self._wish.check()

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


def _observe(reading: Reading, drawn: NDArray[np.float32], measured: NDArray[np.float32]) -> torch.Tensor:
    return torch.from_numpy(np.concatenate((reading.values, drawn, measured)))


def _with_numbers(observation: torch.Tensor, watch: Watch) -> torch.Tensor:
    return torch.cat((observation, torch.from_numpy(watch.numbers())))
