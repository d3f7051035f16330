"""Warm starts from the policy of another agent."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from tensordict import TensorDictBase
from toys import assert_equal

from bricksrl import make
from bricksrl.agents import make_learner, preset
from bricksrl.agents.policy_transfer import transfer_policy
from bricksrl.cli.train import Train
from bricksrl.data import Recorder, describe
from bricksrl.data.collect import collect
from bricksrl.errors import CheckpointError
from bricksrl.evaluation import evaluate
from bricksrl.training import RunFolder, TrainConfig, load_learner, resume, train
from bricksrl.training.checkpoint import load_checkpoint, save_checkpoint
from bricksrl.training.restore import settings_like

ENV = "RoboArmSim-v0"
SMALL = {"hidden": (64, 64), "batch_size": 64, "prefill_episodes": 1}


def to_the_goal(state: TensorDictBase) -> TensorDictBase:
    """Remaining angles of the arm, limited to a step."""
    angle, goal = state["observation"].split(4)
    way = goal - angle
    way[0] -= 360.0 * (way[0] / 360.0).round()
    return state.set("action", (way / torch.tensor([100.0, 30.0, 60.0, 25.0])).clamp(-1.0, 1.0))


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> str:
    root = tmp_path_factory.mktemp("data") / "arm"
    env = make(ENV, seed=0)
    with Recorder(root, describe(env)) as recorder:
        collect(env, to_the_goal, recorder, 60, name="scripted")
    return str(root)


def small(agent: str) -> Any:
    settings = preset("default", agent)
    return replace(settings, **{name: value for name, value in SMALL.items() if name in vars(settings)})


@pytest.fixture(scope="module")
def runs(data: str, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Agents trained on the dataset only."""
    root = tmp_path_factory.mktemp("runs")
    for agent, updates in (("bc", 1500), ("iql", 20), ("sac", 20), ("td3", 20)):
        train(TrainConfig(ENV, agent, 1, settings=small(agent), data=data, updates=updates, run_dir=root / agent))
    return {path.name: str(path) for path in root.iterdir()}


def going_on(start: str, agent: str, run_dir: Path, **changes: Any) -> TrainConfig:
    settings = settings_like(RunFolder(Path(start)).read_config(), small(agent))
    return TrainConfig(ENV, agent, settings=settings, start=start, run_dir=run_dir, record=False, **changes)


@pytest.mark.parametrize(
    ("before", "after"),
    [("bc", "sac"), ("bc", "td3"), ("bc", "cql"), ("iql", "redq"), ("sac", "droq"), ("td3", "droq"), ("td3", "sac")],
)
def test_transferred_policy_is_equal(runs: dict[str, str], before: str, after: str) -> None:
    env = make(ENV, seed=3)
    one = load_learner(runs[before], env).learner
    settings = going_on(runs[before], after, Path("nowhere")).settings
    other = make_learner(after, env, settings)
    transfer_policy(other, one)
    for _ in range(5):
        state = env.reset()
        torch.testing.assert_close(one.exploit(state)["action"], other.exploit(state)["action"])
        explored = torch.stack([other.explore(state)["action"] for _ in range(50)])
        assert explored.std(0).max() > 0.01


@pytest.mark.parametrize(("agent", "beside"), [("sac", True), ("sac", False), pytest.param("td3", True, marks=pytest.mark.slow)])
def test_warm_started_run_does_not_collapse(runs: dict[str, str], data: str, tmp_path: Path, agent: str, beside: bool) -> None:
    """With new critics, an unconstrained actor would lose its policy."""
    before = evaluate(Path(runs["bc"]), episodes=20).return_mean
    config = going_on(runs["bc"], agent, tmp_path / "run", episodes=20, data=data if beside else None)
    returns = torch.tensor([episode.return_ for episode in train(config).episodes])
    assert before > -5.0
    assert returns.mean() > before - 3.0
    assert evaluate(tmp_path / "run", episodes=20).return_mean > before - 1.0


def test_anchor_is_resumed(runs: dict[str, str], data: str, tmp_path: Path) -> None:
    """A resumed run equals an uninterrupted one: the anchor's policy is in the checkpoint."""
    whole = going_on(runs["bc"], "sac", tmp_path / "whole", episodes=4, data=data)
    train(whole)
    train(replace(whole, run_dir=tmp_path / "part", episodes=2))
    resume(tmp_path / "part", episodes=4)
    one, other = (load_checkpoint(tmp_path / name / "checkpoint.bin")["agent"] for name in ("whole", "part"))
    assert one["updates"] > 0
    assert_equal(one, other)
    held = load_learner(tmp_path / "whole", make(ENV, seed=0)).learner.loss.anchor
    assert held is not None and 0 < held.get_extra_state()["made"] == one["updates"]
    before = load_learner(runs["bc"], make(ENV, seed=0)).learner
    observation = make(ENV, seed=1).reset()
    features = before.policy.module.encoder(observation["observation"])
    action = held.policy(features)[:4].tanh()
    torch.testing.assert_close(action, before.exploit(observation)["action"])


def test_anchor_ends(runs: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bricksrl.agents.policy_transfer.STEPS", 5)
    train(going_on(runs["sac"], "td3", tmp_path / "run", episodes=3))
    state = load_checkpoint(tmp_path / "run" / "checkpoint.bin")["agent"]
    settings = small("td3")
    updates = round(5 * settings.updates_per_step / settings.actor_delay)
    assert state["loss"]["anchor._extra_state"] == {"made": updates} and state["updates"] > settings.actor_delay * updates


@pytest.mark.parametrize(
    ("before", "after", "changes", "says"),
    [
        (
            "bc",
            "crossq",
            {},
            "which is bc's, does not fit crossq: its network is .* with 2 normal.*, not .* with 3 normal",
        ),
        ("sac", "td3", {"hidden": (32,)}, "its network is 14-64-64 units on .* features, not 14-32 units"),
        ("sac", "td3", {"angles": "raw"}, "on 14 features, not .* on 12 features"),
        ("sac", "act", {}, "which is sac's, does not fit act: "),
        ("sac", "td3bc", {}, "which is sac's, does not fit td3bc: "),
    ],
)
def test_policy_of_other_form_raises(
    runs: dict[str, str], data: str, tmp_path: Path, before: str, after: str, changes: dict[str, Any], says: str
) -> None:
    config = going_on(runs[before], after, tmp_path / "run", data=data)
    with pytest.raises(CheckpointError, match=says):
        train(replace(config, settings=replace(config.settings, **changes)))
    assert not (tmp_path / "run").exists()


def test_command_adapts_network_to_policy(runs: dict[str, str]) -> None:
    config = Train(start=Path(runs["bc"]), agent="sac").config(ENV)
    assert config.settings == replace(preset("default", "sac"), hidden=(64, 64), actor_layer_norm=True)
    assert Train(start=Path(runs["bc"])).config(ENV).settings == RunFolder(Path(runs["bc"])).read_config().settings


def test_older_runs_without_new_settings_are_read(runs: dict[str, str], tmp_path: Path) -> None:
    state = load_checkpoint(Path(runs["sac"]) / "checkpoint.bin")
    folder = RunFolder(tmp_path)
    folder.write_config(RunFolder(Path(runs["sac"])).read_config())
    del state["identity"]["settings"]["actor_layer_norm"]
    save_checkpoint(folder.checkpoint_path, state)
    assert load_learner(tmp_path, make(ENV, seed=0)).episodes == 1
