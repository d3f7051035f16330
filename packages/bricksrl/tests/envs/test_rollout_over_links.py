"""Evaluated episodes over a link that breaks."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDictBase
from toys import LosingCart

from bricksrl.envs.rollout import TRIES, play_episodes
from bricksrl.errors import HubError


def forward(tensordict: TensorDictBase) -> TensorDictBase:
    return tensordict.set("action", torch.full((1,), 0.1))


def test_evaluation_plays_an_episode_again_in_which_the_link_broke() -> None:
    whole, losing = LosingCart(at=99), LosingCart(at=2)
    scores = [list(play_episodes(env, forward, 4, seed=0)) for env in (whole, losing)]
    assert (whole.resets, losing.resets) == (4, 5)  # and the one that was lost
    # it is another episode
    assert [one == other for one, other in zip(*scores, strict=True)] == [True, True, False, True]


def test_evaluation_gives_up_where_the_link_always_breaks() -> None:
    env = LosingCart(at=2)
    env._is_lost = lambda: env.step_count == 1  # type: ignore[method-assign]
    with pytest.raises(HubError, match="the hub did not answer"):
        list(play_episodes(env, env.rand_action, 1, seed=0))
    assert env.resets == TRIES
