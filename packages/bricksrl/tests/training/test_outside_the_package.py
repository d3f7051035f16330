"""A sensor, a robot, a task and an algorithm in one file each, outside of the package."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

import bricksrl
from brickhub.entry import Entry
from brickhub.finding import Outcome
from brickhub.hub.program.generate import generate
from bricksrl.data import load
from bricksrl.envs.env_checker import check_env
from bricksrl.errors import RunError
from bricksrl.evaluation import evaluate
from bricksrl.policies import load_policy
from bricksrl.policies.sharing import export_policy
from bricksrl.training import TrainConfig, resume, train
from bricksrl.training.checkpoint import load_checkpoint, save_checkpoint
from bricksrl.training.config import settings_from
from bricksrl.training.trust import trust
from bricktwin.twin.motion_log import RunLog, read_log, write_log

SENSOR = """
from dataclasses import dataclass
from typing import ClassVar

from brickhub.hub.interface import Channel, Imports


@dataclass(frozen=True)
class MotorSpeed(Channel):
    motor: str
    low: float = -1000.0
    high: float = 1000.0
    scale: ClassVar[int] = 1
    unit: ClassVar[str] = "deg/s"

    @property
    def name(self):
        return f"{self.motor}_speed"

    @property
    def device(self):
        return self.motor

    @property
    def limits(self):
        return -2000.0, 2000.0

    def check(self, robot):
        robot.motor(self.motor)

    @property
    def expression(self):
        return f"motor_{self.motor}.speed()"


@dataclass(frozen=True)
class Battery(Channel):
    low: float = 6000.0
    high: float = 8400.0
    scale: ClassVar[int] = 1
    unit: ClassVar[str] = "mV"
    name: ClassVar[str] = "battery"
    imports: ClassVar[Imports] = (("pybricks.tools", "StopWatch"),)
    statement: ClassVar[str] = "millivolts = hub.battery.voltage()"
    expression: ClassVar[str] = "millivolts"

    def check(self, robot):
        pass
"""
ROBOT = """
from brickhub.robot import HubKind, Motor, Robot

SPINNER = Robot("spinner", HubKind.TECHNIC, motors=(Motor("disc", "A"),))
"""
TASK = """
from bricksrl.envs import Task
from brickhub.hub.interface import Interface, MotorAngle, RunAngle, Wait
from my_robot import SPINNER
from my_sensor import Battery, MotorSpeed

FAST = Task(
    id="Fast-v0",
    doc="A disc turns fast.",
    robot=SPINNER,
    interface=Interface((RunAngle("disc", -90, 90, 800),), (MotorAngle("disc"), MotorSpeed("disc"), Battery()), Wait(100)),
    max_steps=6,
    reward=lambda previous, action, observation: observation[..., 1:2] / 1000.0,
    success=lambda observations: observations[..., -1, 1] > 100.0,
    metrics=lambda observations: {"speed_deg_s": observations[..., 1].mean(-1)},
)
"""  # noqa: E501
AGENT = """
from dataclasses import dataclass

import torch
from torchrl.objectives import DDPGLoss, SoftUpdate

from bricksrl.agents.features.encoder import make_encoder
from bricksrl.agents.gradient_descent import GradientDescent
from bricksrl.agents.networks import action_size, action_spec, deterministic_policy, make_body
from bricksrl.agents.operators import critic_operator
from bricksrl.agents.replay.buffer import make_replay_buffer
from bricksrl.agents.replay.replay_learner import ReplayLearner
from bricksrl.agents.settings import OffPolicySettings


@dataclass(frozen=True)
class DDPGSettings(OffPolicySettings):
    hidden: tuple[int, ...] = (16, 16)
    batch_size: int = 4
    prefill_episodes: int = 1


def build(env, settings: DDPGSettings, device="cpu"):
    m, encoder = action_size(env), make_encoder(env, settings)
    actor, policy = deterministic_policy(encoder, make_body(settings, encoder.size, m), action_spec(env), noise=0.2)
    critic = critic_operator(encoder, make_body(settings, encoder.size + m, 1))
    loss = DDPGLoss(actor, critic, delay_actor=True, delay_value=True)
    optimizer = torch.optim.Adam(loss.parameters(), lr=settings.learning_rate)
    memory = make_replay_buffer(env, settings, device)
    descent = GradientDescent(loss, optimizer, SoftUpdate(loss, tau=0.01))
    return ReplayLearner(policy, descent, memory, prefill_episodes=settings.prefill_episodes)
"""  # noqa: E501


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    for name, text in {
        "my_sensor": SENSOR,
        "my_robot": ROBOT,
        "my_task": TASK,
        "my_agent": AGENT,
    }.items():
        (tmp_path / f"{name}.py").write_text(text)
    yield tmp_path
    for name in ("my_sensor", "my_robot"):
        sys.modules.pop(name, None)


def test_user_channels_are_in_program_and_env(folder: Path) -> None:
    reference = f"{folder / 'my_task.py'}:FAST"
    task = bricksrl.envs.get_task(reference)
    program = generate(task.robot, task.interface).source
    assert "wire(motor_disc.speed() * 1)," in program
    assert (
        "    millivolts = hub.battery.voltage()\n" in program
        and "from pybricks.tools import StopWatch\n" in program
    )
    assert task.entries[1] == Entry("disc_speed", -1000.0, 1000.0, "deg/s", (-2000.0, 2000.0))
    assert [finding for finding in check_env(reference) if finding.outcome is Outcome.ERROR] == []
    env = bricksrl.make(reference, seed=0)
    observation = env.rollout(5, lambda *_: torch.ones(1))["next", "observation"]
    env.close()
    assert observation[-1, 1] > 200
    assert float(observation[-1, 2]) == pytest.approx(7200, abs=300)
    assert env.observation_spec["observation"].nominal.tolist() == [False, True, False]


def test_user_algorithm_learns_from_user_channels(folder: Path) -> None:
    config = TrainConfig(
        f"{folder / 'my_task.py'}:FAST",
        agent=str(folder / "my_agent.py"),
        episodes=4,
        run_dir=folder / "run",
    )
    result = train(config)
    assert [episode.length for episode in result.episodes] == [6] * 4
    data = load(folder / "run")
    assert [entry.name for entry in data.description.observation] == [
        "disc_angle",
        "disc_speed",
        "battery",
    ]


def test_motion_log_of_user_channels_round_trip(folder: Path) -> None:
    task = bricksrl.envs.get_task(f"{folder / 'my_task.py'}:FAST")
    log = RunLog(
        "spinner",
        task.interface,
        7,
        np.zeros((1, 1)),
        np.zeros(1),
        np.array([0, 100]),
        np.ones((2, 3)),
    )
    write_log(folder / "log.jsonl", log)
    assert read_log(folder / "log.jsonl").interface == task.interface


def test_run_of_user_files_can_be_used_in_any_folder(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "my_network.py").write_text(
        "import torch\ndef make_network(m, n):\n    return torch.nn.Linear(m, n)\n"
    )
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder)
    settings = settings_from("my_agent.py", {"network": "my_network.py"})
    run = train(
        TrainConfig("my_task.py:FAST", agent="my_agent.py", episodes=2, settings=settings)
    ).run_dir.absolute()
    assert run.name == "my_task.py-FAST-my_agent.py-seed-0"
    export_policy(run, folder / "policy")
    monkeypatch.chdir(folder / "elsewhere")
    assert evaluate(run, episodes=1).env == "Fast-v0"
    assert len(resume(run, episodes=3).episodes) == 3
    assert load_policy(run).act(np.zeros(3)).shape == (1,)
    shared = json.loads((folder / "policy" / "policy.json").read_text())["config"]
    names = (shared["env"], shared["agent"], shared["settings"]["network"])
    # nobody else has the folders of this computer
    assert names == ("my_task.py:FAST", "my_agent.py", "my_network.py")
    (folder / "my_agent.py").rename(folder / "renamed.py")
    missing = re.escape(str(folder / "my_agent.py"))
    with pytest.raises(
        RunError,
        match=rf"^the run needs what is not here: there is no file {missing}; put it there, [^;]*$",
    ):
        evaluate(run, episodes=1)


def test_run_with_relative_paths_of_an_earlier_version(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    run = train(TrainConfig("my_task.py:FAST", agent="my_agent.py", episodes=2)).run_dir
    config, state = (
        json.loads((run / "config.json").read_text()),
        load_checkpoint(run / "checkpoint.bin"),
    )
    for values in (config["config"], state["identity"]):
        values |= {"env": "my_task.py:FAST", "agent": "my_agent.py"}
    (run / "config.json").write_text(json.dumps(config))
    save_checkpoint(run / "checkpoint.bin", state)
    trust(run)
    assert len(resume(run, episodes=3).episodes) == 3
