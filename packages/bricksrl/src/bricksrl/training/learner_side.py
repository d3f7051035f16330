"""Learner of a run: in the robot's loop, or in another process so that the robot never waits for a
gradient.

In the second case the robot's process sends transitions and receives weights of the actor. Learning
never gets ahead of the steps; on a slow processor it falls behind and catches up during resets. It
is a process, as a thread would compete for the interpreter lock, and as its death does not stop the
robot's process. It ends with the robot's process.
"""

import contextlib
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from queue import SimpleQueue
from types import TracebackType
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase, TransformedEnv

from brickhub.seed import derive_seed
from bricksrl.agents.learner import Learner, means
from bricksrl.child_process import END, ChildProcess, Message, Send, leave, parent_channel
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.registry import get_task
from bricksrl.envs.rollout import lost_links, with_outcome
from bricksrl.envs.specs import SPECS, SpecsEnv
from bricksrl.envs.transforms import changes_nothing, layout_of, load_transform_state
from bricksrl.errors import BricksError, LearnerError, message_of
from bricksrl.training.checkpoint import save_checkpoint
from bricksrl.training.config import TrainConfig
from bricksrl.training.learners import attach_dataset, make_learner_for, stand_in
from bricksrl.training.restore import restore

_CHECK_S = 0.1
_END_TIMEOUT_S = 120.0
_INTERRUPTED_TIMEOUT_S = 5.0
_SLACK_STEPS = 4
"""Maximum lead of a simulated robot over its learner, steps."""


@dataclass(frozen=True)
class LearningPace:
    """Progress of learning: robot steps with requested updates (``asked``), and with completed ones
    (``done``)."""

    asked: int = 0
    done: int = 0

    def updates_per_step(self, learner: Learner) -> float | None:
        """Updates per step that requires updates, or ``None`` without such steps."""
        return (
            learner.updates_per_step * (self.done / self.asked)
            if self.asked and learner.updates_per_step
            else None
        )


class InLoopLearner:
    """Learns while the robot waits: repeatable, bit for bit. ``state``: pace, and frames not
    learned from yet."""

    def __init__(self, actor: Learner, state: dict[str, Any]) -> None:
        self.actor = actor
        self.pace = LearningPace(state["pace"]["asked"], state["pace"]["asked"])
        self._collected: list[TensorDictBase] = [
            TensorDict(frames).auto_batch_size_(1) for frames in state["collected"]
        ]
        self._updates_sent = -1

    def remember(self, frames: TensorDictBase, robot: int = 0) -> None:
        """Store frames ``[time]`` or ``[copies, time]``, in batches of the learner's size."""
        size = self.actor.frames_per_batch
        if frames.shape[-1] < size:
            self._collected.append(frames)
            if sum(part.shape[-1] for part in self._collected) < size:
                return
            frames = torch.cat(self._collected, -1)
            # steps with a lost link have no outcome, and do not count
            if len(with_outcome(frames, lost_links(frames))) < size:
                return
            self._collected = []
        self.actor.remember(frames, robot)

    def end_episodes(self, robot: int | None = None) -> None:
        """End the current episode of a robot, or of all."""
        self.actor.end_episodes(robot)

    def new_weights(self) -> dict[str, Tensor] | None:
        """The policy's tensors, if there are new ones since the last call."""
        if self._updates_sent == self.actor.updates:
            return None
        self._updates_sent = self.actor.updates
        return self.actor.policy_state()

    def learn(self, steps: int) -> dict[str, Tensor]:
        """Make the updates for ``steps`` steps, if a batch is complete. Returns mean metrics."""
        self.pace = LearningPace(self.pace.asked + steps, self.pace.done + steps)
        return {} if self._collected else self.actor.learn(steps)

    def save(self, path: Path, state: dict[str, Any]) -> None:
        """Write a checkpoint of ``state``, the learner and pending frames."""
        collected = [frames.to_dict() for frames in self._collected]
        of_learner = {
            "agent": self.actor.state_dict(),
            "pace": asdict(self.pace),
            "collected": collected,
        }
        save_checkpoint(path, {**of_learner, **state})

    def finish(self, go_on: Callable[[], bool]) -> None:
        """Nothing is pending."""


class AsyncLearner(contextlib.AbstractContextManager["AsyncLearner"]):
    """The robot's side of a learner in another process; leaving the context ends the process.
    Raises LearnerError if the process cannot be started; in all other methods: it failed or died.
    ``env`` provides specs and task, ``actor`` acts here, on the CPU, and the learner continues from
    the ``state`` of a checkpoint."""

    def __init__(
        self, config: TrainConfig, env: EnvBase, actor: Learner, state: dict[str, Any]
    ) -> None:
        actor.act_on("cpu")
        self.actor = actor
        # a simulated robot may wait
        self._may_wait = config.hub == "virtual" and not config.realtime
        self._changed = threading.Condition()
        self._asked = state["pace"]["asked"]
        self._done = state["pace"]["done"]
        self._saves = 0
        self._saved = 0
        self._is_ready = False
        self._failure = ""
        self._metrics: list[dict[str, Tensor]] = []
        try:
            with self._changed:  # it may report its end before the attribute is set
                self._process = ChildProcess("bricksrl.training.learner_side", self._deliver)
        except OSError as error:
            raise LearnerError(
                f"cannot start the learner's process ({error.strerror}); train synchronously"
            ) from None
        specs = {name: getattr(env, name).cpu() for name in SPECS}
        layout = layout_of(env)
        # of which it would think that it fits
        has_task = interface_of(env).task is not None and changes_nothing(env)
        # The process makes the transforms of the config; those of a user's own environment it
        # cannot know, but a dataset has to pass through them.
        has_own_transforms = isinstance(env, TransformedEnv) and not config.is_transformed
        if config.dataset is not None and has_own_transforms:
            raise LearnerError(
                "the learner's process does not know this environment's transforms; train "
                "synchronously"
            )
        names = ("agent", "pace", "collected", "transforms")
        begun = {name: state[name] for name in names}
        self._send(
            "begin",
            {
                "config": config.to_dict(),
                "specs": specs,
                "layout": layout,
                "has_task": has_task,
                "state": begun,
            },
        )

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the process after its pending work; soon, after Ctrl-C or an unexpected error."""
        in_order = error is None or isinstance(error, BricksError)
        with contextlib.suppress(OSError):
            self._process.send(*END)
        self._process.end(_END_TIMEOUT_S if in_order else _INTERRUPTED_TIMEOUT_S)

    @property
    def pace(self) -> LearningPace:
        """Pace as last reported."""
        return LearningPace(self._asked, self._done)

    def wait_until_ready(self) -> None:
        """Wait until the process is ready."""
        self._wait(lambda: self._is_ready)

    def new_weights(self) -> dict[str, Tensor] | None:
        """The policy's tensors, if there are new ones since the last call."""
        return self.actor.weights.pop() if self.actor.weights else None

    def remember(self, frames: TensorDictBase, robot: int = 0) -> None:
        """Send frames to the learner."""
        self._send("remember", (robot, dict(frames.flatten_keys(".").items())))

    def end_episodes(self, robot: int | None = None) -> None:
        """Tell the learner that episodes ended."""
        self._send("end_episodes", robot)

    def learn(self, steps: int) -> dict[str, Tensor]:
        """Request the updates for ``steps`` steps, without waiting for them. Returns means of
        metrics received so far."""
        self._asked += steps
        self._send("learn", steps)
        if self._may_wait:
            self._wait(lambda: self._asked - self._done <= _SLACK_STEPS)
        with self._changed:
            metrics = self._metrics
            self._metrics = []
        return means(metrics)

    def save(self, path: Path, state: dict[str, Any]) -> None:
        """Request a checkpoint; the learner writes it before it continues."""
        self._saves += 1
        self._send("save", (str(path.absolute()), state))

    def finish(self, go_on: Callable[[], bool]) -> None:
        """Wait for pending updates and checkpoints."""
        self._wait(lambda: self._done >= self._asked or not go_on())
        self._wait(lambda: self._saved >= self._saves)

    def _send(self, kind: str, content: Any) -> None:
        self._check()
        try:
            self._process.send(kind, content)
        except OSError:  # its last message may still be on its way
            with self._changed:
                self._changed.wait_for(lambda: self._failure, _END_TIMEOUT_S)
            self._check()

    def _wait(self, is_true: Callable[[], bool]) -> None:
        """Wait for a condition that a message, or the process's death, brings about."""
        with self._changed:
            while not is_true():
                self._check()
                self._changed.wait(_CHECK_S)

    def _check(self) -> None:
        """Raise `LearnerError` if the process has failed or died."""
        if self._failure:
            raise LearnerError(
                f"the learner's process {self._failure}; resume the run from its last checkpoint"
            )

    def _deliver(self, message: Message | None) -> None:
        if message is None:
            with self._changed:
                process = self._process
            code = process.wait(_END_TIMEOUT_S)
            cause = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
            message = "failed", self._failure or f"died ({cause})"
        content: Any
        kind, content = message
        with self._changed:
            match kind:
                case "ready":
                    self._is_ready = True
                    self.actor.weights.append(content)
                case "learned":
                    self._done, metrics, weights = content
                    self._metrics.append(metrics)
                    self.actor.weights.append(weights)
                case "saved":
                    self._saved = content
                case "failed":
                    self._failure = content
            self._changed.notify_all()


LearnerSide = InLoopLearner | AsyncLearner
"""Where a run learns."""
Inbox = SimpleQueue[Message | None]


def main() -> None:
    """Entry point of the learner's process, ``python -m bricksrl.training.learner_side``."""
    inbox: Inbox = SimpleQueue()
    send = parent_channel(inbox.put)
    try:
        _, begin = inbox.get() or END
        if begin is not None:
            serve(begin, inbox, send)
    except BrokenPipeError:
        pass
    except Exception as error:  # noqa: BLE001  reported to the user by the robot's side
        with contextlib.suppress(BrokenPipeError):
            send("failed", f"failed ({message_of(error, typed=True)})")
    leave()


def serve(begin: dict[str, Any], inbox: Inbox, send: Send) -> None:
    """Learn until the robot's side ends the run or disconnects."""
    torch.set_num_threads(1)  # the other cores are for the robot
    asked = begin["state"]["pace"]["asked"]
    done = begin["state"]["pace"]["done"]
    config = TrainConfig.from_dict(begin["config"])
    torch.manual_seed(derive_seed(config.seed, "learner", asked))
    if config.is_transformed:
        env = stand_in(config)
        load_transform_state(env, begin["state"]["transforms"])
    else:
        env = SpecsEnv(
            begin["specs"],
            get_task(config.env, **config.options) if begin["has_task"] else None,
            begin["layout"],
        )
    learner = make_learner_for(config, env)
    restore(learner, begin["state"]["agent"])
    attach_dataset(config, learner, env)
    side = InLoopLearner(learner, {**begin["state"], "pace": {"asked": done}})
    del begin  # may be large
    saves = 0
    send("ready", learner.policy_state())
    while True:
        # on-policy: batch by batch
        while side.pace.done >= asked or not (learner.on_policy or inbox.empty()):
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
                    side.save(
                        Path(path), {**state, "pace": {"asked": asked, "done": side.pace.done}}
                    )
                    saves += 1
                    send("saved", saves)
                case "end":
                    return
        metrics = {name: value.cpu() for name, value in side.learn(1).items()}
        send("learned", (side.pace.done, metrics, learner.policy_state()))


if __name__ == "__main__":
    main()
