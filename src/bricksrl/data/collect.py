"""Collecting: a policy, a human, or both let a robot act, and all of it is recorded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
import torch

from bricksrl.data.steps import about, step_of, success_of
from bricksrl.seed import check_seed

if TYPE_CHECKING:
    from tensordict import TensorDictBase
    from torch import Tensor
    from torchrl.envs import EnvBase

    from bricksrl.data.recorder import Recorder

Policy = Callable[["TensorDictBase"], "Tensor"]
"""What acts by itself: what the environment shows, to an action ``[m]`` in -1..1."""


class Driver(Protocol):
    """A human, or a program in the place of one, who may choose the action."""

    def __call__(self, observation: Tensor) -> Tensor | None:
        """An action ``[m]`` in -1..1 for an observation ``[n]``, or ``None`` to leave this step to the policy."""


@dataclass(frozen=True)
class Collected:
    """One recorded episode: its number in the dataset, from 0; the sum of its rewards; its steps, and those of a human."""

    episode: int
    return_: float
    length: int
    interventions: int
    success: bool | None


def random_policy(env: EnvBase, seed: int) -> Policy:
    """Uniform actions; their seed is theirs alone.

    Raises:
        DescriptionError: it cannot be one.
    """
    check_seed(seed)
    generator = torch.Generator().manual_seed(seed)
    size = int(env.action_spec.shape[-1])
    return lambda _: 2.0 * torch.rand(size, generator=generator) - 1.0


def collect(
    env: EnvBase,
    policy: Policy,
    recorder: Recorder,
    episodes: int,
    *,
    name: str,
    seed: int = 0,
    hub: str = "virtual",
    driver: Driver | None = None,
    start_acting: Callable[[], None] | None = None,
    on_episode: Callable[[Collected], None] | None = None,
) -> list[Collected]:
    """Record whole episodes. One that breaks off, by an error or Ctrl-C, is recorded as far as it went.

    Args:
        name: of the policy, for the record.
        seed: of the episodes, which depend on it, their number in the dataset and the actions only.
        hub: how the robot is reached, for the record.
        driver: asked first at each step.
        start_acting: told when what the policy sees next does not follow from its last action: an episode starts, or the
            driver has chosen one.

    Raises:
        HubError: the link to the robot failed.
        DataError: the episode cannot be recorded.
        DescriptionError: the seed cannot be one.
    """
    check_seed(seed)
    done = []
    for _ in range(episodes):
        episode_seed = int(np.random.SeedSequence([seed, recorder.episodes]).generate_state(1)[0] >> 1)
        env.set_seed(episode_seed)
        state = env.reset()
        recorder.begin(about(env, name, seed=episode_seed, hub=hub))
        try:
            collected = _episode(env, policy, recorder, state, driver, start_acting or (lambda: None))
        except BaseException:
            recorder.commit(whole=False)
            raise
        done.append(collected)
        if on_episode is not None:
            on_episode(collected)
    return done


def _episode(
    env: EnvBase,
    policy: Policy,
    recorder: Recorder,
    state: TensorDictBase,
    driver: Driver | None,
    start_acting: Callable[[], None],
) -> Collected:
    observations, return_, interventions = [], 0.0, 0
    done = False
    start_acting()
    while not done:
        chosen = None if driver is None else driver(state["observation"])
        if chosen is not None:
            start_acting()
        state["action"] = policy(state) if chosen is None else chosen
        state = env.step(state)
        step = step_of(state, env, intervention=chosen is not None)
        recorder.add(step)
        observations.append(state["next", "observation"])
        return_ += step.reward
        interventions += step.intervention
        done = step.terminated or step.truncated
        state = env.step_mdp(state)
    success = success_of(env, torch.stack(observations))
    number = recorder.episodes
    recorder.commit(success=success)
    return Collected(number, return_, len(observations), interventions, success)
