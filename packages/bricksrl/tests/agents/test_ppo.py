"""PPO with many copies."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from small import make, rollout
from torchrl.envs.utils import ExplorationType, set_exploration_type

import bricksrl
from bricksrl.agents import make_learner, preset
from bricksrl.agents.learner import Learner


def mean_return(env: object, learner: Learner) -> float:
    with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
        frames = env.rollout(100, learner.policy, break_when_any_done=False)  # type: ignore[attr-defined]
    return float(frames["next", "reward"].sum(1).mean())


@pytest.mark.slow
def test_ppo_improves_simulated_walker() -> None:
    env = bricksrl.make("WalkerSim-v0", seed=0, batch_size=256)
    learner = make_learner("ppo", env, replace(preset("default", "ppo"), steps=16, batch_size=512))
    before, state = mean_return(env, learner), env.reset()
    for _ in range(30):
        with torch.no_grad(), set_exploration_type(ExplorationType.RANDOM):
            frames = env.rollout(
                16, learner.policy, auto_reset=False, tensordict=state, break_when_any_done=False
            )
        state = env.maybe_reset(env.step_mdp(frames[:, -1]))
        learner.remember(frames)
        told = learner.learn(16)
    assert before < -150.0
    assert mean_return(env, learner) > before + 100.0
    assert told["loss_critic"].isfinite()


def test_truncation_bootstraps_termination_does_not() -> None:
    """Only at a time limit does the last advantage include the next value."""
    targets = []
    for name in ("truncated", "terminated"):
        learner = make("ppo")
        frames = rollout(learner)
        for flag in ("done", "truncated", "terminated"):
            frames["next", flag][:] = False
        frames["next", name][:, -1] = frames["next", "done"][:, -1] = True
        frames["next", "reward"][:] = 0.0
        targets.append(learner.prepare(frames)["value_target"].flatten()[-1])
    assert float(targets[1].abs()) < 1e-6 < float(targets[0].abs())


def test_estimates_end_at_lost_links() -> None:
    """The step in which the link broke has no outcome: the steps before it are as in an episode
    that ends there."""
    learner = make("ppo")
    frames = rollout(learner)
    for flag in ("done", "truncated", "terminated"):
        frames["next", flag][:] = False
    expected = learner.prepare(frames[:, :5])["value_target"].flatten()
    frames["next", "link_lost"] = torch.zeros(1, 8, 1, dtype=torch.bool)
    for flag in ("done", "truncated", "link_lost"):
        frames["next", flag][:, 5] = True
    learner.remember(frames)
    assert len(learner.memory) == 7  # type: ignore[arg-type]
    torch.testing.assert_close(learner.memory[:]["value_target"][:5].flatten(), expected)  # type: ignore[index]


def test_passes_cover_all_frames() -> None:
    learner = make("ppo", steps=8, batch_size=4, passes=3)
    learner.remember(rollout(learner))
    assert len(learner.memory) == 8  # type: ignore[arg-type]
    learner.learn()
    assert learner.updates == 6
    assert len(learner.memory) == 0  # type: ignore[arg-type]
    assert learner.frames_per_batch == 8
