"""Rollout: one episode, frame by frame; training, evaluation, recording and filming all play episodes by this loop."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import torch

from bricksrl.seed import derive_seed

if TYPE_CHECKING:
    from tensordict import TensorDictBase
    from torch import Tensor
    from torchrl.envs import EnvBase

Policy = Callable[["TensorDictBase"], "TensorDictBase"]
"""A policy as TorchRL has it: writes "action" ``[m]``, in -1..1, to what the environment shows."""


class Driver(Protocol):
    """A human, or a program in the place of one, who may choose the action."""

    def __call__(self, observation: Tensor) -> Tensor | None:
        """An action ``[m]`` in -1..1 for an observation ``[n]``, or ``None`` to leave this step to the policy."""


def play(
    env: EnvBase,
    policy: Policy,
    start: TensorDictBase | None = None,
    *,
    driver: Driver | None = None,
    reset_policy: Callable[[], None] = lambda: None,
) -> Iterator[TensorDictBase]:
    """The frames of one episode as TorchRL's ``EnvBase.step`` returns them: what was seen and done, and "next" what followed.

    Args:
        start: what a reset gave; without it the environment is reset.
        driver: asked first at each step; "intervention" then says whether the action was the driver's.
        reset_policy: called when what the policy sees next does not follow from its last action: an episode starts, or the driver
            has chosen one.

    Raises:
        HubError: the robot cannot be reached for the start of the episode.
    """
    state = env.reset() if start is None else start
    reset_policy()
    done = False
    while not done:
        chosen = None if driver is None else driver(state["observation"])
        if chosen is not None:
            reset_policy()
        state = policy(state) if chosen is None else state.set("action", chosen)
        if driver is not None:
            state["intervention"] = torch.tensor(chosen is not None)
        frame = env.step(state)
        done = bool(frame["next", "done"])
        yield frame
        state = env.step_mdp(frame)


def seed_episode(env: EnvBase, seed: int, purpose: str, episode: int) -> None:
    """Make the next episode of ``env`` depend on nothing but these arguments and the actions.

    That is what lets an interrupted run go on as if nothing had happened: of the environment there is nothing to save.
    """
    # many environments seed torch's global generator here, which the policy draws from: leave it as it was
    state = torch.get_rng_state()
    env.set_seed(derive_seed(seed, purpose, episode))
    torch.set_rng_state(state)


def link_lost(frame: TensorDictBase) -> bool:
    """Whether the link to the robot broke at a frame, which then has no outcome."""
    lost = frame["next"].get("link_lost", None)
    return lost is not None and bool(lost)


@dataclass
class Rollout:
    """The rewards, actions and observations of an episode, as its frames come in.

    Attributes:
        rewards: one for each step.
        action_sizes: mean absolute value of each step's action, in 0..1.
        observations: those ``[n]`` that followed the steps.
        is_lost: whether the link to the robot broke; that frame does not count.
    """

    rewards: list[float] = field(default_factory=list)
    action_sizes: list[float] = field(default_factory=list)
    observations: list[Tensor] = field(default_factory=list)
    is_lost: bool = False

    def add(self, frame: TensorDictBase) -> None:
        """Count a frame."""
        if link_lost(frame):
            self.is_lost = True
            return
        self.rewards.append(float(frame["next", "reward"]))
        self.action_sizes.append(float(frame["action"].abs().mean()))
        self.observations.append(frame["next", "observation"])

    @property
    def action_size(self) -> float:
        """Mean absolute value of the actions, in 0..1."""
        return sum(self.action_sizes) / max(1, len(self.action_sizes))

    @property
    def return_(self) -> float:
        """Sum of the rewards."""
        return float(torch.tensor(self.rewards).sum())

    def success(self, env: EnvBase) -> bool | None:
        """Whether the task calls this, the last episode of ``env``, a success; ``None`` without a task of ours or a step."""
        task = getattr(env, "task", None)
        return None if task is None or not self.rewards else bool(task.success(self._judged(env)))

    def metrics(self, env: EnvBase) -> dict[str, float]:
        """The task's own numbers about this, the last episode of ``env``; none for an environment without a task of ours."""
        task = getattr(env, "task", None)
        if task is None or not self.rewards:
            return {}
        own = {name: float(value) for name, value in task.metrics(self._judged(env)).items()}
        walk = getattr(env, "walk_metrics", None)
        return own if walk is None else {**own, **walk()}

    def _judged(self, env: EnvBase) -> Tensor:
        """The observations ``[steps, n]`` as the task's functions get them."""
        observations = torch.stack(self.observations)
        judged = getattr(env, "judged", None)
        return observations if judged is None else judged(observations)


@dataclass(frozen=True)
class Judged:
    """An episode, and what its task says of it, which has to be asked before the next reset."""

    return_: float
    length: int
    action_size: float
    success: bool | None
    metrics: dict[str, float]


def play_episodes(
    env: EnvBase, policy: Policy, episodes: int, seed: int, *, reset_policy: Callable[[], None] = lambda: None
) -> Iterator[Judged]:
    """Whole episodes; episode ``k`` depends on ``seed``, ``k`` and the policy only. Copies of a simulation play side by side.

    Raises:
        HubError: the link to the robot broke.
    """
    if env.batch_size:
        yield from _play_copies(env, policy, episodes, seed)
        return
    for number in range(1, episodes + 1):
        episode: Rollout | None = None
        while episode is None or getattr(env, "is_cut", False):  # a pause cuts an episode short: it does not count
            episode = Rollout()
            seed_episode(env, seed, "evaluation", number)
            for frame in play(env, policy, reset_policy=reset_policy):
                episode.add(frame)
            if episode.is_lost:
                raise env.link_error
        yield Judged(episode.return_, len(episode.rewards), episode.action_size, episode.success(env), episode.metrics(env))


def _play_copies(env: EnvBase, policy: Policy, episodes: int, seed: int) -> Iterator[Judged]:
    """The first episode of each copy, until there are so many."""
    copies = env.batch_size.numel()
    for start in range(0, episodes, copies):
        seed_episode(env, seed, "evaluation", 1 + start)
        rollout = env.rollout(env.task.max_steps, policy, break_when_any_done=False).cpu()
        frames, sizes = rollout["next"], rollout["action"].abs().mean(-1)
        done = frames["done"].squeeze(-1)
        lengths = torch.where(done.any(-1), done.int().argmax(-1) + 1, done.shape[-1])
        for copy in range(min(copies, episodes - start)):
            whole = frames[copy, : int(lengths[copy])]
            success, metrics = env.task.success(whole["observation"]), env.task.metrics(whole["observation"])
            numbers = {name: float(value) for name, value in metrics.items()}
            size = float(sizes[copy, : len(whole)].mean())
            yield Judged(float(whole["reward"].sum()), len(whole), size, bool(success), numbers)
