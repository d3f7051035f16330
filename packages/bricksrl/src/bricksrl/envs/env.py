"""The environment: one task, run over one link to a hub."""

import logging
import math
from collections.abc import Callable
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Binary, Bounded
from torchrl.envs import EnvBase, ParallelEnv

from brickhub.entry import Entry
from bricksrl.envs.connection import Connection
from bricksrl.envs.env_interface import BricksEnv
from bricksrl.envs.episode_state import EpisodeState
from bricksrl.envs.robot_env import RobotEnv
from bricksrl.envs.specs import set_vector_specs
from bricksrl.envs.task import Task, never
from bricksrl.errors import BricksError, CameraError, DescriptionError, HubError, HubProgramError

BLOCKED_TIMEOUT_S = 120.0
"""Time that a blocked robot waits for the obstacle to be removed."""

_log = logging.getLogger(__name__)


class HubEnv(RobotEnv, EnvBase):  # type: ignore[misc]
    """A task on a robot, as a TorchRL environment without batch dimensions.

    ===============  =======  =======  =====================================================
    key              shape    dtype    meaning
    ===============  =======  =======  =====================================================
    ``observation``  ``[n]``  float32  channels in order, then the host's entries
    ``image``        below    uint8    only for a task with a camera: ``[side, side, 3]``
    ``action``       ``[m]``  float32  in -1..1, mapped linearly to the command ranges;
                                       values outside are clamped
    ``reward``       ``[1]``  float32  reward of the task
    ``terminated``   ``[1]``  bool     end defined by the task
    ``truncated``    ``[1]``  bool     time limit, pause or lost link
    ``done``         ``[1]``  bool     terminated or truncated
    ``link_lost``    ``[1]``  bool     the link broke in this step
    ===============  =======  =======  =====================================================

    A reset places the robot and reads its sensors; it moves no motor. The first reset opens the
    link. A link or a camera that breaks in a step raises nothing: the link is closed, so that the
    motors stop, and the step ends the episode as truncated and ``link_lost``, with the previous
    observation and images; it must not be learned from. The next reset reopens the link, with
    retries as ``reconnect`` says.

    ``stop``, ``pause`` and ``resume`` may be called from any thread. A pause truncates the episode
    after the current step, so that no step spans it; the next reset waits for the end of the pause.

    Args:
        task: the task to run.
        connect: returns the connection, given a seed for a virtual robot. Called when the robot is
            first needed, and for a virtual robot again after each new seed, so that it starts from
            the same state.
        seed: seed of all random numbers; ``None`` for a fresh one.
    """

    def __init__(
        self,
        task: Task,
        connect: Callable[[int], Connection],
        *,
        seed: int | None = None,
    ) -> None:
        super().__init__(
            task,
            connect,
            seed=seed,
            batch_size=(),
        )
        self._entries = len(task.entries)
        set_vector_specs(self, task)
        self.observation_spec["link_lost"] = Binary(1, dtype=torch.bool)
        for key, side_px in task.images.items():
            self.observation_spec[key] = Bounded(
                0,
                255,
                (side_px, side_px, 3),
                dtype=torch.uint8,
            )
        self.is_closed = False
        self.outside: dict[str, float] = {}
        """Entries that a client of the user's own answered outside of their ranges, each with the
        first such value."""

    def close(
        self,
        *,
        raise_if_closed: bool = True,
        **_: Any,
    ) -> None:
        """Stop the robot and close the link. May be called twice; a reset opens the link again."""
        EnvBase.close(self, raise_if_closed=raise_if_closed)
        self._close_link()

    def _reset(
        self,
        _tensordict: TensorDictBase | None = None,
        **_kwargs: Any,
    ) -> TensorDictBase:
        return self.reconnect.until_answered(
            self._begin,
            # A virtual hub's program is deterministic, so retrying would fail again.
            is_final=lambda error: isinstance(error, HubProgramError) and self.twin is not None,
        )

    def _begin(self) -> TensorDictBase:
        episode = self.begin()
        self.is_closed = False
        episode.observation = self._within(torch.from_numpy(episode.observation))
        return self._out(episode)

    def _within(self, observation: torch.Tensor) -> torch.Tensor:
        """An observation in the ranges of its entries; the first value of each that a client
        answers outside is said. Answers of our own program are in their ranges."""
        if self.task.client is None:
            return observation
        values = observation.tolist()
        for index, entry in enumerate(self.task.entries):
            low, high = entry.bounds
            value = values[index]
            if not math.isfinite(value):
                # A number that is not finite is left for the check of the environment to name.
                continue
            values[index] = min(max(value, low), high)
            if values[index] != value and entry.name not in self.outside:
                self.outside[entry.name] = value
                text = outside_text(entry, value)
                _log.warning("%s: %s; it is cut to this range from now on", self.task.id, text)
        return observation.new_tensor(values)

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        episode = self._episode
        age_s = 0.0 if episode is None else episode.age_s
        try:
            out = self._act(tensordict)
        except (HubError, CameraError) as error:
            if episode is None:
                raise
            # The age is that of the last step that has an outcome.
            episode.age_s = age_s
            self.link_error = error
            self.reconnect.failed(error)
            # Each end is a tensor of its own, because a caller may change one of them.
            ends = {
                "terminated": torch.zeros(1, dtype=torch.bool),
                "truncated": torch.ones(1, dtype=torch.bool),
                "done": torch.ones(1, dtype=torch.bool),
                "link_lost": torch.ones(1, dtype=torch.bool),
            }
            return self._out(episode, reward=torch.zeros(1), **ends)
        self.reconnect.recovered()
        return out

    def _act(self, tensordict: TensorDictBase) -> TensorDictBase:
        # The agent's tensor must not change, so a copy is clamped.
        action = tensordict["action"].detach().cpu().clamp(-1.0, 1.0)
        task = self.task
        episode = self._episode
        if action.shape != (len(self._spans),):
            raise BricksError(
                f"{task.id} got an action of shape {list(action.shape)}; give [{len(self._spans)}]"
            )
        if episode is None:
            raise BricksError(f"{task.id} has no episode to step; reset the environment first")
        # This comes before the action, because a motor must not push against what is in the way.
        self._wait_while_blocked(episode)
        observation, reward, terminated = self._outcome(episode, action)
        self._check_outcome(
            episode,
            observation,
            reward,
            terminated,
        )
        observation = self._within(observation)
        episode.observation = observation
        episode.images = self.image()
        episode.step_count += 1
        episode.rewards.append(float(reward))
        # A pause begins only after the step, so that no step spans one.
        if self._is_paused:
            episode.is_cut = True
            self._guarded(self._connected().link.rest)
        is_truncated = episode.is_cut or episode.step_count >= task.max_steps
        truncated = torch.full_like(terminated, is_truncated)
        if task.has_hidden_entries:
            judged = _with_truth(episode, observation, self._entries)
            episode.task_observations.append(judged)
        return self._out(
            episode,
            reward=reward,
            terminated=terminated,
            truncated=truncated,
            done=terminated | truncated,
        )

    def _check_outcome(
        self,
        episode: EpisodeState,
        observation: torch.Tensor,
        reward: torch.Tensor,
        terminated: torch.Tensor,
    ) -> None:
        """Raise DescriptionError for a reward or an end that no agent can learn from."""
        task = self.task
        # Numbers are checked one by one, because an operation of torch costs more than the check.
        if not all(map(math.isfinite, reward.flatten().tolist())):
            raise DescriptionError(
                f"the reward of {task.id} is {reward.tolist()} in step {episode.step_count + 1}, "
                "where the observation is "
                f"{observation.tolist()}; correct the task's reward"
            )
        if terminated.dtype is not torch.bool:
            raise DescriptionError(
                f"terminated of {task.id} is {terminated.tolist()}, not true or false; compare"
            )

    def _outcome(
        self,
        episode: EpisodeState,
        action: torch.Tensor,
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Hook: carry out the action; the observation after it, the reward and whether the episode
        is over."""
        task = self.task
        observation = torch.from_numpy(self.move(action.tolist()))
        reward = task.reward(episode.observation, action, observation)
        terminated = task.terminated(observation)
        return (
            observation,
            _single(task, "reward", reward),
            _single(task, "terminated", terminated),
        )

    def _out(
        self,
        episode: EpisodeState,
        **outcome: torch.Tensor,
    ) -> TensorDictBase:
        """Output of a reset or, with its outcome, of a step; copied, as a caller's change must not
        alter ``episode``."""
        out = {
            "observation": episode.observation[: self._entries].clone(),
            "link_lost": torch.zeros(1, dtype=torch.bool),
        }
        out |= {name: torch.tensor(image) for name, image in episode.images.items()}
        return TensorDict({**out, **outcome}, batch_size=(), device=self.device)

    def _step_proc_data(self, next_tensordict_out: TensorDictBase) -> TensorDictBase:
        """Skip TorchRL's completion of ``_step``'s output, unless a task's functions return shapes
        that it has to correct."""
        reward = next_tensordict_out.get("reward")
        terminated = next_tensordict_out.get("terminated")
        if reward.shape == terminated.shape == (1,):
            return next_tensordict_out
        return super()._step_proc_data(next_tensordict_out)

    def _wait_while_blocked(self, episode: EpisodeState) -> None:
        """Read without moving until the task is no longer blocked; reading feeds the hub's
        watchdog. Raises HubError if still blocked after two minutes."""
        if self.task.blocked is never or not self.task.blocked(episode.observation):
            return
        link = self._connected().link
        _log.warning(
            "%s: something is in the robot's way; it waits until that is gone",
            self.task.id,
        )
        waited_s = 0.0
        while bool(self.task.blocked(episode.observation)):
            if waited_s > BLOCKED_TIMEOUT_S:
                self._close_link()
                raise HubError(
                    f"{self.task.id}: something is in the robot's way for {BLOCKED_TIMEOUT_S:g} "
                    "s; clear it and go on"
                )
            reading = self._guarded(link.read)
            waited_s += reading.round_trip_s
            episode.observation = torch.from_numpy(self._measure(reading, episode))

    def task_observations(self, observations: torch.Tensor) -> torch.Tensor:
        """Input of the task's success and metrics for the observations ``[steps, n]`` of the whole
        current episode. Raises BricksError if the number of observations is not that of the current
        episode's steps.

        These are the observations; where the task's camera has a goal, with the camera's two
        distances appended; where the task has a target, with the true pose of a virtual robot.
        """
        if not self.task.has_hidden_entries:
            return observations
        stored = [] if self._episode is None else self._episode.task_observations
        if len(stored) != len(observations):
            raise BricksError(
                f"{self.task.id} judges an episode before the next reset, and not "
                f"{len(observations)} other steps"
            )
        return torch.stack(stored)


def outside_text(entry: Entry, value: float) -> str:
    """Message about a value outside of its entry's range."""
    low, high = entry.bounds
    return f"{entry.name} is {value:g}, outside of {low:g} to {high:g} {entry.unit}".rstrip()


def _with_truth(
    episode: EpisodeState,
    observation: torch.Tensor,
    end: int,
) -> torch.Tensor:
    """The observation with the target's entries, which end at index ``end``, replaced by their true
    values."""
    if episode.tracker is None:
        return observation
    truth = torch.tensor(episode.tracker.truth(), dtype=observation.dtype)
    before = observation[: end - len(truth)]
    after = observation[end:]
    return torch.cat((before, truth, after))


def _single(
    task: Task,
    name: str,
    value: Any,
) -> torch.Tensor:
    """The number that a function of a task returns for one observation. Raises DescriptionError
    unless it is a tensor with one number."""
    if not isinstance(value, torch.Tensor) or value.numel() != 1:
        given = f"of shape {list(value.shape)}" if isinstance(value, torch.Tensor) else repr(value)
        raise DescriptionError(
            f"{name} of {task.id} is {given}; compute a tensor of shape [1] from the observation"
        )
    return value


class Processes(BricksEnv, ParallelEnv):  # type: ignore[misc]
    """Virtual robots, each in a process; nothing of a single one is reached from here."""
