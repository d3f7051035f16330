"""What Gymnasium and PettingZoo are told of an episode: metrics by the task's own functions, and
what an environment offers."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

import bricksrl
from bricksrl.envs import get_task
from bricksrl.envs.arenas import get_arena_task
from bricksrl.errors import DescriptionError, RenderingUnavailableError, UnknownOptionError
from bricksrl.interfaces.gymnasium import FeatureObservation, GymnasiumEnv, _limit, _longer


def test_info_of_each_step_judges_the_episode_so_far() -> None:
    task = get_task("WalkerSim-v1")
    env = GymnasiumEnv("WalkerSim-v1", max_episode_steps=5)
    rng = np.random.default_rng(0)
    for _ in range(2):
        env.reset(seed=1)
        seen = []
        for step in range(1, 6):
            action = rng.uniform(-1, 1, 4).astype(np.float32)
            observation, _, terminated, truncated, info = env.step(action)
            seen.append(torch.from_numpy(np.array(observation)))
            episode = torch.stack(seen)
            wanted = {name: float(value) for name, value in task.metrics(episode).items()}
            success = bool(task.success(episode))
            assert info == {**wanted, "success": success, "is_success": success}
            assert (terminated, truncated) == (False, step == 5)
        kept = dict(info)
        info.clear()
        assert env._info == kept, "what a caller does with it changes nothing here"
    env.close()


@pytest.mark.parametrize("steps", [3, 130])
def test_infos_of_a_batch_judge_each_whole_episode(steps: int) -> None:
    """Also of episodes that are longer than the task's."""
    envs = gymnasium.make_vec("bricksrl/WalkerSim-v1", 2, max_episode_steps=steps)
    task = get_task("WalkerSim-v1")
    envs.reset(seed=1)
    rng = np.random.default_rng(0)
    seen = []
    for step in range(1, steps + 1):
        actions = rng.uniform(-1, 1, (2, 4)).astype(np.float32)
        observations, _, _, truncated, info = envs.step(actions)
        seen.append(torch.from_numpy(observations.copy()))
        assert truncated.tolist() == [step == steps] * 2
        if step < steps:
            assert info == {}
    episodes = torch.stack(seen, 1)
    wanted = task.metrics(episodes)
    for name, values in wanted.items():
        assert info[name] == pytest.approx(values.numpy(), rel=1e-5)
        assert info[f"_{name}"].tolist() == [True, True]
    success = task.success(episodes).tolist()
    assert info["success"].tolist() == info["is_success"].tolist() == success
    envs.close()


def test_episodes_of_other_lengths_are_judged_apart() -> None:
    """Of a task that ends early in one copy alone."""
    envs = gymnasium.make_vec("bricksrl/RoboArmSim-v0", 40, max_episode_steps=6, threshold_deg=150)
    task = get_task("RoboArmSim-v0", threshold_deg=150)
    state, _ = envs.reset(seed=2)
    rng = np.random.default_rng(0)
    seen: list[list[Any]] = [[] for _ in range(40)]
    ended = np.zeros(40, bool)
    lengths = set()
    for _ in range(6):
        actions = rng.uniform(-1, 1, (40, 4)).astype(np.float32)
        starts = ended
        state, _, terminated, truncated, info = envs.step(actions)
        ended = terminated | truncated
        for copy in range(40):
            if starts[copy]:
                seen[copy] = []
                continue
            seen[copy].append(torch.from_numpy(state[copy].copy()))
            if ended[copy]:
                lengths.add(len(seen[copy]))
                episode = torch.stack(seen[copy])
                for name, value in task.metrics(episode).items():
                    assert info[name][copy] == pytest.approx(float(value), rel=1e-5)
                assert bool(info["success"][copy]) is bool(task.success(episode))
    assert len(lengths) > 2
    envs.close()


@pytest.mark.parametrize(("given", "steps"), [(None, 100), (-1, None), (1, 1), (7, 7)])
def test_limit_is_the_task_s_unless_another_is_given(given: Any, steps: int | None) -> None:
    assert _limit(given, get_task("WalkerSim-v1")) == steps


@pytest.mark.parametrize(
    ("steps", "registered", "is_cut"),
    [(250, 100, True), (101, 100, True), (100, 100, False), (None, 100, False), (5, None, False)],
)
def test_who_is_cut_short_is_told_what_to_give(
    steps: int | None, registered: int | None, is_cut: bool
) -> None:
    text = (
        f"with these options an episode has {steps} steps, and Gymnasium ends it after "
        f"{registered}; give max_episode_steps={steps}"
    )
    assert _longer(steps, registered) == (text if is_cut else "")


def test_what_an_environment_offers_is_in_its_metadata() -> None:
    robot = GymnasiumEnv("RunAway-v0")
    assert robot.metadata == {"render_modes": ["rgb_array"], "render_fps": 1}
    assert robot.render() is None and robot.spec is None
    assert robot.max_episode_steps == get_task("RunAway-v0").max_steps == 20
    simulation = GymnasiumEnv("WalkerSim-v1")
    assert simulation.metadata == {"render_modes": [], "render_fps": 4}
    assert simulation.action_space == gymnasium.spaces.Box(-1.0, 1.0, (4,))
    made = gymnasium.make("bricksrl/WalkerSim-v1").unwrapped
    assert isinstance(made, GymnasiumEnv)
    assert made.max_episode_steps is None, "Gymnasium's wrapper counts"
    envs = gymnasium.make_vec("bricksrl/WalkerSim-v1", 3)
    assert envs.metadata["render_modes"] == []
    assert envs.single_action_space == gymnasium.spaces.Box(-1.0, 1.0, (4,))
    assert envs.action_space == gymnasium.spaces.Box(-1.0, 1.0, (3, 4))
    for env in (robot, simulation, made, envs):
        env.close()


def test_camera_is_a_part_of_the_observation() -> None:
    env = GymnasiumEnv("RoboArm_mixed-v0")
    assert isinstance(env.observation_space, gymnasium.spaces.Dict)
    image = env.observation_space["image"]
    assert image == gymnasium.spaces.Box(0, 255, (64, 64, 3), np.uint8)
    assert env.observation_space["observation"].shape == (3,)
    with pytest.raises(DescriptionError, match="has no vector of ours; take one that has, such as"):
        FeatureObservation(env)  # type: ignore[arg-type]
    env.close()


def test_transforms_are_gymnasium_s_own() -> None:
    for options in ({"frame_stack": 2}, {"frame_skip": 3}):
        with pytest.raises(UnknownOptionError) as caught:
            GymnasiumEnv("WalkerSim-v1", **options)
        says = "Gymnasium has wrappers of its own; omit frame_stack, frame_skip and transform"
        assert str(caught.value) == says


def test_real_robot_has_no_picture() -> None:
    env = GymnasiumEnv("RunAway-v0", render_mode="rgb_array", hub="ble")
    with pytest.raises(RenderingUnavailableError) as caught:
        env.render()
    says = "the robot of RunAway-v0 has no picture; use hub='virtual'"
    assert str(caught.value) == says


def test_features_are_unbounded_and_of_the_encoder_s_size() -> None:
    env = FeatureObservation(gymnasium.make("bricksrl/RoboArmSim-v0"))
    assert isinstance(env.observation_space, gymnasium.spaces.Box)
    assert np.isinf(env.observation_space.low).all() and np.isinf(env.observation_space.high).all()
    env.close()


def test_all_environments_are_registered_with_their_steps() -> None:
    for env_id in bricksrl.list_envs():
        spec = gymnasium.spec(f"bricksrl/{env_id}")
        assert spec.max_episode_steps == get_task(env_id).max_steps
        assert spec.kwargs == {"env_id": env_id}
        assert spec.entry_point == "bricksrl.interfaces.gymnasium:GymnasiumEnv"
        vector = "bricksrl.interfaces.gymnasium:GymnasiumVectorEnv"
        assert spec.vector_entry_point == (vector if "Sim-" in env_id else None)


class Renderer:
    """A renderer that notes when it is closed."""

    def __init__(self) -> None:
        self.closed = 0

    def close(self) -> None:
        self.closed += 1


def test_picture_of_another_seed_is_that_of_another_robot() -> None:
    env = GymnasiumEnv("WalkerSim-v1")
    renderer = Renderer()
    env._renderer = renderer  # type: ignore[assignment]
    env.reset()
    assert renderer.closed == 0
    env.reset(seed=1)
    assert renderer.closed == 1 and env._renderer is None
    env._renderer = renderer  # type: ignore[assignment]
    env.close()
    assert renderer.closed == 2


# ---------------------------------------------------------------- PettingZoo


@pytest.fixture
def arena() -> Any:
    pytest.importorskip("pettingzoo")
    from bricksrl.interfaces.pettingzoo import ArenaParallelEnv

    return ArenaParallelEnv("Tag-v0", seed=3)


def test_pettingzoo_is_told_of_the_arena(arena: Any) -> None:
    assert arena.metadata == {
        "name": "Tag-v0",
        "is_parallelizable": True,
        "render_modes": ["rgb_array"],
        "render_fps": 4,
    }
    assert arena.possible_agents == ["catcher", "runner"] and arena.agents == []
    task = get_arena_task("Tag-v0")
    low = np.array([entry.bounds[0] for entry in task.entries], np.float32)
    for name in arena.possible_agents:
        assert np.array_equal(arena.observation_space(name).low, low)
        assert np.array_equal(arena.observation_space(name).high, -low)
        assert arena.action_space(name) == gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    assert np.array_equal(arena.state_space.low, np.concatenate((low, low)))
    arena.close()
    arena.close()


def test_pettingzoo_gives_each_robot_what_is_its_own(arena: Any) -> None:
    observations, infos = arena.reset()
    assert arena.agents == ["catcher", "runner"] and infos == {"catcher": {}, "runner": {}}
    actions = {"catcher": np.ones(2, np.float32), "runner": np.zeros(2, np.float32)}
    after, rewards, terminated, truncated, infos = arena.step(actions)
    assert rewards["catcher"] == pytest.approx(-rewards["runner"]) and rewards["catcher"] != 0.0
    # The catcher's wheels have turned by a good part of the command, the runner's have not.
    assert after["catcher"][8:].min() > 0.4 and abs(after["runner"][8:]).max() < 0.1
    for ends in (terminated, truncated):
        assert ends == {"catcher": False, "runner": False}
    infos["catcher"]["mine"] = 1
    assert "mine" not in infos["runner"]
    assert not np.array_equal(after["catcher"], observations["catcher"])
    arena.close()


def test_new_seed_of_an_arena_is_drawn_anew(arena: Any) -> None:
    renderer = Renderer()
    seeds: list[int] = []
    closed: list[bool] = []
    frame = bricksrl.make_arena("Tag-v0", batch_size=2, seed=0).reset()[0]
    arena._renderer = renderer
    arena._env = SimpleNamespace(
        set_seed=seeds.append,
        reset=lambda: frame,
        task=get_arena_task("Tag-v0"),
        close=lambda *, raise_if_closed: closed.append(raise_if_closed),
    )
    arena.reset()
    assert seeds == [] and renderer.closed == 0
    arena.reset(seed=7)
    assert seeds == [7] and renderer.closed == 1
    arena.close()
    assert closed == [False]
