"""Data collection: recording of episodes of a policy, a human, or both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch

from brickhub.seed import check_seed
from bricksrl.data.transitions import about, step_of
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.rollout import Driver, Policy, Rollout, link_lost, play

if TYPE_CHECKING:
    from tensordict import TensorDictBase
    from torchrl.envs import EnvBase

    from bricksrl.data.recorder import Recorder


@dataclass(frozen=True)
class Collected:
    """Recorded episode: number in the dataset from 0, return, number of steps, and of those by a human, success."""

    episode: int
    return_: float
    length: int
    interventions: int
    success: bool | None


def random_policy(env: EnvBase, seed: int) -> Policy:
    """Policy of uniform random actions, with a generator of its own. Raises DescriptionError if the seed is invalid."""
    check_seed(seed)
    generator = torch.Generator().manual_seed(seed)
    size = int(env.action_spec.shape[-1])
    return lambda state: state.set("action", 2.0 * torch.rand(size, generator=generator) - 1.0)


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
    reset_policy: Callable[[], None] = lambda: None,
    on_episode: Callable[[Collected], None] | None = None,
    on_frame: Callable[[TensorDictBase], None] = lambda _: None,
) -> list[Collected]:
    """Record episodes. An episode interrupted by a pause, an error or Ctrl-C is recorded up to that step.

    Args:
        name: name of the policy, to be stored.
        seed: seed of the episodes; each depends only on it, its number in the dataset and the actions.
        hub: how the robot is reached, to be stored.
        driver: asked first at each step.
        reset_policy: as in `play`.
        on_frame: called with each step, as returned by TorchRL's ``EnvBase.step``.

    Raises:
        HubError: the link to the robot failed.
        DataError: the episode cannot be recorded.
        DescriptionError: the seed is invalid.
    """
    check_seed(seed)
    done, ours = [], interface_of(env)
    for _ in range(episodes):
        number = recorder.episodes
        episode_seed = int(np.random.SeedSequence([seed, number]).generate_state(1)[0] >> 1)
        env.set_seed(episode_seed)
        state = env.reset()
        recorder.begin(about(env, name, seed=episode_seed, hub=hub))
        episode, interventions = Rollout(), 0
        try:
            for frame in play(env, policy, state, driver=driver, reset_policy=reset_policy):
                if link_lost(frame):
                    raise ours.link_error
                by_hand = bool(frame.get("intervention", False))
                recorder.add(step_of(frame, env, intervention=by_hand))
                episode.add(frame)
                interventions += by_hand
                on_frame(frame)
            is_cut = ours.is_cut
            success = None if is_cut else episode.success(env)
        except BaseException:
            recorder.commit(whole=False)
            raise
        recorder.commit(success=success, whole=not is_cut)
        done.append(Collected(number, episode.return_, len(episode.rewards), interventions, success))
        if on_episode is not None:
            on_episode(done[-1])
    return done
