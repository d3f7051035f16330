"""Rollout: the one episode loop of training, evaluation, recording and filming."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Protocol

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase

from brickhub.seed import EpisodeKind, episode_seed
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.task import Task, metrics_of, success_of
from bricksrl.envs.transforms import changes_nothing, own_frames, own_state
from bricksrl.errors import DescriptionError, HubError

TRIES = 5
"""Tries of an evaluated or a recorded episode in which the link may break."""

Policy = Callable[["TensorDictBase"], "TensorDictBase"]
"""A TorchRL policy: writes "action" ``[m]``, in -1..1, into the environment's tensordict."""


class Driver(Protocol):
    """A human, or a program in place of one, that may override the policy's action."""

    def __call__(self, observation: Tensor) -> Tensor | None:
        """Action ``[m]`` in -1..1 for an observation ``[n]``, or ``None`` to leave this step to the
        policy."""


def play(
    env: EnvBase,
    policy: Policy,
    start: TensorDictBase | None = None,
    *,
    driver: Driver | None = None,
    reset_policy: Callable[[], None] = lambda: None,
    goes_on: Callable[[], bool] = lambda: False,
) -> Iterator[TensorDictBase]:
    """Play one episode and yield its frames, as ``EnvBase.step`` returns them: observation and
    action, and "next" the outcome. Raises HubError if the robot cannot be reached at the start of
    the episode.

    Args:
        start: the output of a reset; without it the environment is reset.
        driver: asked first at each step; "intervention" then tells whether the action was the
            driver's.
        reset_policy: called when the next observation does not follow from the policy's last
            action: at the start of the episode, and when the driver chose an action.
        goes_on: asked at the end of the episode: whether the robot goes on without a reset, as
            while a human drives.
    """
    state = env.reset() if start is None else start
    reset_policy()
    done = False
    while not done:
        # A driver sees what the robot observes, and not what transforms make of it.
        driver_action = None if driver is None else driver(own_state(env, state)["observation"])
        if driver_action is None:
            state = policy(state)
        else:
            reset_policy()
            state = state.set("action", driver_action)
        if driver is not None:
            state["intervention"] = torch.tensor(driver_action is not None)
        frame = env.step(state)
        # This is read before the frame is given away, because its receiver may change it.
        done = bool(frame["next", "done"]) and not goes_on()
        yield frame
        state = env.step_mdp(frame)


def seed_episode(env: EnvBase, seed: int) -> None:
    """Seed the next episode of ``env`` so that it depends only on the seed and the actions.

    An interrupted run can therefore resume exactly, without saving any state of the environment.
    """
    # Many environments seed torch's global generator here. The policy draws from it, so its state
    # is restored.
    state = torch.get_rng_state()
    env.set_seed(seed)
    torch.set_rng_state(state)


def link_lost(frame: TensorDictBase) -> bool:
    """Whether the link to the robot broke in a frame, which then has no valid outcome."""
    lost = lost_links(frame)
    return lost is not None and bool(lost)


def lost_links(frames: TensorDictBase) -> Tensor | None:
    """Frames with a lost link, or ``None`` if there is no link."""
    lost: Tensor | None = frames["next"].get("link_lost", None)
    return None if lost is None else lost.squeeze(-1)


def with_outcome(frames: TensorDictBase, lost: Tensor | None) -> TensorDictBase:
    """Frames as rows, without those with a lost link."""
    return frames.reshape(-1) if lost is None else frames[~lost]


def cut_at_lost_links(frames: TensorDictBase) -> TensorDictBase:
    """Frames ``[*copies, time]`` where those before a lost link end their episodes: estimates must
    not look across."""
    lost = lost_links(frames)
    if lost is not None and bool(lost.any()):
        frames = frames.clone()
        # The frame before a lost one is the last of its episode.
        frames["next", "done"][..., :-1, :] |= lost[..., 1:, None]
    return frames


@dataclass
class Rollout:
    """Rewards, actions and observations of an episode, collected frame by frame.

    Attributes:
        rewards: one per step.
        action_sizes: mean absolute value of each step's action, in 0..1.
        observations: the observation ``[n]`` after each step.
        is_lost: whether the link to the robot broke; that frame does not count.
    """

    rewards: list[float] = field(default_factory=list)
    action_sizes: list[float] = field(default_factory=list)
    observations: list[Tensor] = field(default_factory=list)
    is_lost: bool = False

    def add(
        self,
        frame: TensorDictBase,
        env: EnvBase,
    ) -> list[TensorDictBase]:
        """Add the steps of the environment itself behind a frame of its transforms, and return
        those with an outcome: all but a last one in which the link broke."""
        own = own_frames(env, frame)
        whole = list[TensorDictBase]()
        for step in own:
            if link_lost(step):
                self.is_lost = True
                # A transform may leave the entry out, so it is set anew.
                frame["next", "link_lost"] = torch.ones(1, dtype=torch.bool)
                break
            whole.append(step)
            self.rewards.append(float(step["next", "reward"]))
            self.action_sizes.append(float(step["action"].abs().mean()))
            self.observations.append(step["next"].get("observation", None))
        has_ended = bool(own[-1]["next", "done"])
        if has_ended and not bool(frame["next", "done"]):
            raise DescriptionError(
                "a transform hides the end of the episode; let it pass 'done' on"
            )
        if any(bool(step["next", "done"]) for step in own[:-1]):
            raise DescriptionError(
                "a transform goes on after the end of the episode; let it stop there, as "
                "--frame-skip does"
            )
        return whole

    @property
    def action_size(self) -> float:
        """Mean absolute value of the actions, in 0..1."""
        return sum(self.action_sizes) / max(1, len(self.action_sizes))

    @property
    def return_(self) -> float:
        """Sum of the rewards."""
        return float(torch.tensor(self.rewards).sum())

    def judged(self, env: EnvBase) -> tuple[bool | None, dict[str, float]]:
        """Success and metrics by the task, for the last episode of ``env``; none after a lost link,
        without a task or a step."""
        ours = interface_of(env)
        if ours.task is None or self.is_lost or not self.rewards:
            return None, {}
        judged = ours.task_observations(torch.stack(self.observations))
        metrics = metrics_of(ours.task, judged)
        walked = ours.walk_metrics()
        if twice := sorted(metrics.keys() & walked.keys()):
            reason = (
                f"metrics of {ours.task.id} have the name '{twice[0]}', which is measured of "
                "each virtual robot that moves"
            )
            raise DescriptionError(f"{reason}; give it another one")
        return success_of(ours.task, judged), {**metrics, **walked}


@dataclass(frozen=True)
class EpisodeScore:
    """Result of an episode, evaluated by its task before the next reset."""

    return_: float
    length: int
    action_size: float
    success: bool | None
    metrics: dict[str, float]


def play_episodes(
    env: EnvBase,
    policy: Policy,
    episodes: int,
    seed: int,
    *,
    kind: EpisodeKind = "evaluation",
    reset_policy: Callable[[], None] = lambda: None,
) -> Iterator[EpisodeScore]:
    """Play whole episodes of a kind; episode ``k`` depends only on kind, ``seed``, ``k`` and the
    policy, and on the number of copies if the environment has some, which run in parallel. An
    episode in which the link to the robot broke is played again. Raises HubError if it does so in
    ``TRIES`` of its tries."""
    if env.batch_size:

        def seed_of(number: int) -> int:
            return episode_seed(kind, seed, number)

        yield from _play_copies(
            env,
            policy,
            episodes,
            seed_of,
            reset_policy,
        )
        return
    for number in range(1, episodes + 1):
        episode = None
        lost = 0
        # An episode that a pause truncated does not count either.
        while episode is None or episode.is_lost or interface_of(env).is_cut:
            episode = Rollout()
            # The seed changes, because a virtual link would break again at the same step.
            seed_episode(env, episode_seed(kind, seed, number, lost))
            for frame in play(env, policy, reset_policy=reset_policy):
                episode.add(frame, env)
            lost += episode.is_lost
            if lost == TRIES:
                raise interface_of(env).link_error
        success, metrics = episode.judged(env)
        yield EpisodeScore(
            episode.return_,
            len(episode.rewards),
            episode.action_size,
            success,
            metrics,
        )


def longest_of(env: EnvBase) -> int:
    """Steps of an episode at most; those of a round of copies where no task says it."""
    task = interface_of(env).task
    return 100 if task is None else task.max_steps


def _play_copies(
    env: EnvBase,
    policy: Policy,
    episodes: int,
    seed_of: Callable[[int], int],
    reset_policy: Callable[[], None],
) -> Iterator[EpisodeScore]:
    """The first episode of each copy, repeated until ``episodes`` are played, by return and length
    of the environment itself where it counts them; one that a lost link cut does not count. A task
    that judges more than the agent sees, such as the true pose of a robot in another process, or
    what it sees through transforms, gives no success and no metrics. Raises HubError if the links
    of all copies break again and again."""
    copies = env.batch_size.numel()
    judge = _judge_of_copies(env)
    started = 0
    played = 0
    # The number of rounds in a row in which all links broke limits how long this goes on.
    in_vain = 0
    while played < episodes:
        seed_episode(env, seed_of(1 + started))
        started += copies
        reset_policy()
        rollout = env.rollout(longest_of(env), policy, break_when_any_done=False).cpu()
        frames = rollout["next"]
        sizes = rollout["action"].abs().mean(-1)  # [copies, time]
        done = frames["done"].squeeze(-1)
        # Only the first episode of each copy counts, because quick ones would otherwise count more
        # often.
        first_end = done.int().argmax(-1) + 1
        lengths = torch.where(done.any(-1), first_end, done.shape[-1])  # [copies]
        whole = []
        for copy in range(copies):
            last = rollout[copy, int(lengths[copy]) - 1]
            if not link_lost(last):
                whole.append(copy)
        in_vain = 0 if whole else in_vain + 1
        if in_vain == TRIES:
            raise HubError(
                f"the links to all {copies} copies broke in {TRIES} rounds; look at what their "
                "robots say"
            )
        for copy in whole[: episodes - played]:
            episode = frames[copy, : int(lengths[copy])]
            success = None if judge is None else success_of(judge, episode["observation"])
            numbers = {} if judge is None else metrics_of(judge, episode["observation"])
            size = float(sizes[copy, : len(episode)].mean())
            # Counters stand before the transforms, and so hold the environment's own numbers.
            if "episode_reward" in episode:
                return_ = episode["episode_reward"][-1]
            else:
                return_ = episode["reward"].sum()
            length = int(episode["step_count"][-1]) if "step_count" in episode else len(episode)
            played += 1
            yield EpisodeScore(
                float(return_),
                length,
                size,
                success,
                numbers,
            )


def _judge_of_copies(env: EnvBase) -> Task | None:
    """The task where it can judge what is observed of copies; ``None`` where it cannot."""
    task = interface_of(env).task
    if task is None or task.has_hidden_entries or not changes_nothing(env):
        return None
    return task
