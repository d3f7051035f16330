"""Domain randomisation and given physics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from brickhub.seed import derive_seed
from bricksrl.agents.sac import SACSettings
from bricksrl.envs.env import HubEnv
from bricksrl.envs.make import make
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.rollout import seed_episode
from bricksrl.errors import DescriptionError, RunError, TwinError
from bricksrl.evaluation import evaluate, evaluator
from bricksrl.training import RunFolder, TrainConfig, train
from bricktwin.twin.physics import PARAMETERS, Physics, write_physics

WEAK = Physics(battery_v=7.2, friction_scale=0.8)


def physics_of_episodes(config: TrainConfig, episodes: int = 4) -> list[Physics]:
    """Physics of each episode of a training."""
    env = make(config.env, config.robot, seed=config.seed)
    assert isinstance(env, HubEnv)
    found = []
    for episode in range(episodes):
        seed_episode(env, derive_seed(config.seed, "episode", episode))
        env.reset()
        assert env.twin is not None
        found.append(env.twin.body.physics)
    env.close()
    return found


def test_randomisation_redraws_physics_each_episode() -> None:
    config = TrainConfig("RunAway-v0", randomize=True)
    drawn = physics_of_episodes(config)
    for name, parameter in PARAMETERS.items():
        values = {getattr(physics, name) for physics in drawn}
        different = 2 if name.startswith("link_") else len(drawn)  # one of two links
        assert len(values) == (
            1 if parameter.random_range[0] == parameter.random_range[1] else different
        ), name
    assert drawn == physics_of_episodes(config), "a seed repeats them"


def test_physics_is_constant_without_randomisation() -> None:
    assert set(physics_of_episodes(TrainConfig("RunAway-v0"))) == {Physics()}
    assert set(physics_of_episodes(TrainConfig("RunAway-v0", physics=WEAK))) == {WEAK}


def test_physics_and_randomisation_raise() -> None:
    with pytest.raises(DescriptionError, match="one of the two"):
        TrainConfig("RunAway-v0", randomize=True, physics=WEAK)


def test_a_simulation_without_a_robot_has_no_physics() -> None:
    with pytest.raises(DescriptionError, match="physics"):
        make("WalkerSim-v0", TrainConfig("WalkerSim-v0", randomize=True), seed=0)


def test_old_and_new_configs_are_read() -> None:
    for config in (
        TrainConfig("RunAway-v0", physics=WEAK),
        TrainConfig("RunAway-v0", randomize=True),
    ):
        assert TrainConfig.from_dict(config.to_dict()) == config
    older = TrainConfig("RunAway-v0").to_dict()
    del older["randomize"], older["physics"]
    assert TrainConfig.from_dict(older) == TrainConfig("RunAway-v0")
    for damage in ({"gravity": 3}, {"battery_v": "high"}, {"battery_v": 99}, [1]):
        with pytest.raises(RunError, match="physics"):
            TrainConfig.from_dict({**older, "physics": damage})


@pytest.mark.parametrize(
    ("trained_with", "evaluated_with", "expected"),
    [
        ({"randomize": True}, {}, (False, None)),
        ({"randomize": True}, {"randomize": True}, (True, None)),
        ({"physics": WEAK}, {}, (False, WEAK)),
        ({"physics": WEAK}, {"randomize": True}, (True, None)),
        ({}, {"physics": WEAK}, (False, WEAK)),
    ],
)
def test_evaluation_does_not_randomise_by_default(
    trained_with, evaluated_with, expected, tmp_path, monkeypatch
) -> None:
    settings = SACSettings(hidden=(8,), batch_size=8, prefill_episodes=1)
    config = TrainConfig("RunAway-v0", episodes=1, settings=settings, run_dir=tmp_path / "run")
    train(replace(config, **trained_with))
    assert RunFolder(Path(tmp_path / "run")).read_config() == replace(config, **trained_with)
    used = []

    def noting(env: str, options: EnvOptions, **named: Any) -> object:
        used.append((options.randomize, options.physics))
        return make(env, options, **named)

    monkeypatch.setattr(evaluator, "make", noting)
    evaluate(tmp_path / "run", episodes=1, **evaluated_with)
    assert used == [expected]


def test_physics_may_be_a_file(tmp_path: Path) -> None:
    write_physics(tmp_path / "weak.json", WEAK)
    for file in (tmp_path / "weak.json", str(tmp_path / "weak.json")):
        config = TrainConfig("RunAway-v0", physics=file)  # type: ignore[arg-type]
        assert config.physics == WEAK, "stored with the run"
        assert set(physics_of_episodes(config, 1)) == {WEAK}
        env = make("RunAway-v0", EnvOptions(physics=file), seed=0)  # type: ignore[arg-type]
        env.reset()
        assert env.twin.body.physics == WEAK
        env.close()
    with pytest.raises(TwinError, match="cannot read the physics"):
        TrainConfig("RunAway-v0", physics=tmp_path / "none.json")
