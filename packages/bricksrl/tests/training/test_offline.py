"""Offline runs and warm starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import torch
from tensordict import TensorDictBase
from test_training_loop import Recorder as Listener
from test_training_loop import assert_same_run, ctrl_c, names, rows
from toys import Cart, LosingCart, assert_equal

import bricksrl
from brickhub.entry import Entry
from bricksrl.agents import make_learner, preset
from bricksrl.agents.offline.act import ChunkPolicy
from bricksrl.data import About, Recorder, Step, describe
from bricksrl.data.collect import collect, random_policy
from bricksrl.errors import CheckpointError, DataError, DescriptionError, HubError, RunError
from bricksrl.evaluation import evaluate
from bricksrl.training import Phase, RunFolder, TrainConfig, load_learner, resume, train
from bricksrl.training.checkpoint import load_checkpoint, save_checkpoint
from bricksrl.training.learners import read_for


def recorded(root: Path, policy: Any = None, episodes: int = 12) -> str:
    """A dataset of the cart."""
    env = Cart()
    with Recorder(root, describe(env)) as recorder:
        collect(env, policy or random_policy(env, 7), recorder, episodes, name="random")
    return str(root)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> str:
    return recorded(tmp_path_factory.mktemp("data") / "cart", episodes=40)


UPDATES = 9


def small(agent: str, **changes: Any) -> Any:
    return replace(preset("default", agent), **{"hidden": (32, 32), "batch_size": 32, **changes})


def tiny(agent: str, **changes: Any) -> Any:
    """Settings of runs that are not to learn anything."""
    return small(agent, **{"hidden": (8,), "batch_size": 8, **changes})


@pytest.fixture
def config(tmp_path: Path, data: str) -> TrainConfig:
    return TrainConfig(
        "Cart",
        "iql",
        3,
        seed=4,
        settings=tiny("iql"),
        data=data,
        updates=UPDATES,
        run_dir=tmp_path / "run",
    )


def test_offline_run_writes_files(config: TrainConfig) -> None:
    listener = Listener()
    result = train(config, listener, env=Cart())
    assert not result.interrupted
    assert names(result.run_dir) == [
        ".lock",
        "checkpoint.bin",
        "config.json",
        "learning_curve.png",
        "metrics.csv",
    ]
    folder = RunFolder(result.run_dir)
    assert folder.read_config() == config
    assert [episode.phase for episode in folder.read_episodes()] == [Phase.OFFLINE] * 3
    assert set(result.episodes[0].measures) == {
        "loss_qvalue",
        "loss_value",
        "loss_actor",
        "entropy",
    }
    assert listener.calls == ["start 0", "episode 1", "episode 2", "episode 3", "end"]
    found = evaluate(result.run_dir, Cart(), episodes=2)
    assert (found.agent, found.episodes) == ("iql", 2)
    state = load_checkpoint(folder.checkpoint_path)["agent"]
    assert state["updates"] == UPDATES
    assert "memory" not in state  # nothing of what it showed was kept


def test_equal_seeds_give_equal_runs(config: TrainConfig, tmp_path: Path) -> None:
    train(config, env=Cart())
    torch.rand(3)
    train(replace(config, run_dir=tmp_path / "again"), env=Cart())
    assert_same_run(tmp_path / "run", tmp_path / "again")
    train(replace(config, run_dir=tmp_path / "other", seed=5), env=Cart())
    assert rows(tmp_path / "run") != rows(tmp_path / "other")


@pytest.mark.parametrize("step", [1, 3])
def test_lost_link_ends_offline_run_and_repeats_no_update(config: TrainConfig, step: int) -> None:
    with pytest.raises(HubError, match="did not answer"):
        train(config, env=LosingCart(step))
    run_dir = config.run_dir
    assert run_dir is not None and len(rows(run_dir)) == 2
    assert resume(run_dir, env=Cart()).episodes[-1].episode == 3
    assert load_checkpoint(run_dir / "checkpoint.bin")["agent"]["updates"] == UPDATES


class Breaking(Cart):
    """Ctrl-C at the start of the second episode, after its updates."""

    def _reset(self, *args: Any, **kwargs: Any) -> Any:
        if self.resets == 1:
            ctrl_c()
        return super()._reset()


def test_interrupted_and_resumed_run_ends_bit_identical(
    config: TrainConfig, tmp_path: Path
) -> None:
    train(replace(config, run_dir=tmp_path / "whole"), env=Cart())
    result = train(config, env=Breaking())
    assert result.interrupted
    assert len(result.episodes) == len(rows(result.run_dir)) == 1
    assert not resume(result.run_dir, env=Cart()).interrupted
    assert_same_run(tmp_path / "whole", tmp_path / "run")
    with pytest.raises(
        RunError, match="learned from data; `bricksrl train ENV --from RUN` goes on"
    ):
        resume(result.run_dir, episodes=9, env=Cart())


@pytest.mark.parametrize(
    ("changes", "error", "says"),
    [
        ({"data": None}, RunError, f"{UPDATES} updates from data need data"),
        ({"updates": -1}, DescriptionError, "updates is -1; give 0 or more"),
        ({"updates": 2}, RunError, "2 updates cannot be spread over 3 episodes"),
    ],
)
def test_invalid_configs_raise(
    config: TrainConfig, changes: dict[str, Any], error: type[Exception], says: str
) -> None:
    with pytest.raises(error, match=says):
        replace(config, **changes)


def test_invalid_offline_agent_leaves_no_folder(config: TrainConfig, tmp_path: Path) -> None:
    with pytest.raises(RunError, match="bc needs demonstrations"):
        train(TrainConfig("Cart", "bc", run_dir=tmp_path / "run"), env=Cart())
    with pytest.raises(RunError, match="random cannot use a dataset"):
        train(replace(config, agent="random", settings=None), env=Cart())
    with pytest.raises(DataError, match="nowhere"):
        train(replace(config, data=str(tmp_path / "nowhere")), env=Cart())
    with pytest.raises(
        DataError, match=r"is of Cart: its observation is \[.*\], not \[left_angle, .*; choose data"
    ):
        train(
            TrainConfig("RunAway-v0", "sac", demonstrations=config.data, run_dir=tmp_path / "run")
        )
    assert names(tmp_path) == []


@pytest.mark.parametrize(
    ("agent", "least", "most"),
    [("bc", -3, 3), ("iql", 3, 8), ("cql", 5, 9), ("td3bc", 5, 9), ("sac", 5, 9)],
)
@pytest.mark.slow
def test_offline_agent_learns_from_data(
    tmp_path: Path, data: str, agent: str, least: int, most: int
) -> None:
    """Random steps drift from the wall; the best policy gets 7 dm in 8 steps.

    BC imitates, and IQL imitates the better half: the mean of its actions stays below the best one.
    """
    changes = {"sampled_actions": 4} if agent == "cql" else {}
    settings = small(agent, **changes)
    config = TrainConfig(
        "Cart", agent, 1, settings=settings, data=data, updates=400, run_dir=tmp_path / "run"
    )
    train(config, env=Cart())
    found = evaluate(tmp_path / "run", Cart(), episodes=10).return_mean
    assert least < found < (3 if agent == "bc" else 9)


@pytest.fixture(scope="module")
def learned(
    data: str, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str], tuple[str, float]]:
    """Run of an agent that has learned from the data, and its mean return."""

    @cache
    def made(agent: str) -> tuple[str, float]:
        settings = small(agent, **({"sampled_actions": 4} if agent == "cql" else {}))
        run_dir = tmp_path_factory.mktemp("learned") / agent
        train(
            TrainConfig(
                "Cart", agent, 1, settings=settings, data=data, updates=400, run_dir=run_dir
            ),
            env=Cart(),
        )
        return str(run_dir), evaluate(run_dir, Cart(), episodes=10).return_mean

    return made


@pytest.mark.parametrize(
    ("agent", "beside"),
    [
        ("sac", False),
        ("sac", True),
        *(
            pytest.param(*more, marks=pytest.mark.slow)
            for more in (("td3", False), ("iql", True), ("iql", False), ("cql", True))
        ),
    ],
)
def test_warm_start_continues(
    tmp_path: Path,
    data: str,
    learned: Callable[[str], tuple[str, float]],
    agent: str,
    beside: bool,
) -> None:
    """It acts as before at once, and stays as good while it learns on, with or without the
    dataset."""
    settings = small(agent, **({"sampled_actions": 4} if agent == "cql" else {}))
    start, before = learned(agent)
    going_on = {"settings": settings, "start": start, "demonstrations": data if beside else None}
    second = TrainConfig("Cart", agent, 8, run_dir=tmp_path / "second", **going_on)
    result = train(second, env=Cart())
    assert {episode.phase for episode in result.episodes} == {Phase.TRAIN}
    assert load_learner(tmp_path / "second", Cart()).learner.updates > 400
    returns = [episode.return_ for episode in result.episodes]
    assert min(returns[0], sum(returns) / 8) > before - 2.5  # it explores
    assert min(returns) > 1.5
    assert evaluate(tmp_path / "second", Cart(), episodes=10).return_mean > before - 1.0


def test_warm_start_copies_whole_agent(tmp_path: Path) -> None:
    """Critics, targets, temperature, optimiser and replay buffer; without them the policy
    degrades."""
    settings = small("sac", prefill_episodes=1)
    first = TrainConfig("Cart", episodes=3, settings=settings, run_dir=tmp_path / "first")
    train(first, env=Cart())
    state = load_checkpoint(tmp_path / "first" / "checkpoint.bin")["agent"]
    taken: list[dict[str, Any]] = []

    class Looking(Listener):
        def on_start(self, config: TrainConfig, run_dir: Path, episodes_done: int) -> None:
            taken.append(load_checkpoint(run_dir / "checkpoint.bin")["agent"])

    second = replace(first, start=str(tmp_path / "first"), episodes=1, run_dir=tmp_path / "second")
    train(second, Looking(), env=Cart())
    fresh = make_learner("sac", Cart(), settings).state_dict()
    assert taken[0].keys() == state.keys() == {*fresh, "memory"}
    assert_equal(taken[0], state)
    known = len(state["memory"]["rows"]["action"])
    rows = load_checkpoint(tmp_path / "second" / "checkpoint.bin")["agent"]["memory"]["rows"]
    assert len(rows["action"]) == known + 8 > 10
    assert torch.equal(rows["observation"][:known], state["memory"]["rows"]["observation"])


def test_first_step_after_warm_start_follows_no_other(tmp_path: Path) -> None:
    """The checkpoint of a fleet may lie in the middle of an episode."""
    settings = tiny("sac", prefill_episodes=1, n_step=2)
    first = TrainConfig("Cart", episodes=2, settings=settings, run_dir=tmp_path / "first")
    train(first, env=Cart())
    path = tmp_path / "first" / "checkpoint.bin"
    state = load_checkpoint(path)
    last = len(state["agent"]["memory"]["rows"]["action"]) - 1
    state["agent"]["memory"]["last"] = torch.tensor([last])
    save_checkpoint(path, state)
    train(
        replace(first, start=str(tmp_path / "first"), episodes=1, run_dir=tmp_path / "second"),
        env=Cart(),
    )
    memory = load_checkpoint(tmp_path / "second" / "checkpoint.bin")["agent"]["memory"]
    assert (
        memory["successor"][last] == settings.buffer_size
        and memory["successor"][last + 1] == last + 2
    )


def test_warm_start_of_other_settings_raises(config: TrainConfig, tmp_path: Path) -> None:
    train(config, env=Cart())
    start = str(tmp_path / "run")
    wanted = TrainConfig(
        "Cart", "iql", settings=config.settings, start=start, run_dir=tmp_path / "next"
    )
    with pytest.raises(CheckpointError, match="run is iql's, not crossq's; "):
        train(replace(wanted, agent="crossq", settings=tiny("crossq")), env=Cart())
    with pytest.raises(CheckpointError, match=r"has other settings: gamma 0\.95, not 0\.5; go"):
        train(replace(wanted, settings=tiny("iql", gamma=0.5)), env=Cart())
    with pytest.raises(RunError, match="no run in"):
        train(replace(wanted, start=str(tmp_path / "nowhere")), env=Cart())
    assert names(tmp_path) == ["run"]


@pytest.mark.usefixtures("forked_children")
def test_asynchronous_learner_uses_dataset(
    config: TrainConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """ACT needs the dataset, and its actor needs resets."""
    starts: list[ChunkPolicy] = []
    # append is no method
    monkeypatch.setattr(ChunkPolicy, "reset", lambda self: starts.append(self))  # noqa: PLW0108
    given = {"data": None, "demonstrations": config.data, "updates": 0}
    beside = replace(
        config,
        agent="act",
        settings=replace(preset("default", "act"), width=8, feedforward=8, heads=2, batch_size=8),
        episodes=3,
        asynchronous=True,
        **given,
    )
    result = train(beside, env=Cart())
    state = load_checkpoint(tmp_path / "run" / "checkpoint.bin")["agent"]
    assert len(starts) == 3
    # it does not wait for the last ones
    assert 0 < state["updates"] <= 2 * result.episodes[-1].steps


@pytest.mark.slow
def test_iql_reaches_goals_of_demonstrations(tmp_path: Path) -> None:
    """With the default settings: actions for one goal are not imitated for another."""

    def reach(state: TensorDictBase) -> TensorDictBase:
        lacks = state["observation"][4:] - state["observation"][:4]
        lacks[0] = (lacks[0] + 180.0) % 360.0 - 180.0
        return state.set(
            "action", (lacks / torch.tensor([100.0, 30.0, 60.0, 25.0])).clamp(-1.0, 1.0)
        )

    env = bricksrl.make("RoboArmSim-v0", seed=0)
    with Recorder(tmp_path / "data", describe(env)) as recorder:
        collect(env, reach, recorder, 40, name="reach")
    settings = replace(preset("default", "iql"), hidden=(64, 64))
    config = TrainConfig(
        "RoboArmSim-v0", "iql", 1, settings=settings, data=str(tmp_path / "data"), updates=800
    )
    train(replace(config, run_dir=tmp_path / "run", record=False))
    assert evaluate(tmp_path / "run", episodes=10).success_rate >= 0.9


def test_entries_that_are_not_observed_are_left_out(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """One line says it; the others are taken by name, in the environment's order."""
    env = Cart()
    own = describe(env)
    wider = replace(own, observation=(Entry("acceleration_x"), *reversed(own.observation)))
    steps = [Step([7.0, 2.0, 1.0], [0.5], 1.0, [7.0, 4.0, 3.0], False, True)]
    with Recorder(tmp_path / "set", wider) as recorder:
        recorder.write(steps, About())
    data = read_for(str(tmp_path / "set"), env, images=False)
    assert data.observation.tolist() == [[1.0, 2.0]] and data.next_observation.tolist() == [
        [3.0, 4.0]
    ]
    assert [record.getMessage() for record in caplog.records] == [
        f"{tmp_path / 'set'} has acceleration_x, which Cart does not observe; it is left out"
    ]
