"""Fleet: several robots of one kind, each in its own process with its link, watchdog and resets.

Each process runs assigned episodes and sends each frame. Robots with a lost link reconnect; ended
processes are restarted.
"""

import contextlib
import threading
import time
from dataclasses import dataclass, field, replace
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
from torch import Tensor
from torchrl.envs import EnvBase

from brickhub.hub.transports.address import parse_hub
from brickhub.seed import derive_seed
from bricksrl.child_process import ChildProcess, Message
from bricksrl.envs.connection import Placement
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.registry import is_simulation
from bricksrl.envs.specs import SPECS, SpecsEnv
from bricksrl.envs.transforms import base_of, layout_of, over, runs_on
from bricksrl.errors import LearnerError, RunError
from bricksrl.training.callbacks import RobotState
from bricksrl.training.config import TrainConfig
from bricksrl.training.learners import stand_in

_END_TIMEOUT_S = 10.0
"""Time that a process has to stop its robot and to end."""
_RESTART_S = 2.0
"""Pause before a process is started again; twice as long after each further death."""
_LONGEST_RESTART_S = 60.0
"""Longest of these pauses."""
_MAX_DEATHS = 5
"""Ends of a robot's process in a row, without a complete episode, after which it is given up."""


@dataclass
class Member:
    """One robot of a fleet, in the run's process.

    Attributes:
        name: for users and the dataset.
        number: in the replay buffer.
        hub: its address.
        since_s: monotonic time of the last change of reachability.
        is_ready: whether its process can start an episode.
        starts: number of process starts.
        deaths: of its process since its last complete episode.
    """

    name: str
    number: int
    hub: str
    state: RobotState = RobotState.STARTING
    reason: str = ""
    since_s: float = field(default_factory=time.monotonic)
    is_ready: bool = False
    starts: int = 0
    deaths: int = 0
    restart_at_s: float | None = None
    process: ChildProcess | None = None

    @property
    def is_out(self) -> bool:
        """Whether the robot does not answer."""
        return self.state in (RobotState.LEFT, RobotState.GIVEN_UP)


Event = tuple[Member, str, Any]


def members_of(config: TrainConfig) -> list[Member]:
    """The robots of a config."""
    members = []
    for number, hub in enumerate(config.hubs):
        # Real robots have an address each, but virtual ones are alike.
        name = f"virtual-{number + 1}" if hub == "virtual" else hub
        members.append(Member(name, number, hub))
    return members


def make_fleet(config: TrainConfig, place: Placement | None = None) -> EnvBase:
    """The robots of a config, behind its transforms: what these draw, such as statistics, is drawn
    once, on a virtual robot. ``place``: as of `Fleet`. Raises RunError if robots of this kind, or
    with these transforms, cannot learn together, UnknownNameError if there is no such environment
    or hub."""
    if is_simulation(config.env):
        raise RunError(
            f"{config.env} is a simulation without a robot; train copies of it with num_envs"
        )
    # A wrong address or transform is reported here, and not by each process.
    for hub in config.hubs:
        parse_hub(hub)
    env = stand_in(config)
    layout_of(env)
    if runs_on(env):
        raise RunError(
            "the robots of a fleet would have different statistics; give --normalize, or omit "
            "the transform"
        )
    return over(env, Fleet(config, env, place))


class Fleet(SpecsEnv):
    """Several robots of one kind: common specs and task, and their processes.

    ``stop``, ``pause`` and ``resume`` affect all robots and may be called from any thread.

    Args:
        config: of the run.
        env: environment of one of them.
        place: places a real robot at the start position; called for one robot at a time.

    Attributes:
        kept: what the transforms of the run keep, for the processes.
    """

    def __init__(
        self,
        config: TrainConfig,
        env: EnvBase,
        place: Placement | None = None,
    ) -> None:
        # The specs are the robot's own, because the run puts its transforms around the fleet again.
        robot = base_of(env)
        specs = {name: getattr(robot, name).clone() for name in SPECS}
        super().__init__(specs, interface_of(env).task)
        self.config = config
        self.members = members_of(config)
        self.kept = dict[str, Any]()
        self.robots = len(self.members)
        self.events: SimpleQueue[Event] = SimpleQueue()
        # Robots in simulated time lose nothing by waiting for the learner, and would otherwise run
        # ahead.
        self.is_paced = config.hub == "virtual" and not config.realtime
        self._place = place
        # One person places all robots, one after the other.
        self._placing = threading.Lock()
        # A process that starts later needs the newest weights at once.
        self._weights: dict[str, Tensor] | None = None
        self._is_paused = False
        self._is_over = False

    def stop(self) -> None:
        """Stop all robots at once, permanently."""
        self._is_over = True
        self._send_all("stop")

    @property
    def has_stopped(self) -> bool:
        """Whether the processes of all robots have ended, as each does after it has stopped its
        robot."""
        return all(
            member.process is None or member.process.wait(0.0) is not None
            for member in self.members
        )

    def pause(self) -> None:
        """Pause all robots after their current steps."""
        self._is_paused = True
        self._send_all("pause")

    def resume(self) -> None:
        """Resume after `pause`."""
        self._is_paused = False
        self._send_all("resume")

    @property
    def is_paused(self) -> bool:
        """Whether the robots are paused."""
        return self._is_paused

    def _send_all(
        self,
        kind: str,
        content: Any = None,
    ) -> None:
        for member in self.members:
            self.tell(member, kind, content)

    def start(self) -> None:
        """Start all missing processes."""
        for member in self.members:
            if member.process is None:
                self._start(member)

    def _start(self, member: Member) -> None:
        member.restart_at_s = None
        member.is_ready = False
        member.starts += 1
        start = member.starts

        def deliver(message: Message | None) -> None:
            # The number of the start is sent along, to tell the end of a former process from that
            # of its successor.
            kind, content = ("gone", start) if message is None else message
            self.events.put((member, kind, content))

        try:
            member.process = ChildProcess("bricksrl.training.fleet.worker", deliver)
        except OSError as error:
            raise LearnerError(
                f"cannot start the process of {member.name} ({error.strerror}); use fewer robots"
            ) from None
        # The learner's start does not concern the robot, which gets weights.
        robot_config = replace(
            self.config,
            hub=member.hub,
            robots=1,
            asynchronous=False,
            run_dir=None,
            start=None,
            demonstrations=None,
        )
        begin = {
            "config": robot_config.to_dict(),
            # After a death the seed changes, because the same draws may lead to it again.
            "seed": derive_seed(self.config.seed, f"robot {member.name}", member.deaths),
            "transforms": self.kept,
            "is_recorded": self.config.record,
            "is_paced": self.is_paced,
            "is_placed": self._place is not None,
        }
        self.tell(member, "begin", begin)

    def begin_sending(self, member: Member) -> None:
        """Send the weights to a new process, and include it in `send_weights`; it knows of no stop
        or pause before."""
        member.is_ready = True
        if self._is_over:
            self.tell(member, "stop")
        elif self._is_paused:
            self.tell(member, "pause")
        if self._weights is not None:
            self.tell(member, "weights", self._weights)

    def next_event(self, timeout_s: float) -> Event | None:
        """The next event of a robot, or ``None`` after the timeout. Restarts ended processes, but
        for those of robots that it gives up."""
        now_s = time.monotonic()
        for member in self.members:
            is_due = member.restart_at_s is not None and now_s >= member.restart_at_s
            if is_due and not self._is_over:
                self._start(member)
        try:
            member, kind, content = self.events.get(timeout=timeout_s)
        except Empty:
            return None
        if kind == "gone":
            # This is the end of a former process, which already has a successor.
            if content != member.starts:
                return None
            return self._bury(member, now_s)
        if kind == "place":
            # A thread is used because the other robots go on while a person is at work. It is a
            # daemon, because nobody may ever answer.
            placer = threading.Thread(
                target=self._place_robot,
                args=(member,),
                name="placer",
                daemon=True,
            )
            placer.start()
        return member, kind, content

    def _bury(
        self,
        member: Member,
        now_s: float,
    ) -> Event:
        """The event that a robot's process ended, which is started again, or given up."""
        code = self._reap(member)
        member.is_ready = False
        member.deaths += 1
        # A restart does not help a process that dies again and again.
        if member.deaths >= _MAX_DEATHS:
            times = f"{member.deaths} times in a row without a complete episode"
            reason = f"its process ended {times}, the last time with code {code}"
            return member, "given up", reason
        pause_s = _RESTART_S * 2.0 ** (member.deaths - 1)
        member.restart_at_s = now_s + min(pause_s, _LONGEST_RESTART_S)
        return member, "gone", f"its process ended with code {code}"

    def _place_robot(self, member: Member) -> None:
        """Have a robot placed, one after the other, by one person."""
        assert self._place is not None  # noqa: S101  its process asks only then
        try:
            with self._placing:
                self._place(np.random.default_rng())
        except BaseException as error:  # noqa: BLE001  raised again in the run's thread
            self.events.put((member, "unplaced", error))
        else:
            self.tell(member, "placed")

    def send_weights(self, weights: dict[str, Tensor]) -> None:
        """Send weights to all started processes: the pipe to a starting one would be full for
        seconds and block all robots."""
        self._weights = weights
        for member in self.members:
            if member.is_ready:
                self.tell(member, "weights", weights)

    def tell(
        self,
        member: Member,
        kind: str,
        content: Any = None,
    ) -> None:
        """Send a message to a robot's process, if it is there."""
        if member.process is None:
            return
        # A closed pipe needs no care here, because its reader reports the end.
        with contextlib.suppress(OSError, ValueError):
            member.process.send(kind, content)

    def _reap(self, member: Member) -> int | None:
        process = member.process
        member.process = None
        if process is None:
            return None
        return process.end(_END_TIMEOUT_S)

    def close(self, *, raise_if_closed: bool = True) -> None:
        """End all processes; each stops its robot first."""
        self._is_over = True
        # All are asked at once, so that no robot moves on while another one's process ends.
        self._send_all("end")
        for member in self.members:
            self._reap(member)
        super().close(raise_if_closed=raise_if_closed)
