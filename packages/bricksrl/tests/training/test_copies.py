"""Learning from many copies: batched simulations and virtual robots in processes."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModule
from test_training_loop import Recorder, assert_same_run, ctrl_c, rows

import bricksrl
from bricksrl.agents import preset
from bricksrl.agents.networks import Dropout
from bricksrl.envs.make import make
from bricksrl.envs.rollout import play_episodes
from bricksrl.errors import DescriptionError, RunError
from bricksrl.evaluation import evaluate
from bricksrl.training import Phase, TrainConfig, resume, train
from bricksrl.training.checkpoint import load_checkpoint
from bricksrl.training.learners import one_robot

ENV, COPIES, ROUND = "WalkerSim-v0", 4, 20
SMALL: dict[str, Any] = {"hidden": (8,), "batch_size": 16, "updates_per_step": 0.125}


def test_one_robot_of_many_is_the_first_on_the_processor(tmp_path: Path) -> None:
    copies = config("sac", tmp_path, num_envs=COPIES, device="meta")
    assert one_robot(copies) == replace(copies, num_envs=1, device="cpu")
    fleet = TrainConfig("Walker-v1", hub="virtual,virtual", run_dir=tmp_path)
    assert one_robot(fleet) == replace(fleet, hub="virtual", robots=1)


def config(agent: str, run_dir: Path, **changes: Any) -> TrainConfig:
    settings = preset("default", agent)
    settings = replace(
        settings, **{name: value for name, value in SMALL.items() if name in vars(settings)}
    )
    return TrainConfig(
        ENV,
        agent,
        settings=settings,
        run_dir=run_dir,
        **{
            "options": {"max_steps": ROUND},
            "episodes": 3,
            "num_envs": COPIES,
            "seed": 2,
            **changes,
        },
    )


@pytest.mark.parametrize("agent", ["sac", pytest.param("td3", marks=pytest.mark.slow), "ppo"])
def test_all_copies_are_used_for_learning(tmp_path: Path, agent: str) -> None:
    result = train(config(agent, tmp_path / "run"))
    assert [episode.steps for episode in result.episodes] == [k * COPIES * ROUND for k in (1, 2, 3)]
    assert [episode.phase for episode in result.episodes][1:] == [Phase.TRAIN] * 2
    last = result.episodes[-1]
    assert last.measures and all(torch.isfinite(torch.tensor(list(last.measures.values()))))
    assert 1 <= last.length <= ROUND and last.return_ < 0
    state = load_checkpoint(tmp_path / "run" / "checkpoint.bin")["agent"]
    if agent == "ppo":
        assert "memory" not in state
        return
    assert len(state["memory"]["rows"]["action"]) == 3 * COPIES * ROUND
    assert state["updates"] == 2 * ROUND * 0.125
    assert evaluate(tmp_path / "run", episodes=3, save=False).episodes == 3


@pytest.mark.parametrize("agent", ["sac", "ppo"])
def test_resumed_run_of_copies_is_bit_identical(tmp_path: Path, agent: str) -> None:
    train(config(agent, tmp_path / "whole", episodes=2))
    step = 10 if agent == "ppo" else 7
    result = train(config(agent, tmp_path / "run", episodes=2), Recorder((2, step), ctrl_c))
    assert result.interrupted and len(result.episodes) == len(rows(tmp_path / "run")) == 1
    resume(tmp_path / "run")
    assert_same_run(tmp_path / "whole", tmp_path / "run")


def test_wrapped_buffer_resumes(tmp_path: Path) -> None:
    whole = config("sac", tmp_path / "whole", episodes=2)
    whole = replace(whole, settings=replace(whole.settings, buffer_size=100, n_step=3))
    train(whole)
    train(replace(whole, run_dir=tmp_path / "run", episodes=1))
    resume(tmp_path / "run", episodes=2)
    assert_same_run(tmp_path / "whole", tmp_path / "run")


def test_copies_need_simulated_time() -> None:
    for wrong in ({"hub": "ble"}, {"realtime": True}, {"asynchronous": True}):
        with pytest.raises(RunError, match="copies|num_envs"):
            TrainConfig(ENV, **{"num_envs": 2, **wrong})
    with pytest.raises(DescriptionError, match="num_envs is 0; give 1 or more"):
        TrainConfig(ENV, num_envs=0)


LOSING = """
import multiprocessing, pathlib
from dataclasses import replace
from bricksrl.envs.tasks.run_away import RUN_AWAY
from bricksrl.errors import HubError
from brickhub.virtual.virtual_transport import VirtualHub

TASK = replace(RUN_AWAY, id="Losing-v0", doc="Runs away.", max_steps=6)
write, writes = VirtualHub.write, 0


def losing(self, data):
    global writes
    writes += 1
    if writes == 12:
        raise HubError("the connection was lost; bring the hub nearer")
    write(self, data)


try:
    if multiprocessing.parent_process() is not None:
        pathlib.Path(__file__).with_name("loser").touch(exist_ok=False)
        VirtualHub.write = losing
except FileExistsError:
    pass
"""


PARKING = """
from dataclasses import replace
from bricksrl.envs.tasks.park import PARK

TASK = replace(PARK, id="ShortPark-v0", doc="Parks, in short.", max_steps=4)
"""


@pytest.mark.slow
def test_parallel_robots_learn_and_lost_one_returns(tmp_path: Path) -> None:
    (tmp_path / "losing.py").write_text(LOSING)
    run = TrainConfig(
        f"{tmp_path / 'losing.py'}:TASK",
        episodes=3,
        num_envs=2,
        settings=config("sac", tmp_path).settings,
        run_dir=tmp_path / "run",
    )
    result = train(run)
    assert (tmp_path / "loser").exists()
    assert [episode.steps for episode in result.episodes] == [12, 24, 36]
    assert result.episodes[0].length == 6, (
        "the episode that the lost link cut off after 4 steps does not count"
    )
    kept = load_checkpoint(tmp_path / "run" / "checkpoint.bin")["agent"]["memory"]["rows"]
    assert len(kept["action"]) == 36 - 1, "the step without an outcome is not remembered"
    assert evaluate(tmp_path / "run", episodes=1, save=False).episodes == 1


def test_copies_act_without_dropout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The network that acts is the one that learns, with dropout."""
    seen, forward = [], Dropout.forward

    def noted(self: Dropout, x: torch.Tensor) -> torch.Tensor:
        seen.append((torch.is_grad_enabled(), self.training))
        return forward(self, x)

    monkeypatch.setattr(Dropout, "forward", noted)
    train(TrainConfig("WalkerSim-v0", "random", 1, run_dir=tmp_path / "data"))
    settings = replace(preset("default", "bc"), hidden=(8, 8), updates_per_step=0.1)
    shown = str(tmp_path / "data")
    train(
        TrainConfig(
            "WalkerSim-v0",
            "bc",
            1,
            num_envs=2,
            settings=settings,
            demonstrations=shown,
            run_dir=tmp_path / "run",
        )
    )
    assert set(seen) == {(True, True), (False, False)}


def test_copies_explore_without_the_dropout_of_an_own_network(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen, forward = set(), torch.nn.Dropout.forward

    def noted(self: torch.nn.Dropout, x: torch.Tensor) -> torch.Tensor:
        seen.add((len(x), self.training))
        return forward(self, x)

    monkeypatch.setattr(torch.nn.Dropout, "forward", noted)
    network = tmp_path / "nets.py"
    network.write_text(
        "from torch import nn\ndef make(i, o):\n"
        "    return nn.Sequential(nn.Linear(i, 8), nn.Dropout(0.5), nn.Linear(8, o))\n"
    )
    settings = replace(
        preset("default", "sac"), network=f"{network}:make", batch_size=16, updates_per_step=0.1
    )
    train(
        TrainConfig(
            "WalkerSim-v0", "sac", 3, num_envs=3, settings=settings, run_dir=tmp_path / "run"
        )
    )
    assert seen >= {(3, False), (16, True)}
    assert (3, True) not in seen


class Chunked(TensorDictModule):
    """A policy with a state that only `reset` makes new."""

    def __init__(self) -> None:
        super().__init__(
            lambda observation: observation.new_zeros(*observation.shape[:-1], 4),
            ["observation"],
            ["action"],
        )
        self.resets: list[int] = []
        self.made = 0

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        self.made += 1
        return super().forward(tensordict)

    def reset(self) -> None:
        self.resets.append(self.made)


def test_policy_is_reset_before_each_round_of_evaluated_copies() -> None:
    policy, env = Chunked(), bricksrl.make(ENV, batch_size=2, seed=0, max_steps=ROUND)
    assert len(list(play_episodes(env, policy, 5, seed=1, reset_policy=policy.reset))) == 5
    assert policy.resets == [0, ROUND, 2 * ROUND]


@pytest.mark.slow
def test_parallel_robots_are_evaluated_during_training(tmp_path: Path) -> None:
    (tmp_path / "parking.py").write_text(PARKING)
    run = TrainConfig(
        f"{tmp_path / 'parking.py'}:TASK",
        episodes=1,
        num_envs=2,
        eval_every=1,
        eval_episodes=3,
        settings=config("sac", tmp_path).settings,
        run_dir=tmp_path / "run",
    )
    result = train(run)
    evaluation = result.episodes[0].evaluation
    assert evaluation is not None and math.isfinite(evaluation)
    assert evaluate(tmp_path / "run", episodes=1, which="best", save=False).success_rate is not None


def test_own_copies_without_counters_raise(tmp_path: Path) -> None:
    with pytest.raises(
        RunError, match="copies of your own need TorchRL's RewardSum and StepCounter"
    ):
        train(
            config("sac", tmp_path / "run", num_envs=1),
            env=bricksrl.make(ENV, batch_size=2, max_steps=ROUND),
        )
    own = make(ENV, config("sac", tmp_path), copies=2, seed=0)
    assert (
        train(config("sac", tmp_path / "run", num_envs=1, episodes=1), env=own).episodes[0].steps
        == 2 * ROUND
    )


@pytest.mark.slow
def test_script_without_main_guard_is_told_to_have_one(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "from bricksrl.training import TrainConfig, train\n"
        "train(TrainConfig('RunAway-v0', num_envs=2))\n"
    )
    done = subprocess.run(
        [sys.executable, script],
        capture_output=True,
        text=True,
        timeout=100,
        cwd=tmp_path,
        check=False,
    )
    *_, last = done.stderr.splitlines()
    assert done.returncode == 1
    assert re.search(r"RunError: the 2 processes cannot start; .*__main__", last)
