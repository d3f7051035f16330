"""Learning beside the robot: a process of its own learns, so that the robot's loop never waits for a gradient.

The robot sends what it saw and did; back come weights for its actor, after the updates of each robot step. Updates are made only
when a step has asked for them, so that learning is never ahead; where the processor is too slow it falls behind, makes up for it
while the robot is reset, and the run tells how far it got. A process rather than a thread, because the many small operations of
an update would take turns with the robot's own Python, and because its death leaves the robot's side whole.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import threading
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, cast

from bricksrl.errors import LearnerError
from bricksrl.training.channel import Channel, unpack
from bricksrl.training.learner import Pace

if TYPE_CHECKING:
    from torch import Tensor

    from bricksrl.agents.agent import Agent, Transition

_CHECK_S = 0.1
_END_TIMEOUT_S = 120.0
_SLACK_STEPS = 4
"""How far a robot that loses nothing by waiting may be ahead of its learner."""


class BesideTheRobot:
    """The robot's side of a learner in another process.

    Args:
        agent: acts here; it neither remembers nor learns.
        begin: what `bricksrl.training.learning_process` needs to make the learning agent.
        state: of the learning agent; ``agent`` acts as it does from the start.
        pace: how far it is.
        patient: the robot is a simulated one in simulated time and waits where the learner falls behind.

    Raises:
        LearnerError: the process cannot be started. All other methods raise it too, when the process has failed or died.
    """

    def __init__(self, agent: Agent, begin: dict[str, Any], state: dict[str, Any], pace: Pace, *, patient: bool) -> None:
        self._agent, self._patient = agent, patient
        self.prefill_episodes, self.sees_images = agent.prefill_episodes, getattr(agent, "sees_images", False)
        self._changed = threading.Condition()
        self._asked, self._done = pace.asked, pace.done
        self._saves = self._saved = 0
        self._policy: dict[str, Tensor] | None = None
        self._ready = self._gone = False
        self._failure: str | None = None
        self._losses: defaultdict[str, list[float]] = defaultdict(list)
        command = [sys.executable, "-m", "bricksrl.training.learning_process"]
        # a session of its own, so that a Ctrl-C in the terminal reaches the robot's side only, which then tells the learner
        flags = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)
        try:
            self._process = subprocess.Popen(  # noqa: S603  our own interpreter
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True, creationflags=flags
            )
        except OSError as error:
            raise LearnerError(f"cannot start the process that learns ({error.strerror}); train synchronously") from None
        self._channel = Channel(cast(BinaryIO, self._process.stdout), cast(BinaryIO, self._process.stdin), self._deliver)
        self._send("begin", {**begin, "state": state, "pace": pace.to_dict()})

    @property
    def pace(self) -> Pace:
        """As last heard."""
        return Pace(self._asked, self._done)

    def wait_until_ready(self) -> None:
        """Wait for the process to be there."""
        self._wait(lambda: self._ready)

    def start_acting(self) -> None:
        """As `Agent.start_acting`."""
        self._agent.start_acting()

    def act(self, observation: Tensor, *, explore: bool) -> Tensor:
        """As the newest weights have it."""
        with self._changed:
            policy, self._policy = self._policy, None
        if policy is not None:
            self._agent.load_policy_state(policy)
        return self._agent.act(observation, explore=explore)

    def remember(self, transition: Transition) -> None:
        """Tell the learner."""
        self._send("remember", transition)

    def end_episode(self) -> None:
        """Tell the learner."""
        self._send("end_episode", None)

    def update(self) -> dict[str, float]:
        """Ask for the updates of one robot step, and go on."""
        self._asked += 1
        self._send("update", None)
        if self._patient:
            self._wait(lambda: self._asked - self._done <= _SLACK_STEPS)
        with self._changed:
            losses, self._losses = self._losses, defaultdict(list)
        return {name: sum(values) / len(values) for name, values in losses.items()}

    def save(self, path: Path, state: dict[str, Any]) -> None:
        """Tell the learner, who writes it before it learns on."""
        self._saves += 1
        self._send("save", (str(path.absolute()), state))

    def finish(self, go_on: Callable[[], bool]) -> None:
        """Wait for what is due."""
        self._wait(lambda: self._done >= self._asked or not go_on())
        self._wait(lambda: self._saved >= self._saves)

    def close(self) -> None:
        """End the process, once it has written what it was told to."""
        if self._process.poll() is None:
            with contextlib.suppress(OSError):
                self._channel.send(("end", None))
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_END_TIMEOUT_S)
        self.kill()

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()

    def _send(self, kind: str, content: Any) -> None:
        self._check()
        try:
            self._channel.send((kind, content))
        except OSError:
            with self._changed:  # what it had to say last may still be on its way
                self._changed.wait_for(lambda: self._gone, _CHECK_S)
            self._gone = True
            self._check()

    def _wait(self, is_true: Callable[[], bool]) -> None:
        """Wait for something that a message brings; the process ends the waiting too, by its death."""
        with self._changed:
            while not is_true():
                self._check()
                self._changed.wait(_CHECK_S)

    def _check(self) -> None:
        """
        Raises:
            LearnerError: the process has failed or died.
        """
        if self._failure is not None:
            raise LearnerError(f"the process that learns failed ({self._failure}); resume the run from its last checkpoint")
        if self._gone:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_END_TIMEOUT_S)
            code = self._process.returncode
            cause = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
            raise LearnerError(f"the process that learns has died ({cause}); resume the run from its last checkpoint")

    def _deliver(self, data: bytes | None) -> None:
        kind: str
        content: Any
        kind, content = ("gone", None) if data is None else unpack(data)
        with self._changed:
            match kind:
                case "ready":
                    self._ready, self._policy = True, content
                case "learned":
                    self._done, losses, self._policy = content
                    for name, value in losses.items():
                        self._losses[name].append(value)
                case "saved":
                    self._saved = content
                case "failed":
                    self._failure = content
                case "gone":
                    self._gone = True
            self._changed.notify_all()
