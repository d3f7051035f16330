"""Robots on the page at once: a policy of arrays, or a human, moves one without TorchRL, which
takes seconds to load."""

import importlib
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np

from bricksrl.envs.robot_env import RobotEnv
from bricksrl.envs.task import Task
from bricksrl.envs.tasks.scripted import ArrayPolicy
from bricksrl.page.live import LivePage
from bricksrl.page.play import Steps, play_endlessly


class Judge:
    """Rewards and ends of an episode, by the task's functions of tensors. They need torch, which is
    loaded beside the motion; what was seen meanwhile is judged then.

    Attributes:
        total: return of the episode, as far as it is judged.
    """

    def __init__(self, task: Task) -> None:
        self._task = task
        self._torch: Future[Any] | None = None
        self.begin()

    def begin(self) -> None:
        """Begin an episode."""
        self._seen: list[tuple[Any, Any, Any]] = []
        self.total = 0.0
        self.rewards = list[float]()
        self.is_over = False

    def see(
        self,
        previous: Any,
        action: Any,
        observation: Any,
    ) -> None:
        """Judge a step, now or later: observation ``[n]`` before it, action ``[m]``, observation
        after it."""
        self._seen.append((previous, action, observation))
        if self._torch is None:  # the end of the process waits for the import
            self._torch = ThreadPoolExecutor(1, "bricksrl-torch").submit(
                importlib.import_module, "torch"
            )
        if self._torch.done():
            self.end()

    def end(self) -> float:
        """The return of the episode."""
        while self._seen and self._torch is not None:
            torch = self._torch.result()
            row = self._seen.pop(0)
            before, moved, after = (torch.tensor(values, dtype=torch.float32) for values in row)
            self.rewards.append(float(self._task.reward(before, moved, after)))
            self.total += self.rewards[-1]
            self.is_over = self.is_over or bool(self._task.terminated(after))
        return self.total


def play_robot(
    env: RobotEnv,
    page: LivePage,
    policies: Mapping[str, Callable[[], ArrayPolicy]],
    *,
    episodes: int | None = None,
    stop: threading.Event | None = None,
) -> list[float]:
    """Play as `play_endlessly`, with policies of arrays. While a human drives, only a reset ends an
    episode."""
    judge = Judge(env.task)
    made = dict[str, ArrayPolicy]()
    seen = slice(len(env.task.entries))  # without what only the task's functions get

    def action_of(inputs: Mapping[str, Any]) -> Any:
        if page.driver is not None and page.is_driven:
            return page.driver.shares()
        if page.policy not in made:
            made[page.policy] = policies[page.policy]()
        return made[page.policy](inputs)

    def episode(_number: str) -> Steps:
        observation = env.begin().observation
        steps = 0
        judge.begin()
        yield
        while page.is_driven or not (judge.is_over or steps >= env.task.max_steps):
            action = np.clip(
                action_of({"observation": observation[seen].copy()} | env.image()), -1.0, 1.0
            )
            previous = observation
            observation = env.move(action.tolist())
            judge.see(previous, action, observation)
            steps += 1
            reward = judge.rewards[-1] if judge.rewards else None
            page.show_outcome(
                observation[seen].tolist(),
                reward,
                judge.total,
                **env.image(),
            )
            yield
        return judge.end()

    return play_endlessly(
        env,
        page,
        episode,
        episodes=episodes,
        stop=stop,
    )
