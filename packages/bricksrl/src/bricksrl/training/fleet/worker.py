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

from brickhub.user_files import line_of_user
from bricksrl.agents.learner import Learner
from bricksrl.child_process import END, Message, leave, parent_channel
from bricksrl.data.collect import about, step_of
from bricksrl.envs.env_interface import BricksEnv
from bricksrl.envs.make import make
from bricksrl.envs.rollout import Rollout, play
from bricksrl.envs.transforms import load_transform_state, over
from bricksrl.errors import StoppedError, message_of
from bricksrl.training.config import TrainConfig
from bricksrl.training.learners import make_learner_for, stand_in


class _FleetEnded(BaseException):
    """The fleet ended or disconnected."""


class Worker:
    """One robot: messages in, frames out. ``send``: sends a message to the fleet; set after
    construction."""

    send: Callable[..., None]

    def __init__(self) -> None:
        self._inbox: SimpleQueue[Message] = SimpleQueue()
        self._ended = threading.Event()
        self._weights: deque[dict[str, Any]] = deque(maxlen=1)
        self._env = BricksEnv()
        self._cut_until_s = 0.0

    def receive(self, message: Message | None) -> None:
        """Handle a message, in the receiving thread; ``None`` means that the fleet is gone."""
        content: Any
        kind, content = message or END
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
            pass
        except Exception as error:  # noqa: BLE001  raised in the run's process
            with contextlib.suppress(BrokenPipeError):  # the fleet is gone meanwhile
                self.send(
                    "failed", (type(error).__name__, message_of(error, 500) + line_of_user(error))
                )

    def _prepare(self, begin: dict[str, Any]) -> tuple[EnvBase, Learner]:
        torch.set_num_threads(1)
        config = TrainConfig.from_dict(begin["config"])
        torch.manual_seed(begin["seed"])
        robot: Any = make(
            config.env,
            config.as_it_is(),
            seed=config.seed,
            place=self._place if begin["is_placed"] else None,
        )
        # what is drawn, no real robot is moved for
        env = over(stand_in(config), robot) if config.is_transformed else robot
        load_transform_state(env, begin["transforms"])
        actor = make_learner_for(config, env, device="cpu")
        actor.weights = self._weights
        robot.reconnect.patience_s = float("inf")
        robot.reconnect.wait = self._wait
        robot.reconnect.on_error = lambda error: self.send("out", str(error))
        robot.in_reach = lambda: time.monotonic() >= self._cut_until_s
        self._env = robot
        return env, actor

    def _episode(
        self, env: Any, actor: Learner, begin: dict[str, Any], order: dict[str, Any]
    ) -> None:
        """One episode; ends early if the link breaks."""
        rollout = Rollout()
        is_random = order["is_random"]
        env.set_seed(order["seed"])
        state = env.reset()
        description = about(env, order["policy"], seed=order["seed"], hub=begin["config"]["hub"])
        self.send("begun", description)
        policy = RandomPolicy(env.action_spec) if is_random else actor.explore
        for frame in play(env, policy, state, reset_policy=actor.reset_policy):
            before = len(rollout.rewards)
            own = rollout.add(frame, env)
            steps = [step_of(step, env) for step in own] if begin["is_recorded"] else []
            parts = (frame,) if not own or own[-1] is frame else (frame, own[-1])
            # within an episode only
            rows = [dict(part.exclude("link_lost").flatten_keys(".").items()) for part in parts]
            self.send("frame", (rows, steps, rollout.rewards[before:]))
            if begin["is_paced"]:
                self._next_message("go")
            if self._ended.is_set():
                raise _FleetEnded
        self.send("ended", (*rollout.judged(env), rollout.is_lost, env.is_cut))

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
