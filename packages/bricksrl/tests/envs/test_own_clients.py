"""Tasks and environments over a client program of one's own, trained on the virtual hub."""

from __future__ import annotations

import logging
import re
import sys
from contextlib import closing
from pathlib import Path

import pytest
import torch
from tensordict import TensorDictBase

import bricksrl
from bricksrl.cli import main
from bricksrl.data import load
from bricksrl.envs.registry import get_task
from bricksrl.errors import DescriptionError, ProgramError
from bricksrl.training import RunFolder

# The client of the paper's appendix; today's Pybricks wants the size of a drive base, and the
# angles are wrapped.
CLIENT = """
import ustruct
from micropython import kbd_intr
from pybricks.hubs import InventorHub
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import Motor, UltrasonicSensor
from pybricks.robotics import DriveBase
from pybricks.tools import wait
from uselect import poll
from usys import stdin, stdout

kbd_intr(-1)
hub = InventorHub()
left_motor = Motor(Port.E, Direction.COUNTERCLOCKWISE)
right_motor = Motor(Port.A)
drive_base = DriveBase(left_motor, right_motor, wheel_diameter=56, axle_track=130)
sensor = UltrasonicSensor(Port.C)
keyboard = poll()
keyboard.register(stdin)

while True:
    while not keyboard.poll(0):
        wait(1)
    action = ustruct.unpack("!f", stdin.buffer.read(4))[0]
    drive_base.straight(100 * action, wait=True)
    (left_m_angle, right_m_angle) = (left_motor.angle() % 360, right_motor.angle() % 360)
    (pitch, roll) = hub.imu.tilt()
    dist = sensor.distance()
    out_msg = ustruct.pack("!fffff", left_m_angle, right_m_angle, pitch, roll, dist)
    stdout.buffer.write(out_msg)
"""

# The environment of the paper's appendix, with today's names in TorchRL, and the names that it
# leaves out.
ENVIRONMENT = """
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Bounded, Composite

from bricksrl.envs.base_env import BaseEnv
from bricksrl.robots import TWO_WHEELER
from bricksrl.twin.scene import Scene


class TaskEnvironment(BaseEnv):
    robot, program, scene = TWO_WHEELER, "client.py", Scene(wall_distance_mm=(150, 350))
    max_episode_steps = 8

    action_dim = 1
    state_dim = 5
    motor_angles = [0, 360]
    roll_angles = [-90, 90]
    pitch_angles = [-90, 90]
    distance = [0, 2000]
    observation_key = "vec_observation"

    def __init__(self):
        self._batch_size = torch.Size([1])
        self.action_spec = Bounded(low=-1, high=1, shape=(1, self.action_dim))
        bounds = torch.tensor([[self.motor_angles, self.motor_angles, self.roll_angles, self.pitch_angles, self.distance]])
        observation_spec = Bounded(low=bounds[..., 0], high=bounds[..., 1])
        self.observation_spec = Composite({self.observation_key: observation_spec}, shape=(1,))
        super().__init__(action_dim=self.action_dim, state_dim=self.state_dim)

    def _reset(self, tensordict: TensorDictBase, **kwargs) -> TensorDictBase:
        observation = self.read_from_hub()
        norm_observation = self.normalize_state(observation)
        return TensorDict({self.observation_key: norm_observation.float()}, batch_size=[1])

    def reward(self, state, action, next_state):
        moved_mm = float(next_state[0, -1] - state[0, -1])
        reward, done = (moved_mm > 1) - (moved_mm < -1), bool(next_state[0, -1] <= 40)
        return reward, done

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        action = tensordict.get("action").cpu().numpy().squeeze(0)
        self.send_to_hub(action)
        next_observation = self.read_from_hub()
        state = tensordict.get(self.original_vec_observation_key)
        reward, done = self.reward(state=state, action=action, next_state=next_observation)
        next_tensordict = TensorDict(
            {
                self.observation_key: self.normalize_state(next_observation).float(),
                "reward": torch.tensor([reward]).float(),
                "done": torch.tensor([done]).bool(),
            },
            batch_size=[1],
            device=tensordict.device,
        )
        return next_tensordict
"""  # noqa: E501

# An existing task in three lines.
TASK = """
from dataclasses import replace
from bricksrl.envs import get_task
TASK = replace(get_task("RunAway-v0"), id="Mine-v0", program="mm.py", commands="!f", answer="!fffff")
"""  # noqa: E501


def back(tensordict: TensorDictBase) -> TensorDictBase:
    """Away from the wall, as fast as possible."""
    return tensordict.set("action", -torch.ones(1))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "client.py").write_text(CLIENT)
    (tmp_path / "mm.py").write_text(CLIENT.replace("100 * action", "action"))
    (tmp_path / "my_env.py").write_text(ENVIRONMENT)
    (tmp_path / "my_task.py").write_text(TASK)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    return tmp_path


def test_existing_task_with_a_client_beside_its_file(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING), closing(bricksrl.make("../my_task.py", seed=0)) as env:
        episode = env.rollout(4, back)
        env.reset()  # another episode has a robot of its own
        assert env.task.program == str(folder / "mm.py")
    moved = episode["next", "observation"][:, 4] - episode["observation"][:, 4]
    assert moved.tolist() == pytest.approx([100.0] * 4, abs=15), (
        "the command is in millimetres, as the task says"
    )
    assert sum("has no watchdog" in record.message for record in caplog.records) == 1


@pytest.mark.slow
def test_environment_of_the_paper_is_trained(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reference = "../my_env.py:TaskEnvironment"
    assert main(["check", reference]) == 0
    run = folder / "run"
    assert main(["train", reference, "--episodes", "25", "--run", str(run)]) == 0, (
        capsys.readouterr().err
    )
    episodes = RunFolder(run).read_episodes()
    assert sum(episode.return_ for episode in episodes[-5:]) > 5 * 5, "it drives away from the wall"
    data = load(run)
    assert data.description.env == "TaskEnvironment-v0" and len(data) == sum(
        episode.length for episode in episodes
    )
    assert main(["resume", str(run), "--episodes", "26"]) == 0


@pytest.mark.slow
def test_environment_of_the_page_learns_what_the_page_says(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (Path(__file__).parents[4] / "docs" / "own_client.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    (folder / "client.py").write_text(blocks[0])
    (folder / "my_env.py").write_text(
        next(block for block in blocks if "class TaskEnvironment" in block)
    )
    run = folder / "run"
    # With a report, whose environment is that of the file.
    assert (
        main(
            [
                "train",
                "../my_env.py:TaskEnvironment",
                "--episodes",
                "12",
                "--no-film",
                "--run",
                str(run),
            ]
        )
        == 0
    )
    printed = capsys.readouterr()
    assert "report " in printed.out
    assert printed.err.count("has no watchdog") <= 2, (
        "said once by the training, and once by the evaluation"
    )
    returns = [episode.return_ for episode in RunFolder(run).read_episodes()]
    assert sum(returns[-5:]) / 5 > 15, "the page says 16 to 18"


def test_environment_has_a_time_limit(folder: Path) -> None:
    with closing(bricksrl.make("../my_env.py:TaskEnvironment", seed=0)) as env:
        episode = env.rollout(20, back)
        assert (
            episode.shape == (8,)
            and bool(episode["next", "truncated"][-1])
            and not bool(episode["next", "terminated"][-1])
        )


def test_lost_step_of_an_environment(folder: Path) -> None:
    with closing(bricksrl.make("../my_env.py:TaskEnvironment", seed=0)) as env:
        state = env.reset()
        env.twin.in_reach = lambda: False
        lost = env.step(state.set("action", torch.ones(1)))["next"]
        assert (
            bool(lost["link_lost"])
            and bool(lost["truncated"])
            and lost["observation"].equal(state["observation"])
        )
        env.twin.in_reach = lambda: True
        assert not bool(env.step(env.reset().set("action", torch.ones(1)))["next", "link_lost"])


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("    robot, program, scene", "    ignored, program, scene", "has no attribute 'robot'"),
        ("state_dim = 5", "state_dim = 4", "'!ffff' is not a format for 5 numbers"),
        ('"client.py"', '"clients.py"', "there is no client program 'clients.py'"),
    ],
)
def test_incomplete_environment_is_told(folder: Path, old: str, new: str, problem: str) -> None:
    (folder / "my_env.py").write_text(ENVIRONMENT.replace(old, new))
    with pytest.raises(DescriptionError, match=problem):
        get_task("../my_env.py:TaskEnvironment")


def test_faulty_client_is_told_before_it_starts(folder: Path) -> None:
    (folder / "mm.py").write_text(CLIENT.replace("dist = sensor", "dist = sensors"))
    with pytest.raises(ProgramError, match="mm.py, line 28: nothing sets 'sensors'"):
        bricksrl.make("../my_task.py").reset()
    with pytest.raises(DescriptionError, match="which neither streams nor reads AppData"):
        bricksrl.make("../my_task.py", streaming=True).reset()


def test_check_names_what_never_changes(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a scene, an environment that cannot learn; what is said about the watchdog, once,
    also where only Python's last resort prints it."""
    monkeypatch.setattr(logging.getLogger(), "handlers", [])
    without_scene = ENVIRONMENT.replace("scene = TWO_WHEELER", "other = TWO_WHEELER")
    (folder / "my_env.py").write_text(without_scene)
    assert main(["check", "../my_env.py:TaskEnvironment"]) == 0
    printed = capsys.readouterr()
    line = next(each for each in printed.out.splitlines() if " values " in each)
    assert line.startswith("warning") and "state_4 (2000) never changed" in line
    assert "the reward was always 0" in line
    assert printed.err.count("has no watchdog") == 1


def test_check_names_what_leaves_the_spec(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The spec's bounds are those of the environment, which cuts values beyond them."""
    narrow = re.sub(r"\[0, 360\]", "[0, 90]", ENVIRONMENT)
    assert narrow != ENVIRONMENT
    (folder / "my_env.py").write_text(narrow)
    assert main(["check", "../my_env.py:TaskEnvironment"]) == 1
    printed = capsys.readouterr().out
    assert re.search(r"error +values +state_0 is \d+, outside of 0 to 90", printed), printed


def test_value_outside_of_its_range_is_cut_and_named(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    text = (folder / "mm.py").read_text()
    (folder / "mm.py").write_text(
        text.replace("left_motor.angle() % 360", "left_motor.angle() % 360 + 400")
    )
    with closing(bricksrl.make("../my_task.py", seed=0)) as env:
        episode = env.rollout(3, back)
    assert bool((episode["next", "observation"][:, 0] <= 360).all())
    said = [message for message in caplog.messages if "outside of 0 to 360 deg" in message]
    assert len(said) == 1 and "left_angle is 4" in said[0]
