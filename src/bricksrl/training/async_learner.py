"""Asynchronous learner: a process of its own learns beside the robot, so that the robot's loop never waits for a gradient.

The robot sends what it saw and did; back come weights for its actor, after the updates of each robot step. Learning is never
ahead of the steps; where the processor is too slow it falls behind, makes up for it while the robot is reset, and the run tells
how far it got. A process rather than a thread, because the small operations of an update would take turns with the robot's own
Python, and because its death leaves the robot's side whole. It ends by itself when the robot's side has gone.
"""

from __future__ import annotations

import contextlib
import gc
import threading
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue
from types import TracebackType
from typing import Any, Self

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase

from bricksrl.agents.learner import Learner, means
from bricksrl.envs.registry import get_task
from bricksrl.envs.specs import SpecsEnv
from bricksrl.errors import BricksError, LearnerError
from bricksrl.seed import derive_seed
from bricksrl.training.config import TrainConfig
from bricksrl.training.learner_side import InLoopLearner, Pace
from bricksrl.training.offline import study
from bricksrl.training.process import END, Channel, ChildProcess, Message, leave, parent_channel
from bricksrl.training.restore import make_learner_for

_CHECK_S = 0.1
_END_TIMEOUT_S = 120.0
_SLACK_STEPS = 4
"""How far a robot that loses nothing by waiting may be ahead of its learner."""


class AsyncLearner:
    """The robot's side of a learner in another process, which ends when this is left.

    Args:
        env: its specs and its task are what the learner is built for.
        actor: acts here, on the CPU; it neither remembers nor learns.
        state: of a checkpoint, which the learner in the other process goes on from.

    Raises:
        LearnerError: the process cannot be started. All other methods raise it too, when the process has failed or died.
    """

    def __init__(self, config: TrainConfig, env: EnvBase, actor: Learner, state: dict[str, Any]) -> None:
        actor.act_on("cpu")
        self.actor = actor
        self._is_patient = config.hub == "virtual" and not config.realtime  # a simulated robot loses nothing by waiting
        seen = list(actor.policy.in_keys)
        outcome = (*seen, "reward", "terminated", "done", "link_lost")
        self._keys = [*seen, "action", "action_log_prob", *(("next", key) for key in outcome)]
        self._changed = threading.Condition()
        self._asked, self._done, self._saves, self._saved = state["pace"]["asked"], state["pace"]["done"], 0, 0
        self._is_ready, self._failure = False, ""
        self._told: list[dict[str, Tensor]] = []
        try:
            with self._changed:  # it may tell of its end before it is here
                self._process = ChildProcess("bricksrl.training.async_learner", self._deliver)
        except OSError as error:
            raise LearnerError(f"cannot start the process that learns ({error.strerror}); train synchronously") from None
        specs = {name: getattr(env, name).cpu() for name in ("observation_spec", "action_spec", "reward_spec", "done_spec")}
        has_task = getattr(env, "task", None) is not None
        own = {name: state[name] for name in ("agent", "pace", "collected")}
        self._send("begin", {"config": config.to_dict(), "specs": specs, "has_task": has_task, "state": own})

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """End the process: once it has written what it was told to, or at once where the run breaks off."""
        in_order = error is None or isinstance(error, BricksError)
        if in_order:
            with contextlib.suppress(OSError):
                self._process.send(*END)
        self._process.end(_END_TIMEOUT_S if in_order else 0.0)

    @property
    def pace(self) -> Pace:
        """As last heard."""
        return Pace(self._asked, self._done)

    def wait_until_ready(self) -> None:
        """Wait for the process to be there."""
        self._wait(lambda: self._is_ready)

    def new_weights(self) -> dict[str, Tensor] | None:
        """All that acting depends on, where that was learned since the last call."""
        return self.actor.weights.pop() if self.actor.weights else None

    def remember(self, frames: TensorDictBase, robot: int = 0) -> None:
        """Tell the learner."""
        rows = frames.select(*self._keys, strict=False)
        self._send("remember", (robot, dict(rows.flatten_keys(".").items())))

    def end_episodes(self, robot: int | None = None) -> None:
        """Tell the learner."""
        self._send("end_episodes", robot)

    def learn(self, steps: int) -> dict[str, Tensor]:
        """Ask for the updates of so many steps, and go on."""
        self._asked += steps
        self._send("learn", steps)
        if self._is_patient:
            self._wait(lambda: self._asked - self._done <= _SLACK_STEPS)
        with self._changed:
            told, self._told = self._told, []
        return means(told)

    def save(self, path: Path, state: dict[str, Any]) -> None:
        """Tell the learner, who writes it before it learns on."""
        self._saves += 1
        self._send("save", (str(path.absolute()), state))

    def finish(self, go_on: Callable[[], bool]) -> None:
        """Wait for what is due."""
        self._wait(lambda: self._done >= self._asked or not go_on())
        self._wait(lambda: self._saved >= self._saves)

    def _send(self, kind: str, content: Any) -> None:
        self._check()
        try:
            self._process.send(kind, content)
        except OSError:  # what it had to say last may still be on its way
            with self._changed:
                self._changed.wait_for(lambda: self._failure, _END_TIMEOUT_S)
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
        if self._failure:
            raise LearnerError(f"the process that learns {self._failure}; resume the run from its last checkpoint")

    def _deliver(self, message: Message | None) -> None:
        if message is None:
            with self._changed:
                process = self._process
            code = process.wait(_END_TIMEOUT_S)
            cause = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
            message = "failed", self._failure or f"has died ({cause})"
        content: Any
        kind, content = message
        with self._changed:
            match kind:
                case "ready":
                    self._is_ready = True
                    self.actor.weights.append(content)
                case "learned":
                    self._done, told, weights = content
                    self._told.append(told)
                    self.actor.weights.append(weights)
                case "saved":
                    self._saved = content
                case "failed":
                    self._failure = content
            self._changed.notify_all()


Inbox = SimpleQueue[Message | None]


def main() -> None:
    """Learn beside one run: ``python -m bricksrl.training.async_learner``, which an `AsyncLearner` starts."""
    inbox: Inbox = SimpleQueue()
    channel = parent_channel(inbox.put)
    try:
        _, begin = inbox.get() or END
        if begin is not None:
            serve(begin, inbox, channel)
    except BrokenPipeError:
        pass
    except Exception as error:  # noqa: BLE001  the robot's side tells the user
        with contextlib.suppress(BrokenPipeError):
            channel.send("failed", f"failed ({type(error).__name__}: {' '.join(str(error).split())})")
    gc.collect()  # lets go of the semaphores of replay buffers
    leave()


def serve(begin: dict[str, Any], inbox: Inbox, channel: Channel) -> None:
    """Learn until the robot's side says that it is over, or has gone."""
    torch.set_num_threads(1)  # the robot has the other cores
    asked, done = begin["state"]["pace"]["asked"], begin["state"]["pace"]["done"]
    config = TrainConfig.from_dict(begin["config"])
    torch.manual_seed(derive_seed(config.seed, "learner", asked))
    env = SpecsEnv(begin["specs"], get_task(config.env, **config.options) if begin["has_task"] else None)
    learner = make_learner_for(config, env)
    learner.load_state_dict(begin["state"]["agent"])
    study(config, learner, env)
    side = InLoopLearner(learner, {**begin["state"], "pace": {"asked": done}})
    del begin  # it may be large
    saves = 0
    channel.send("ready", learner.policy_state())
    while True:
        while side.pace.done >= asked or not inbox.empty():
            kind, content = inbox.get() or END
            match kind:
                case "remember":
                    robot, rows = content
                    side.remember(TensorDict(rows).auto_batch_size_(1).unflatten_keys("."), robot)
                case "end_episodes":
                    side.end_episodes(content)
                case "learn":
                    asked += content
                case "save":
                    path, state = content
                    side.save(Path(path), {**state, "pace": {"asked": asked, "done": side.pace.done}})
                    saves += 1
                    channel.send("saved", saves)
                case "end":
                    return
        told = {name: value.cpu() for name, value in side.learn(1).items()}
        channel.send("learned", (side.pace.done, told, learner.policy_state()))


if __name__ == "__main__":
    main()
