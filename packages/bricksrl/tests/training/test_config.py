from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bricksrl
from brickhub.seed import LARGEST_SEED
from bricksrl.agents import AGENTS, preset
from bricksrl.agents.sac import SACSettings
from bricksrl.envs import get_task
from bricksrl.errors import DescriptionError, RunError
from bricksrl.training import TrainConfig
from bricksrl.training.config import portable, settings_for
from bricktwin.twin.physics import Physics, write_physics


@given(
    st.integers(0, LARGEST_SEED),
    st.lists(st.integers(1, 512), min_size=1, max_size=4),
    st.floats(1e-6, 1.0),
    st.booleans(),
)
def test_config_json_round_trip(seed: int, hidden: list[int], rate: float, realtime: bool) -> None:
    settings = SACSettings(hidden=tuple(hidden), learning_rate=rate)
    config = TrainConfig(env="RunAway-v0", seed=seed, realtime=realtime, settings=settings)
    assert TrainConfig.from_dict(json.loads(json.dumps(config.to_dict()))) == config


def test_folder_is_not_part_of_the_dictionary() -> None:
    config = TrainConfig(env="RunAway-v0", settings=preset("paper"), run_dir=Path("here"))
    assert "run_dir" not in config.to_dict()
    assert replace(config, run_dir="here") == config, "a string too"
    assert TrainConfig.from_dict(config.to_dict(), run_dir=Path("there")) == replace(
        config, run_dir=Path("there")
    )


@pytest.mark.parametrize("agent", AGENTS)
@pytest.mark.parametrize("name", ["default", "paper"])
def test_settings_round_trip_for_every_agent(agent: str, name: str) -> None:
    config = TrainConfig(env="RunAway-v0", agent=agent, settings=preset(name, agent))
    assert TrainConfig.from_dict(json.loads(json.dumps(config.to_dict()))) == config


@pytest.mark.parametrize("agent", AGENTS)
def test_default_settings_are_saved(agent: str) -> None:
    config = TrainConfig(env="RunAway-v0", agent=agent)
    assert config.settings == preset("default", agent)
    assert config.to_dict()["settings"].keys() == vars(preset("default", agent)).keys()


@pytest.mark.parametrize(
    "damage",
    [
        {"colour": "red"},
        {"episodes": "many"},
        {"episodes": 0},
        {"episodes": True},
        {"seed": 1.5},
        {"settings": []},
        {"settings": {"hidden": 256}},
        {"settings": {"gamma": 3}},
        {"settings": {"momentum": 0.9}},
    ],
)
def test_damaged_config_raises(damage: dict[str, object]) -> None:
    data = TrainConfig(env="RunAway-v0").to_dict()
    with pytest.raises(RunError, match=r"config|settings") as caught:
        TrainConfig.from_dict({**data, **damage})
    assert "\n" not in str(caught.value)


def test_config_without_environment_raises() -> None:
    with pytest.raises(RunError, match="env"):
        TrainConfig.from_dict({})


@pytest.mark.parametrize(
    "change",
    [
        {"episodes": "3"},
        {"episodes": 3.5},
        {"episodes": True},
        {"eval_every": None},
        {"patience_s": "1"},
        {"env": None},
        {"agent": 3},
        {"device": None},
        {"compile": "yes"},
        {"hub": 3},
        {"options": [1]},
        {"data": 3},
        {"run_dir": 3},
        {"settings": {"gamma": 0.9}},
        {"settings": "default"},
    ],
)
def test_values_of_another_type_raise(change: dict[str, Any]) -> None:
    (name,) = change
    with pytest.raises(DescriptionError, match=f"{name} is .*; give ") as caught:
        TrainConfig(**{"env": "RunAway-v0", **change})
    assert "\n" not in str(caught.value)


def test_folders_may_be_paths() -> None:
    config = TrainConfig(
        env="RunAway-v0", demonstrations=Path("datasets/walk"), start=Path("runs/walk")
    )  # type: ignore[arg-type]
    assert (config.demonstrations, config.start) == ("datasets/walk", "runs/walk")


@pytest.mark.parametrize("config", ["RunAway-v0", None])
def test_training_without_config_raises(config: Any) -> None:
    with pytest.raises(DescriptionError, match=r"config is .*; give TrainConfig\(...\)"):
        bricksrl.train(config)


@pytest.mark.parametrize("change", [{"episodes": 0}, {"seed": -1}, {"seed": LARGEST_SEED + 1}])
def test_invalid_numbers_raise(change: dict[str, int]) -> None:
    with pytest.raises((DescriptionError, RunError), match=next(iter(change))):
        TrainConfig(env="RunAway-v0", **change)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "stop_at",
    [float("nan"), float("inf"), -float("inf"), np.float64("nan"), 10**5000],
    ids=["nan", "inf", "-inf", "numpy", "huge"],
)
def test_return_to_stop_at_is_finite(stop_at: float) -> None:
    with pytest.raises(
        RunError, match="^stop_at is not a finite number; give the return to stop at, or omit it$"
    ):
        TrainConfig(env="RunAway-v0", stop_at=stop_at)
    assert TrainConfig(env="RunAway-v0", stop_at=-3).stop_at == -3


def test_numpy_numbers_become_plain() -> None:
    config = TrainConfig("RunAway-v0", seed=np.int64(3), episodes=np.int32(5))  # type: ignore[arg-type]
    assert (type(config.seed), config.seed, config.episodes) == (int, 3, 5)


def test_numpy_numbers_in_settings_become_plain() -> None:
    settings = preset("default", "sac")
    for rate in np.logspace(-4, -3, 2):
        config = TrainConfig("RunAway-v0", settings=replace(settings, learning_rate=rate))
        assert (type(config.settings.learning_rate), config.settings.learning_rate) == (float, rate)


FLEET = {"hub": "ble:A,ble:B"}
FROM_DATA = {"data": "datasets/walk", "updates": 100, "episodes": 10}


@pytest.mark.parametrize(
    ("alone", "together"),
    [
        ({"name": "a" * 40}, {"name": "a" * 41}),
        ({"name": "Anna B."}, {"name": "Anna\nB."}),
        ({"realtime": True, "num_envs": 1}, {"realtime": True, "num_envs": 2}),
        ({"hub": "ble:A", "num_envs": 1}, {"hub": "ble:A", "num_envs": 2}),
        ({"num_envs": 2}, {**FROM_DATA, "num_envs": 2}),
        ({"asynchronous": True}, {"asynchronous": True, "num_envs": 2}),
        (FROM_DATA, {**FROM_DATA, "data": None}),
        ({"data": None}, {"data": "datasets/walk"}),
        (FROM_DATA, {**FROM_DATA, "demonstrations": "datasets/walk"}),
        ({**FROM_DATA, "episodes": 100}, {**FROM_DATA, "episodes": 101}),
        ({"robots": 2}, {"robots": 2, "hub": "ble:A"}),
        ({"robots": 1, "hub": "ble:A"}, {"robots": 2, "hub": "usb"}),
        (FLEET, {"hub": "ble:A,ble:A"}),
        (FLEET, {"hub": "ble:A,ble"}),
        (FLEET, {**FLEET, "eval_every": 1}),
        ({"eval_every": 1, "robots": 1}, {"eval_every": 1, "robots": 2}),
        ({"num_envs": 2, "robots": 1}, {"num_envs": 2, "robots": 2}),
        (FROM_DATA, {**FROM_DATA, "robots": 2}),
    ],
)
def test_what_excludes_what(alone: dict[str, Any], together: dict[str, Any]) -> None:
    """The first is a run, and one step beyond it is none."""
    TrainConfig(env="RunAway-v0", **alone)
    with pytest.raises(RunError, match="; (omit|give|train)"):
        TrainConfig(env="RunAway-v0", **together)


def test_physics_of_a_file_are_kept_as_numbers(tmp_path: Path) -> None:
    """A later version of the file trains in the same world."""
    file = tmp_path / "twin.json"
    write_physics(file, Physics(battery_v=6.5))
    config = TrainConfig("RunAway-v0", physics=file)
    file.unlink()
    assert isinstance(config.physics, Physics) and config.physics.battery_v == 6.5
    assert TrainConfig.from_dict(config.to_dict()) == config


def test_robots_have_an_address_each() -> None:
    assert TrainConfig("RunAway-v0").hubs == ("virtual",)
    assert TrainConfig("RunAway-v0", robots=3).hubs == ("virtual",) * 3
    named = TrainConfig("RunAway-v0", hub="ble:A, ble:B")
    assert named.hubs == ("ble:A", "ble:B") and named.robot.hub == "ble:A"


def test_agent_without_the_setting_cannot_normalize() -> None:
    with pytest.raises(DescriptionError, match="^random cannot normalize; give its settings a"):
        TrainConfig("RunAway-v0", "random", normalize=True)
    assert TrainConfig("RunAway-v0", normalize=True).settings.normalize
    assert not TrainConfig("RunAway-v0").settings.normalize


def test_settings_of_an_environment_are_those_of_its_images_and_its_task() -> None:
    usual, images = preset("default", "sac"), preset("default", "sac", images=True)
    assert usual != images
    assert settings_for("RunAway-v0", "default", "sac") == replace(
        usual, **get_task("RunAway-v0").settings
    )
    task = get_task("RoboArm_mixed-v0")
    of_task = {name: value for name, value in task.settings.items() if name in vars(images)}
    assert settings_for(task.id, "default", "sac") == replace(images, **of_task)
    assert settings_for(task.id, "paper", "sac") == preset("paper", "sac")
    assert settings_for("Nowhere-v0", "default", "sac") == usual


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"gamma": 0.5}, None),
        ({"trial_steps": 3}, None),
        ({"gama": 0.5}, "gama"),
        ({"gamma": 2.0}, "gamma is 2.0; give"),
    ],
)
def test_settings_of_a_task_are_those_of_some_agent(
    given: dict[str, Any], says: str | None
) -> None:
    bricksrl.register(replace(get_task("RunAway-v0"), id="Set-v0", settings=given))
    if says is None:
        settings = settings_for("Set-v0", "default", "sac")
        assert settings.gamma == given.get("gamma", preset("default", "sac").gamma)
        return
    with pytest.raises(DescriptionError, match=says):
        settings_for("Set-v0", "default", "sac")
    assert settings_for("Set-v0", "paper", "sac") == preset("paper", "sac")


@pytest.mark.parametrize(
    ("together", "message"),
    [
        (
            {"name": "a" * 41},
            "the name of who trains is no line of up to 40 characters; give one, such as Anna",
        ),
        (
            {"num_envs": 2, "realtime": True, "asynchronous": False},
            "copies need a simulation or virtual robots in simulated time; omit num_envs",
        ),
        (
            {"num_envs": 2, "asynchronous": True},
            "copies cannot be trained asynchronously; train synchronously, or omit num_envs",
        ),
        ({"updates": 40}, "40 updates from data need data; give the folder of a dataset"),
        ({"updates": 1}, "1 update from data need data; give the folder of a dataset"),
        ({"data": "walk"}, "data without updates has no effect; give it as demonstrations"),
        (
            {"data": "walk", "updates": 40, "demonstrations": "walk"},
            "what learns from data alone takes no demonstrations; omit them",
        ),
        (
            {"data": "walk", "updates": 1, "episodes": 2},
            "1 update cannot be spread over 2 episodes; give fewer episodes",
        ),
        (
            {"data": "walk", "updates": 39},
            "39 updates cannot be spread over 40 episodes; give fewer episodes",
        ),
        (
            {"robots": 2, "hub": "ble:A"},
            "real robots are named one by one, such as ble:A,ble:B; omit robots",
        ),
        (
            {"hub": "ble:A,virtual"},
            "the hubs ble:A,virtual are ambiguous; give each robot a name, such as ble:A,ble:B",
        ),
        (
            {"hub": "ble:A,usb"},
            "the hubs ble:A,usb are ambiguous; give each robot a name, such as ble:A,ble:B",
        ),
        (
            {"hub": "ble:A,ble:B", "eval_every": 1},
            "a fleet does not support num_envs, eval_every and updates; omit them",
        ),
    ],
)
def test_what_excludes_what_is_said(together: dict[str, Any], message: str) -> None:
    with pytest.raises(RunError) as raised:
        TrainConfig(env="RunAway-v0", **together)
    assert str(raised.value) == message


@pytest.mark.parametrize("hub", ["virtual", "virtual,virtual", "ble", "usb", "ble:A,usb:B"])
def test_robots_that_are_told_apart_make_a_run(hub: str) -> None:
    config = TrainConfig("RunAway-v0", hub=hub)
    assert config.hubs == tuple(hub.split(","))


def test_config_is_alike_on_all_computers(tmp_path: Path) -> None:
    """Of the user's files it has the names alone, wherever they lie."""
    files = {"env": "far.py:TASK", "agent": "mine.py", "transform": "halved.py", "scene": "mat.png"}
    data = {name: str(tmp_path / file) for name, file in files.items()}
    data |= {"seed": 3, "settings": {"network": str(tmp_path / "net.py"), "gamma": 0.5}}
    assert portable(data) == files | {"seed": 3, "settings": {"network": "net.py", "gamma": 0.5}}
    plain = {"env": "RunAway-v0", "agent": "sac", "transform": None, "settings": {}}
    assert portable(plain) == plain
    assert data["env"] == str(tmp_path / "far.py:TASK"), "what was given is unchanged"


def test_defaults_of_a_run() -> None:
    config = TrainConfig("RunAway-v0")
    given = {
        "agent": "sac",
        "episodes": 40,
        "seed": 0,
        "num_envs": 1,
        "robots": 1,
        "device": "cpu",
        "eval_every": 0,
        "eval_episodes": 5,
        "record": True,
        "log": "none",
        "updates": 0,
        "patience_s": 300.0,
    }
    assert {name: getattr(config, name) for name in given} == given


def test_config_that_is_damaged_says_what_to_do() -> None:
    data = TrainConfig("RunAway-v0").to_dict()
    with pytest.raises(RunError) as raised:
        TrainConfig.from_dict({**data, "settings": []})
    assert str(raised.value) == "'settings' in the config is not a table; restore the file"
    with pytest.raises(RunError, match=r"^the config is invalid: .*; restore the file or start a"):
        TrainConfig.from_dict({**data, "colour": "red"})
    with pytest.raises(RunError, match=r"^the run needs what is not here: .*no agent"):
        TrainConfig.from_dict({**data, "agent": "sca"})
    assert TrainConfig.from_dict({**data, "settings": None}).settings == preset("default", "sac")


def test_data_are_what_is_learned_from_before_demonstrations() -> None:
    of_data = TrainConfig("RunAway-v0", data="a", updates=100)
    taught = TrainConfig("RunAway-v0", demonstrations="b")
    assert (of_data.dataset, taught.dataset) == ("a", "b")
    assert TrainConfig("RunAway-v0").dataset is None
