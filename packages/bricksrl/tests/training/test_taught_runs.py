"""Runs with a teacher: demonstrations or a base."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from tensordict import TensorDictBase
from torchrl.envs import EnvBase
from toys import assert_equal

from bricksrl import make
from bricksrl.agents import make_learner, preset
from bricksrl.cli.train import Train
from bricksrl.data import Recorder, describe
from bricksrl.data.collect import collect
from bricksrl.errors import BricksError, CheckpointError, RunError
from bricksrl.evaluation import evaluate
from bricksrl.policies import load_policy
from bricksrl.policies.export import export_model
from bricksrl.policies.sharing import export_policy
from bricksrl.training import Phase, TrainConfig, load_learner, resume, train
from bricksrl.training.checkpoint import load_checkpoint
from bricksrl.training.config import RunOptions
from bricksrl.training.learners import attach_dataset, warm_start

ENV = "RoboArmSim-v0"
SMALL = {"hidden": (64, 64), "batch_size": 64, "prefill_episodes": 1}
TINY = {"hidden": (8,), "batch_size": 16, "prefill_episodes": 1, "updates_per_step": 0.1}
"""Of runs that are not to learn anything."""


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


def short() -> EnvBase:
    """The arm in episodes of a few steps."""
    env = make(ENV)
    env.task = replace(env.task, max_steps=25)
    return env


def small(agent: str, values: dict[str, Any] = SMALL) -> Any:
    settings = preset("default", agent)
    return replace(
        settings, **{name: value for name, value in values.items() if name in vars(settings)}
    )


@pytest.fixture(scope="module")
def iql(data: str, tmp_path_factory: pytest.TempPathFactory) -> str:
    """A run that learned from the dataset alone."""
    run = tmp_path_factory.mktemp("runs") / "iql"
    train(TrainConfig(ENV, "iql", 1, settings=small("iql"), data=data, updates=20, run_dir=run))
    return str(run)


def taught(run_dir: Path, agent: str = "sac", **changes: Any) -> TrainConfig:
    given: dict[str, Any] = {"settings": small(agent), **changes}
    return TrainConfig(ENV, agent, run_dir=run_dir, record=False, **given)


@pytest.mark.parametrize(
    ("agent", "teacher"),
    [
        ("sac", "demonstrations"),
        ("td3", "base"),
        *(
            pytest.param(*more, marks=pytest.mark.slow)
            for more in (("td3", "demonstrations"), ("sac", "base"))
        ),
    ],
)
def test_taught_run_does_not_collapse(data: str, tmp_path: Path, agent: str, teacher: str) -> None:
    """With new critics, an unconstrained actor would lose its policy; and there are no random
    episodes."""
    config = taught(
        tmp_path / "run",
        agent,
        episodes=12,
        **{teacher: data if teacher == "demonstrations" else "scripted"},
    )
    episodes = train(config).episodes
    assert {episode.phase for episode in episodes} == {Phase.TRAIN}
    assert torch.tensor([episode.return_ for episode in episodes]).mean() > -8.0
    assert evaluate(tmp_path / "run", episodes=20).return_mean > -5.0


def test_taught_runs_are_resumed_to_the_last_digit(
    iql: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Teacher and anchor are in the checkpoint, and demonstrations are not imitated twice."""
    monkeypatch.setattr("bricksrl.agents.teachers.UPDATES", 5)
    tiny = small("sac", TINY)
    for teacher in ("demonstrations", "base"):
        changes: dict[str, Any] = {"settings": tiny, teacher: iql}
        whole = taught(tmp_path / f"{teacher}-whole", episodes=2, **changes)
        train(whole, env=short())
        part = tmp_path / f"{teacher}-part"
        train(replace(whole, run_dir=part, episodes=1), env=short())
        resume(part, episodes=2, env=short())
        one, other = (
            load_checkpoint(path / "checkpoint.bin")["agent"]
            for path in (whole.run_dir, part)
            if path
        )
        assert one["updates"] > 0
        assert_equal(one, other)


def test_run_demonstrates_what_its_policy_does(
    iql: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the steps of the data that it learned from, or of those that it recorded."""
    monkeypatch.setattr("bricksrl.agents.teachers.UPDATES", 400)
    config, env = taught(tmp_path / "run", episodes=1, demonstrations=iql), make(ENV, seed=0)
    learner = make_learner("sac", env, config.settings)
    frames = attach_dataset(config, learner, env)
    assert (
        frames is not None and learner.dataset is not None and len(learner.dataset) == len(frames)
    )
    warm_start(config, learner, env, frames)
    shown = load_learner(iql, env).learner.exploit(frames.select("observation"))["action"]
    assert (
        float((learner.exploit(frames.select("observation"))["action"] - shown).abs().mean()) < 0.1
    )


def test_residual_run_is_a_policy_and_goes_on(iql: str, tmp_path: Path) -> None:
    run = tmp_path / "run"
    tiny = small("sac", TINY)
    train(taught(run, episodes=2, base=iql, settings=tiny))
    policy, observation = load_policy(run), make(ENV, seed=3).reset()["observation"]
    assert export_model(run, tmp_path / "policy.pt2") < 1e-5
    module = torch.export.load(tmp_path / "policy.pt2").module()
    torch.testing.assert_close(module(observation[None])[0], policy.act(observation))
    assert Train(learning=RunOptions(start=str(run))).config(ENV).base == iql
    train(taught(tmp_path / "on", episodes=1, base=iql, start=str(run), settings=tiny))
    with pytest.raises(CheckpointError, match="adds to the base .*iql, not to None; give its own"):
        train(taught(tmp_path / "no", start=str(run), settings=tiny))
    with pytest.raises(RunError, match="a shared policy comes without the run of its base"):
        export_policy(run, tmp_path / "shared")


@pytest.mark.parametrize(
    ("agent", "changes", "says"),
    [
        ("sac", {"base": "nowhere"}, "there is no run in nowhere"),
        ("tqc", {"base": "scripted"}, "only sac, droq, .* can be taught"),
        ("sac", {"data": "d"}, "data without updates has no effect; give it as demonstrations"),
        ("sac", {"data": "d", "demonstrations": "d", "updates": 40}, "takes no demonstrations"),
        (
            "td3",
            {"start": "iql"},
            "iql is iql's, not td3's; .* let the run demonstrate: --demonstrations",
        ),
    ],
)
def test_teachers_that_do_not_fit_raise(
    iql: str, tmp_path: Path, agent: str, changes: dict[str, Any], says: str
) -> None:
    changes = {name: iql if value == "iql" else value for name, value in changes.items()}
    with pytest.raises(BricksError, match=says):
        train(taught(tmp_path / "run", agent, **changes))
    assert not (tmp_path / "run").exists()
