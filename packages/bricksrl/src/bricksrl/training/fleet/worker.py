"""Process of one robot of a fleet: ``python -m bricksrl.training.fleet.worker``, started by
`Fleet`.

It has the robot's link, environment and a copy of the policy, runs the assigned episodes and sends
each frame. An unreachable robot is retried until the run ends.
"""

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any

import numpy as np
import torch
from torchrl.envs import EnvBase
from torchrl.modules import RandomPolicy

from brickhub.user_lines import line_of_user
from bricksrl.agents.learner import Learner
from bricksrl.child_process import END, Message, leave, parent_channel
from bricksrl.data.collect import about, step_of
from bricksrl.data.steps import Step
from bricksrl.envs.env_interface import BricksEnv
from bricksrl.envs.make import make
from bricksrl.envs.rollout import Rollout, play
from bricksrl.envs.transforms import load_transform_state, over
from bricksrl.errors import StoppedError, message_of
from bricksrl.training.config import TrainConfig
from bricksrl.training.learners import make_learner_for, stand_in


class _FleetEnded(BaseException):
    """The fleet ended or disconnected; no Exception, so that nothing on its way takes it for a
    failure of the robot."""


class Worker:
    """One robot: messages in, frames out. ``send``: sends a message to the fleet; set after
    construction."""

    send: Callable[..., None]

    def __init__(self) -> None:
        self._inbox: SimpleQueue[Message] = SimpleQueue()
        self._ended = threading.Event()
        # Only the newest weights are kept, so that a slow robot does not act with older ones in
        # turn.
        self._weights: deque[dict[str, Any]] = deque(maxlen=1)
        # Until the robot is made this stands for it. The fleet repeats a stop that comes earlier.
        self._env = BricksEnv()
        # Until this monotonic time the link is held cut, to try out what follows.
        self._cut_until_s = 0.0

    def receive(self, message: Message | None) -> None:
        """Handle a message, in the receiving thread; ``None`` means that the fleet is gone."""
        content: Any
        kind, content = message or END
        # What must not wait for the end of an episode is handled here, and the rest in order by
        # `run`.
        match kind:
            case "weights":
                self._weights.append(content)
            case "cut":
                self._cut_until_s = time.monotonic() + content
            case "stop":
                self._env.stop()
            case "pause":
                self._env.pause()
            case "resume":
                self._env.resume()
            case "end":
                # The end is told twice, because `run` may wait for a message or for a robot that is
                # out of reach.
                self._ended.set()
                self._inbox.put((kind, content))
            case _:
                self._inbox.put((kind, content))

    def run(self) -> None:
        """Run episodes until the end."""
        try:
            _, begin = self._next_message()
            env, actor = self._prepare(begin)
            try:
                self.send("ready")
                while True:
                    _, order = self._next_message("episode")
                    self._episode(env, actor, begin, order)
            finally:
                env.close(raise_if_closed=False)
        except (_FleetEnded, BrokenPipeError, StoppedError):
            # The run, its process, or the robot was ended by its user, so nothing has failed.
            pass
        except Exception as error:  # noqa: BLE001  raised in the run's process
            # The traceback of another process would not show where the user's code failed, so its
            # line goes along.
            reason = message_of(error, 500) + line_of_user(error)
            # The fleet may be gone in the meantime.
            with contextlib.suppress(BrokenPipeError):
                self.send("failed", (type(error).__name__, reason))

    def _prepare(self, begin: dict[str, Any]) -> tuple[EnvBase, Learner]:
        # Each robot has a process, and together they would want more cores than there are.
        torch.set_num_threads(1)
        config = TrainConfig.from_dict(begin["config"])
        torch.manual_seed(begin["seed"])
        place = self._place if begin["is_placed"] else None
        robot: Any = make(
            config.env,
            config.as_it_is(),
            seed=config.seed,
            place=place,
        )
        # Some transforms measure when they are made. They do so on a stand-in, so that no real
        # robot is moved for it.
        env = over(stand_in(config), robot) if config.is_transformed else robot
        load_transform_state(env, begin["transforms"])
        actor = make_learner_for(config, env, device="cpu")
        # The deque is shared: the receiving thread puts new weights there, and the next action
        # takes them.
        actor.weights = self._weights
        # The fleet decides when to give up, because it knows the other robots.
        robot.reconnect.patience_s = float("inf")
        robot.reconnect.wait = self._wait
        robot.reconnect.on_error = lambda error: self.send("out", str(error))
        robot.in_reach = lambda: time.monotonic() >= self._cut_until_s
        self._env = robot
        return env, actor

    def _episode(
        self,
        env: Any,
        actor: Learner,
        begin: dict[str, Any],
        order: dict[str, Any],
    ) -> None:
        """One episode; ends early if the link breaks."""
        rollout = Rollout()
        env.set_seed(order["seed"])
        state = env.reset()
        description = about(
            env,
            order["policy"],
            seed=order["seed"],
            hub=begin["config"]["hub"],
        )
        self.send("begun", description)
        policy = RandomPolicy(env.action_spec) if order["is_random"] else actor.explore
        for frame in play(
            env,
            policy,
            state,
            reset_policy=actor.reset_policy,
        ):
            rewards_before = len(rollout.rewards)
            own_frames = rollout.add(frame, env)
            steps: list[Step] = []
            if begin["is_recorded"]:
                steps = [step_of(own_frame, env) for own_frame in own_frames]
            # `on_transition` wants the last step of the robot itself, which is sent only once if it
            # is the frame.
            frames = [frame]
            if own_frames and own_frames[-1] is not frame:
                frames.append(own_frames[-1])
            columns = [_columns(part) for part in frames]
            self.send("frame", (columns, steps, rollout.rewards[rewards_before:]))
            # In simulated time a robot waits for the learner, because it would otherwise run ahead
            # of it.
            if begin["is_paced"]:
                self._next_message("go")
            if self._ended.is_set():
                raise _FleetEnded
        success, measures = rollout.judged(env)
        self.send("ended", (success, measures, rollout.is_lost, env.is_cut))

    def _place(self, _rng: np.random.Generator) -> None:
        self.send("place")
        self._next_message("placed")

    def _next_message(self, expected: str | None = None) -> tuple[str, Any]:
        """The next message, of a given kind. Raises _FleetEnded if the fleet ended."""
        while True:
            message = self._inbox.get()
            if message[0] == END[0]:
                raise _FleetEnded
            if expected is None or message[0] == expected:
                return message

    def _wait(self, duration_s: float) -> None:
        if self._ended.wait(duration_s):
            raise _FleetEnded


def _columns(frame: Any) -> dict[str, Any]:
    """The tensors of a frame by their whole names."""
    # The link's state after a reset belongs to no step, but that of the outcome, below "next",
    # stays.
    return dict(frame.exclude("link_lost").flatten_keys(".").items())


def main() -> None:
    """Entry point of the process."""
    worker = Worker()
    worker.send = parent_channel(worker.receive)
    try:
        worker.run()
    finally:
        leave()


if __name__ == "__main__":
    main()
