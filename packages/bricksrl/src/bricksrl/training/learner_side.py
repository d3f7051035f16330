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
from bricksrl.agents.gradient_descent import means
from bricksrl.agents.learner import Learner
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

_CHECK_S = 0.1
"""Time between two looks at whether a condition that is waited for holds."""
_END_TIMEOUT_S = 120.0
"""Time that the process has to end its pending work and to write its checkpoints."""
_INTERRUPTED_TIMEOUT_S = 5.0
"""The same after Ctrl-C or an unexpected error, when somebody waits for the prompt."""
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
        if not self.asked or not learner.updates_per_step:
            return None
        return learner.updates_per_step * (self.done / self.asked)


class InLoopLearner:
    """Learns while the robot waits: repeatable, bit for bit. ``state``: pace, and frames not
    learned from yet."""

    def __init__(
        self,
        actor: Learner,
        state: dict[str, Any],
    ) -> None:
        self.actor = actor
        # Nothing is ever pending here, whatever an asynchronous run has left behind.
        asked = state["pace"]["asked"]
        self.pace = LearningPace(asked, asked)
        self._collected: list[TensorDictBase] = [
            TensorDict(frames).auto_batch_size_(1) for frames in state["collected"]
        ]
        # No number of updates: the first weights are new.
        self._updates_sent = -1

    def remember(
        self,
        frames: TensorDictBase,
        robot: int = 0,
    ) -> None:
        """Store frames ``[time]`` or ``[copies, time]``, in batches of the learner's size."""
        size = self.actor.frames_per_batch
        is_batch = frames.shape[-1] >= size
        if is_batch:
            self.actor.remember(frames, robot)
            return
        # An algorithm such as PPO looks at a stretch of time at once, a robot makes single steps.
        self._collected.append(frames)
        steps = sum(part.shape[-1] for part in self._collected)
        if steps < size:
            return
        stretch = torch.cat(self._collected, -1)  # [time] or [copies, time]
        # Steps with a lost link have no outcome, and do not count.
        rows = with_outcome(stretch, lost_links(stretch))
        if len(rows) < size:
            return
        self._collected = []
        self.actor.remember(stretch, robot)

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
        # A batch is not complete yet; its updates are those of its last step.
        if self._collected:
            return {}
        return self.actor.learn(steps)

    def save(
        self,
        path: Path,
        state: dict[str, Any],
    ) -> None:
        """Write a checkpoint of ``state``, the learner and pending frames."""
        of_learner = {
            "agent": self.actor.state_dict(),
            "pace": asdict(self.pace),
            "collected": [frames.to_dict() for frames in self._collected],
        }
        # The state goes over the learner's: another process's learner is given the pace of the
        # run, which knows how many updates are pending.
        save_checkpoint(path, {**of_learner, **state})

    def finish(self, go_on: Callable[[], bool]) -> None:
        """Nothing is pending."""


class AsyncLearner(contextlib.AbstractContextManager["AsyncLearner"]):
    """The robot's side of a learner in another process; leaving the context ends the process.
    Raises LearnerError if the process cannot be started; in all other methods: it failed or died.
    ``env`` provides specs and task, ``actor`` acts here, on the CPU, and the learner continues from
    the ``state`` of a checkpoint."""

    def __init__(
        self,
        config: TrainConfig,
        env: EnvBase,
        actor: Learner,
        state: dict[str, Any],
    ) -> None:
        # A device, if there is one, is the learner's.
        actor.act_on("cpu")
        self.actor = actor
        # A simulated robot loses nothing by waiting, and would otherwise run far ahead.
        self._may_wait = config.hub == "virtual" and not config.realtime

        # The receiving thread sets what the process reports under this condition, and notifies it.
        self._changed = threading.Condition()
        self._is_ready = False
        # What went wrong in the process; empty while all is well.
        self._failure = ""
        # Of updates that `learn` has not returned yet.
        self._metrics: list[dict[str, Tensor]] = []

        # Robot steps with requested updates, and with completed ones.
        self._asked = state["pace"]["asked"]
        self._done = state["pace"]["done"]

        # Checkpoints that were requested, and those that are written.
        self._saves = 0
        self._saved = 0

        # What cannot be learned there is refused before there is a process.
        begin = self._first_message(config, env, state)
        self._start()
        self._send("begin", begin)

    def _start(self) -> None:
        """Start the learner's process."""
        try:
            # The process may report its end before it is kept: `_deliver` waits for the condition.
            with self._changed:
                self._process = ChildProcess("bricksrl.training.learner_side", self._deliver)
        except OSError as error:
            raise LearnerError(
                f"cannot start the learner's process ({error.strerror}); train synchronously"
            ) from None

    def _first_message(
        self,
        config: TrainConfig,
        env: EnvBase,
        state: dict[str, Any],
    ) -> dict[str, Any]:
        """What the process has to know: what to learn, and where to go on."""
        # The process makes the transforms of the config; those of a user's own environment it
        # cannot know, but a dataset has to pass through them.
        has_own_transforms = isinstance(env, TransformedEnv) and not config.is_transformed
        if config.dataset is not None and has_own_transforms:
            raise LearnerError(
                "the learner's process does not know this environment's transforms; train "
                "synchronously"
            )
        # Behind transforms, goals and mirrors of the task would seem to fit what they do not.
        has_task = interface_of(env).task is not None and changes_nothing(env)
        return {
            "config": config.to_dict(),
            "specs": {name: getattr(env, name).cpu() for name in SPECS},
            "layout": layout_of(env),
            "has_task": has_task,
            "state": {name: state[name] for name in ("agent", "pace", "collected", "transforms")},
        }

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the process after its pending work; soon, after Ctrl-C or an unexpected error."""
        is_in_order = error is None or isinstance(error, BricksError)
        # It may have ended already.
        with contextlib.suppress(OSError):
            self._process.send(*END)
        self._process.end(_END_TIMEOUT_S if is_in_order else _INTERRUPTED_TIMEOUT_S)

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

    def remember(
        self,
        frames: TensorDictBase,
        robot: int = 0,
    ) -> None:
        """Send frames to the learner."""
        # As plain tensors, which the pipe sends as arrays: torch's own format is slow.
        columns = dict(frames.flatten_keys(".").items())
        self._send("remember", (robot, columns))

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
        # Taken under the condition, as the receiving thread appends to them.
        with self._changed:
            metrics = self._metrics
            self._metrics = []
        return means(metrics)

    def save(
        self,
        path: Path,
        state: dict[str, Any],
    ) -> None:
        """Request a checkpoint; the learner writes it before it continues."""
        self._saves += 1
        self._send("save", (str(path.absolute()), state))

    def finish(self, go_on: Callable[[], bool]) -> None:
        """Wait for pending updates and checkpoints."""
        self._wait(lambda: self._done >= self._asked or not go_on())
        self._wait(lambda: self._saved >= self._saves)

    def _send(
        self,
        kind: str,
        content: Any,
    ) -> None:
        self._check()
        try:
            self._process.send(kind, content)
        except OSError:
            # The process has ended, and its last message, which says why, is still on its way.
            with self._changed:
                self._changed.wait_for(lambda: self._failure, _END_TIMEOUT_S)
            self._check()

    def _wait(self, is_true: Callable[[], bool]) -> None:
        """Wait for a condition that a message, or the process's death, brings about."""
        with self._changed:
            while not is_true():
                self._check()
                # Not for ever: `go_on` of `finish` changes without a message, by Ctrl-C.
                self._changed.wait(_CHECK_S)

    def _check(self) -> None:
        """Raise `LearnerError` if the process has failed or died."""
        if self._failure:
            raise LearnerError(
                f"the learner's process {self._failure}; resume the run from its last checkpoint"
            )

    def _deliver(self, message: Message | None) -> None:
        """Handle a message of the process, in the receiving thread; ``None`` is its end."""
        if message is None:
            message = ("failed", self._failure or self._death())
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

    def _death(self) -> str:
        """What the process died of."""
        # The constructor holds the condition until it has the process.
        with self._changed:
            process = self._process
        code = process.wait(_END_TIMEOUT_S)
        # As POSIX's `subprocess` tells of a process that a signal ended, such as that of the
        # kernel when memory is short.
        if code is not None and code < 0:
            return f"died (signal {-code})"
        return f"died (exit code {code})"


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
        # The robot's side is gone, so there is nobody to learn for.
        pass
    except Exception as error:  # noqa: BLE001  reported to the user by the robot's side
        # - a user's algorithm may raise anything
        with contextlib.suppress(BrokenPipeError):
            send("failed", f"failed ({message_of(error, typed=True)})")
    leave()


def serve(
    begin: dict[str, Any],
    inbox: Inbox,
    send: Send,
) -> None:
    """Learn until the robot's side ends the run or disconnects."""
    # The other cores are for the robot.
    torch.set_num_threads(1)
    config = TrainConfig.from_dict(begin["config"])
    started = begin["state"]
    asked = started["pace"]["asked"]
    # A run that is resumed draws on, instead of the same again.
    torch.manual_seed(derive_seed(config.seed, "learner", asked))
    env = _specs_of(begin, config)
    learner = make_learner_for(config, env)
    learner.load_state_dict(started["agent"])
    attach_dataset(config, learner, env)
    # Steps whose updates are pending are still to be learned from.
    done = started["pace"]["done"]
    side = InLoopLearner(learner, {**started, "pace": {"asked": done}})
    # They may hold a replay buffer, which the learner has now.
    del begin, started
    saves = 0
    send("ready", learner.policy_state())
    while True:
        # All messages come before the next update, so that it learns from the newest steps. Not
        # on-policy: what is learned from must be of the policy before the update, batch by batch.
        while side.pace.done >= asked or not (learner.on_policy or inbox.empty()):
            kind, content = inbox.get() or END
            match kind:
                case "remember":
                    robot, columns = content
                    frames = TensorDict(columns).auto_batch_size_(1).unflatten_keys(".")
                    side.remember(frames, robot)
                case "end_episodes":
                    side.end_episodes(content)
                case "learn":
                    asked += content
                case "save":
                    path, state = content
                    state["pace"] = {"asked": asked, "done": side.pace.done}
                    side.save(Path(path), state)
                    saves += 1
                    send("saved", saves)
                case "end":
                    return
        # One step's updates at a time, so that messages wait for no more than these.
        metrics = {name: value.cpu() for name, value in side.learn(1).items()}
        send("learned", (side.pace.done, metrics, learner.policy_state()))


def _specs_of(begin: dict[str, Any], config: TrainConfig) -> EnvBase:
    """What the learner has to know of the run's environment, without a robot."""
    if config.is_transformed:
        env = stand_in(config)
        load_transform_state(env, begin["state"]["transforms"])
        return env
    task = get_task(config.env, **config.options) if begin["has_task"] else None
    return SpecsEnv(begin["specs"], task, begin["layout"])


if __name__ == "__main__":
    main()
