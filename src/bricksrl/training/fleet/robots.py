"""Fleet: several robots of one kind, each in a process of its own with its link, its watchdog and its resets.

Each process plays the episodes that it is given and sends every frame as it comes. A robot whose link breaks tries to come back
by itself; a process that ends is started again.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

from bricksrl.envs.specs import SpecsEnv
from bricksrl.errors import LearnerError, RunError
from bricksrl.seed import derive_seed
from bricksrl.training.callbacks import RobotState
from bricksrl.training.process import ChildProcess, Message

if TYPE_CHECKING:
    from torch import Tensor

    from bricksrl.envs.connection import Placement
    from bricksrl.training.config import TrainConfig

_END_TIMEOUT_S = 10.0
_RESTART_S = 2.0
_LONGEST_RESTART_S = 60.0


@dataclass
class Member:
    """One robot of a fleet, as the run sees it.

    Attributes:
        name: for people and for the dataset.
        number: in the replay buffer.
        hub: how to reach it.
        since_s: monotonic time of the last change between being there and having left.
        is_ready: its process can play.
        starts: of its process.
        restarts: since an episode of it was whole.
    """

    name: str
    number: int
    hub: str
    state: RobotState = RobotState.STARTING
    reason: str = ""
    since_s: float = field(default_factory=time.monotonic)
    is_ready: bool = False
    starts: int = 0
    restarts: int = 0
    restart_at_s: float | None = None
    process: ChildProcess | None = None

    @property
    def is_out(self) -> bool:
        """It does not answer."""
        return self.state is RobotState.LEFT


Event = tuple[Member, str, Any]


def members_of(config: TrainConfig) -> list[Member]:
    """The robots that a config names."""
    hubs = config.hubs
    names = [hub if hub != "virtual" else f"virtual-{place + 1}" for place, hub in enumerate(hubs)]
    return [Member(name, place, hub) for place, (name, hub) in enumerate(zip(names, hubs, strict=True))]


class Fleet(SpecsEnv):
    """Several robots of one kind: the specs and the task of each, and the processes that have them.

    ``stop``, ``pause`` and ``resume`` may be called from any thread, and are meant for all of them.

    Args:
        config: of the run.
        place: puts a real robot where an episode starts; asked for one at a time.

    Raises:
        RunError: robots of this kind cannot learn together.
        UnknownNameError: there is no such environment or hub.
    """

    def __init__(self, config: TrainConfig, place: Placement | None = None) -> None:
        from bricksrl.envs.registry import is_simulation, make
        from bricksrl.hub.transports.address import parse_hub

        if is_simulation(config.env):
            raise RunError(f"{config.env} is simulated without a robot; train many copies of it with num_envs")
        for hub in config.hubs:
            parse_hub(hub)
        one = make(config.env, options=None, **config.options)
        names = ("observation_spec", "action_spec", "reward_spec", "done_spec")
        super().__init__({name: getattr(one, name).clone() for name in names}, one.task)
        one.close(raise_if_closed=False)
        self.config, self.members = config, members_of(config)
        self.events: SimpleQueue[Event] = SimpleQueue()
        self.is_paced = config.hub == "virtual" and not config.realtime
        self._placer = None if place is None else _Placer(place, self._placed)
        self._weights: dict[str, Tensor] | None = None
        self._is_paused = self._is_over = False

    # ---- the hand on all robots

    def stop(self) -> None:
        """All robots at once, for good."""
        self._is_over = True
        self._tell_all("stop")

    def pause(self) -> None:
        """All robots, each after the step at hand."""
        self._is_paused = True
        self._tell_all("pause")

    def resume(self) -> None:
        """After `pause`."""
        self._is_paused = False
        self._tell_all("resume")

    @property
    def is_paused(self) -> bool:
        """True if the robots are to hold still."""
        return self._is_paused

    def cut(self, name: str, duration_s: float) -> None:
        """Break the link of a virtual robot for so long, to try out what happens then."""
        self._tell(next(member for member in self.members if member.name == name), "cut", duration_s)

    def _tell_all(self, kind: str, content: Any = None) -> None:
        for member in self.members:
            self._tell(member, kind, content)

    # ---- processes

    def start(self) -> None:
        """Start all that have no process."""
        for member in self.members:
            if member.process is None:
                self._start(member)

    def _start(self, member: Member) -> None:
        member.restart_at_s, member.is_ready = None, False
        member.starts += 1
        start = member.starts

        def deliver(message: Message | None) -> None:
            self.events.put((member, "gone", start) if message is None else (member, *message))

        try:
            member.process = ChildProcess("bricksrl.training.fleet.worker", deliver)
        except OSError as error:
            raise LearnerError(f"cannot start the process of {member.name} ({error.strerror}); take fewer robots") from None
        alone = replace(self.config, hub=member.hub, robots=1, asynchronous=False, run_dir=None, start=None, data=None)
        begin = {
            "config": alone.to_dict(),
            "seed": derive_seed(self.config.seed, f"robot {member.name}", member.restarts),
            "is_recorded": self.config.record,
            "is_paced": self.is_paced,
            "is_placed": self._placer is not None,
        }
        self._tell(member, "begin", begin)

    def welcome(self, member: Member) -> None:
        """A robot's process is there: it gets what was learned, now and from now on."""
        member.is_ready = True
        if self._weights is not None:
            self._tell(member, "weights", self._weights)

    def next_event(self, timeout_s: float) -> Event | None:
        """What a robot says next; ``None`` where none did within the time. Restarts the processes that are due."""
        now_s = time.monotonic()
        for member in self.members:
            if member.restart_at_s is not None and now_s >= member.restart_at_s and not self._is_over:
                self._start(member)
        try:
            member, kind, content = self.events.get(timeout=timeout_s)
        except Empty:
            return None
        if kind == "gone":
            if content != member.starts:
                return None
            code, member.is_ready = self._reap(member), False
            pause_s = min(_RESTART_S * 2.0**member.restarts, _LONGEST_RESTART_S)
            member.restarts, member.restart_at_s = member.restarts + 1, now_s + pause_s
            return member, "gone", f"its process ended with code {code}"
        if kind == "place" and self._placer is not None:
            self._placer.ask(member)
        return member, kind, content

    def _placed(self, member: Member, error: BaseException | None) -> None:
        if error is None:
            self._tell(member, "placed")
        else:
            self.events.put((member, "unplaced", error))

    def order(self, member: Member, episode: dict[str, Any]) -> None:
        """Have a robot play an episode."""
        self._tell(member, "episode", episode)

    def go_on(self, member: Member) -> None:
        """Let a robot in simulated time make its next step."""
        if self.is_paced:
            self._tell(member, "go")

    def hand_out(self, weights: dict[str, Tensor]) -> None:
        """Give what was learned to all robots whose processes are there: a pipe to one that starts would be full for seconds, and
        all robots would wait for it."""
        self._weights = weights
        for member in self.members:
            if member.is_ready:
                self._tell(member, "weights", weights)

    def _tell(self, member: Member, kind: str, content: Any = None) -> None:
        if member.process is not None:
            with contextlib.suppress(OSError, ValueError):  # its end is told by its own side of the pipe
                member.process.send(kind, content)

    def _reap(self, member: Member) -> int | None:
        process, member.process = member.process, None
        return None if process is None else process.end(_END_TIMEOUT_S)

    def close(self, *, raise_if_closed: bool = True) -> None:
        """End all processes; each stops its robot first."""
        self._is_over = True
        self._tell_all("end")
        for member in self.members:
            self._reap(member)
        if self._placer is not None:
            self._placer.end()
        super().close(raise_if_closed=raise_if_closed)


class _Placer:
    """A thread that has one robot after the other put where an episode starts: there is one hand."""

    def __init__(self, place: Placement, answer: Callable[[Member, BaseException | None], None]) -> None:
        self._place, self._answer = place, answer
        self._asked: SimpleQueue[Member | None] = SimpleQueue()
        threading.Thread(target=self._work, name="placer", daemon=True).start()

    def ask(self, member: Member) -> None:
        self._asked.put(member)

    def end(self) -> None:
        self._asked.put(None)

    def _work(self) -> None:
        import numpy as np

        rng = np.random.default_rng()
        while (member := self._asked.get()) is not None:
            try:
                self._place(rng)
            except BaseException as error:  # noqa: BLE001  the run's own thread raises it
                self._answer(member, error)
            else:
                self._answer(member, None)
