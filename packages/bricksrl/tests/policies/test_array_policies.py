"""Policies of arrays: those that come with BricksRL, scripted and random ones, and an agent's as
plain numbers."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
import torch

import bricksrl
from benchmarks.policies import plain_of, save
from bricksrl.agents import make_learner, preset
from bricksrl.envs import get_task
from bricksrl.errors import DescriptionError
from bricksrl.policies.by_name import FOLDER, TRAINED, PlainPolicy, array_policies, path_of
from bricksrl.policies.policy import Policy


@pytest.mark.parametrize("env_id", ["RoboArmSim-v0", "WalkerSim-v0"])
@pytest.mark.parametrize("agent", ["sac", "td3"])
def test_numbers_of_an_agent_act_as_it(env_id, agent, tmp_path):
    with closing(bricksrl.make(env_id, batch_size=256, seed=0)) as env:
        torch.manual_seed(1)
        learner = make_learner(agent, env, replace(preset("default", agent), hidden=(32, 32)))
        observation = env.reset()["observation"]
        policy = Policy(learner.policy, env)
        plain = plain_of(policy)
        save(plain, tmp_path / "a.npz")
        read = PlainPolicy.load(tmp_path / "a.npz")
        wanted = policy.act(observation.numpy())
        assert np.abs(wanted).max() > 0.02
        np.testing.assert_allclose(read.act(observation.numpy()), wanted, atol=1e-5)
        save(plain, tmp_path / "b.npz")
        assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
        with pytest.raises(DescriptionError, match="takes observations of"):
            read.act(np.zeros(3))


def test_agent_with_other_layers_has_no_plain_numbers():
    with closing(bricksrl.make("WalkerSim-v0", seed=0)) as env:
        learner = make_learner(
            "sac", env, replace(preset("default", "sac"), hidden=(8,), actor_norm="layer")
        )
        with pytest.raises(DescriptionError, match="only linear layers"):
            plain_of(Policy(learner.policy, env))


@pytest.mark.parametrize("env_id", sorted(TRAINED))
def test_trained_policy_is_better_than_chance(env_id):
    """The table says what it has reached; that is at least half of the way from random to scripted
    actions."""
    from bricksrl.envs.reference_returns import REFERENCES

    random, scripted = REFERENCES[env_id]["random"], REFERENCES[env_id]["by hand"]
    assert float(TRAINED[env_id]["return"]) > (random + scripted) / 2
    task, policy = get_task(env_id), PlainPolicy.load(path_of(env_id))
    action = policy.act(np.zeros(len(task.entries)))
    assert action.shape == (len(task.interface.commands),) and np.abs(action).max() <= 1.0


def test_trained_policies_are_small():
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < 400_000
    assert {path.stem for path in FOLDER.glob("*.npz")} == set(TRAINED)


def test_policies_of_an_environment():
    task = get_task("Walker-v1")
    policies = array_policies("Walker-v1", task, 0)
    assert list(policies)[:2] == ["random", "scripted"]
    state = {"observation": np.zeros(len(task.entries), np.float32)}
    for make in policies.values():
        action = np.asarray(make()(state))
        assert action.shape == (4,) and np.abs(action).max() <= 1.0
    first, again = (array_policies("Walker-v1", task, 3)["random"]()(state) for _ in range(2))
    assert first.tolist() == again.tolist()


def test_random_actions_fill_their_range():
    random = array_policies("Walker-v1", get_task("Walker-v1"), 0)["random"]()
    actions = np.array([random({}) for _ in range(500)])
    assert np.abs(actions).max() <= 1.0
    # The mean of 500 is within 0.1 in all but one of 10,000 drawings.
    assert np.abs(actions.mean(axis=0)).max() < 0.15
    assert actions.min() < -0.95 and actions.max() > 0.95
