"""Online learning: act, keep, learn, one step of the robot after the other."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase

from bricksrl.agents.agent import Transition, look
from bricksrl.errors import HubError
from bricksrl.training.observer import Phase
from bricksrl.training.reproducible import derive_seed

if TYPE_CHECKING:
    from bricksrl.data.collect import Driver

OnStep = Callable[[int], bool]
"""Told the number of the step that was made, from 1; returns whether to go on."""

OnTransition = Callable[[int, TensorDictBase], None]
"""Told the number of a step, from 1, and what the environment gave for it, before it is learned from."""


class Player(Protocol):
    """What `run_episode` asks of an agent, or of a learner that has one."""

    def start_acting(self) -> None:
        """As `Agent.start_acting`."""

    def act(self, observation: Tensor, *, explore: bool) -> Tensor:
        """As `Agent.act`."""

    def remember(self, transition: Transition) -> None:
        """As `Agent.remember`."""

    def end_episode(self) -> None:
        """As `Agent.end_episode`."""

    def update(self) -> dict[str, float]:
        """As `Agent.update`."""


@dataclass(frozen=True)
class Rollout:
    """One episode.

    Attributes:
        rewards: ``[length]``.
        observations: those ``[length, n]`` that followed its steps.
        losses: means by name.
        link_error: how the link to the robot broke; ``None`` for a whole episode.
    """

    rewards: Tensor
    observations: Tensor
    losses: dict[str, float]
    link_error: HubError | None = None

    @property
    def length(self) -> int:
        """Steps."""
        return self.rewards.shape[0]

    @property
    def return_(self) -> float:
        """Sum of the rewards."""
        return float(self.rewards.sum())


def seed_episode(env: EnvBase, seed: int, purpose: str, episode: int) -> None:
    """Make the next episode of ``env`` depend on nothing but these arguments and the actions.

    That is what lets an interrupted run go on as if nothing had happened: of the environment there is nothing to save.
    """
    # many environments seed torch's global generator here, which the agent draws from: leave it as it was
    state = torch.get_rng_state()
    env.set_seed(derive_seed(seed, purpose, episode))
    torch.set_rng_state(state)


class EpisodeStoppedError(Exception):
    """`run_episode` was asked to stop; nothing outside of the package sees this."""


def run_episode(
    env: EnvBase,
    agent: Player,
    state: TensorDictBase,
    phase: Phase | None,
    on_step: OnStep | None = None,
    on_transition: OnTransition | None = None,
    driver: Driver | None = None,
) -> Rollout:
    """One episode from ``state``, which a reset gave, to its end.

    In PREFILL actions are uniform, in TRAIN the agent explores and learns after each step; without a phase it does its best
    and neither keeps nor learns anything.

    A ``driver`` is asked first at each step; where it chooses the action, the agent learns from that one, and the step's entry
    "intervention" says so.

    Where the link to the robot breaks while it learns, the episode ends with the step before: what was remembered of it stays,
    and nothing across the gap is ever remembered.

    Raises:
        HubError: the link broke, and there is no phase.
        EpisodeStoppedError: ``on_step`` asked to stop before the end.
    """
    rewards: list[float] = []
    observations: list[Tensor] = []
    losses: defaultdict[str, list[float]] = defaultdict(list)
    action_size = int(env.action_spec.shape[-1])
    link_error: HubError | None = None
    done = False
    agent.start_acting()
    while not done:
        observation = look(agent, state)
        chosen = None if driver is None else driver(state["observation"])
        if chosen is not None:
            action = chosen
            agent.start_acting()
        elif phase is Phase.PREFILL:
            action = 2.0 * torch.rand(action_size) - 1.0
        else:
            action = agent.act(observation, explore=phase is Phase.TRAIN)
        state["action"] = action
        if driver is not None:
            state["intervention"] = torch.tensor(chosen is not None)
        try:
            state = env.step(state)
        except HubError as error:
            if phase is None:
                raise
            if rewards:
                agent.end_episode()
            link_error = error
            break
        if on_transition is not None:
            on_transition(len(rewards) + 1, state)
        outcome = state["next"]
        reward, terminated, done = (outcome[key].item() for key in ("reward", "terminated", "done"))
        if phase is not None:
            agent.remember(Transition(observation, action, reward, look(agent, outcome), bool(terminated), bool(done)))
        if phase is Phase.TRAIN:
            for name, value in agent.update().items():
                losses[name].append(value)
        rewards.append(reward)
        observations.append(outcome["observation"])
        if on_step is not None and not on_step(len(rewards)) and not done:
            raise EpisodeStoppedError
        state = env.step_mdp(state)
    means = {name: sum(values) / len(values) for name, values in losses.items()}
    seen = torch.stack(observations) if observations else torch.empty(0, 0)
    return Rollout(torch.tensor(rewards), seen, means, link_error)


def is_success(env: EnvBase, rollout: Rollout) -> bool | None:
    """Whether the task calls the episode a success; ``None`` for an environment without a task of ours."""
    task = getattr(env, "task", None)
    return None if task is None else bool(task.success(_judged(env, rollout)))


def _judged(env: EnvBase, rollout: Rollout) -> Tensor:
    """The observations as the task's functions get them; the rollout is the last that ``env`` made."""
    judged = getattr(env, "judged", None)
    return rollout.observations if judged is None else judged(rollout.observations)


def task_metrics(env: EnvBase, rollout: Rollout) -> dict[str, float]:
    """The task's own numbers about the episode; none for an environment without a task of ours."""
    task = getattr(env, "task", None)
    if task is None:
        return {}
    own = {name: float(value) for name, value in task.metrics(_judged(env, rollout)).items()}
    walk = getattr(env, "walk_metrics", None)
    return own if walk is None else {**own, **walk()}
