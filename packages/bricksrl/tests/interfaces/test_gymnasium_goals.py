"""Goals for hindsight experience replay of other libraries."""

from __future__ import annotations

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from bricksrl.errors import DescriptionError
from bricksrl.interfaces.gymnasium import GoalObservation, VectorGoalObservation


@pytest.mark.parametrize("env_id", ["RoboArm-v0", "RoboArmSim-v0"])
@pytest.mark.parametrize("sparse", [True, False])
def test_rewards_of_goals_are_those_of_steps(env_id: str, sparse: bool) -> None:
    env = GoalObservation(gymnasium.make(f"bricksrl/{env_id}", sparse=sparse, threshold_deg=200.0))
    assert isinstance(env.observation_space, gymnasium.spaces.Dict)
    assert set(env.observation_space.spaces) == {"observation", "achieved_goal", "desired_goal"}
    observation, _ = env.reset(seed=2)
    steps = []
    for _ in range(40):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert env.observation_space.contains(observation)
        steps.append(
            (observation["achieved_goal"], observation["desired_goal"], reward, terminated)
        )
        achieved, desired, _, _ = steps[-1]
        assert np.array_equal(observation["observation"], achieved), "the arm observes nothing else"
        assert env.compute_reward(achieved, desired, info) == reward
        assert env.compute_terminated(achieved, desired, info) is terminated
        assert not env.compute_truncated(achieved, desired, info)
        if terminated or truncated:
            env.reset()
    batch = [np.stack(part) for part in zip(*steps, strict=True)]
    assert np.array_equal(
        env.compute_reward(batch[0], batch[1], [{}] * 40), batch[2].astype(np.float32)
    )
    assert np.array_equal(env.compute_terminated(batch[0], batch[1], {}), batch[3])
    hindsight = env.compute_reward(batch[0], batch[0], {})
    assert np.array_equal(hindsight, np.full(40, 1.0 if sparse else 0.0, np.float32)), (
        "what is reached was the goal"
    )
    env.close()


def test_gymnasium_checker_passes_with_goals() -> None:
    env = GoalObservation(gymnasium.make("bricksrl/RoboArmSim-v0").unwrapped)
    with pytest.warns(UserWarning, match="different from the unwrapped version"):  # it is a wrapper
        check_env(env, skip_render_check=True)
    first, _ = env.reset(seed=4)
    # it was made here
    for other in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):  # noqa: S301
        assert np.array_equal(other.reset(seed=4)[0]["desired_goal"], first["desired_goal"])
        other.close()
    env.close()


@pytest.mark.parametrize("env_id", ["WalkerSim-v1", "RoboArm_mixed-v0"])
def test_environment_without_goals_is_refused(env_id: str) -> None:
    env = gymnasium.make(f"bricksrl/{env_id}")
    with pytest.raises(
        DescriptionError,
        match="has no goals in a vector of ours; take one that has, such as bricksrl/RoboArm-v0",
    ):
        GoalObservation(env)
    env.close()


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_goals_of_a_batch_are_those_of_its_copies(mode: str) -> None:
    envs = VectorGoalObservation(
        gymnasium.make_vec("bricksrl/RoboArmSim-v0", 32, autoreset_mode=mode, threshold_deg=150.0)
    )
    state, _ = envs.reset(seed=3)
    assert envs.observation_space.contains(state) and state["desired_goal"].shape == (32, 4)
    assert envs.single_observation_space.contains({name: part[0] for name, part in state.items()})
    ended, ends = np.zeros(32, bool), 0
    for _ in range(20):
        starts = ended if mode == "NextStep" else np.zeros(32, bool)
        state, reward, terminated, truncated, info = envs.step(envs.action_space.sample())
        reached = {name: part.copy() for name, part in state.items()}
        ended = terminated | truncated
        if mode == "SameStep":
            for copy in ended.nonzero()[0]:
                for name, part in info["final_obs"][copy].items():
                    reached[name][copy] = part
        paid = envs.compute_reward(reached["achieved_goal"], reached["desired_goal"], info)
        assert np.array_equal(paid[~starts], reward[~starts])
        arrived = envs.compute_terminated(reached["achieved_goal"], reached["desired_goal"], info)
        assert np.array_equal(arrived[~starts], terminated[~starts])
        ends += ended.sum()
        if mode == "Disabled" and ended.any():
            envs.reset(options={"reset_mask": ended})
    assert ends > 32
    envs.close()
    with pytest.raises(DescriptionError, match="has no goals in a vector of ours"):
        VectorGoalObservation(gymnasium.make_vec("bricksrl/WalkerSim-v1", 2))
