"""Robots and teleoperators as LeRobot uses them, on the virtual hub."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("lerobot", reason="could not import 'lerobot'")

import lerobot_robot_bricksrl as plugin
from lerobot.robots.config import RobotConfig
from lerobot.robots.utils import make_robot_from_config
from lerobot.teleoperators.utils import make_teleoperator_from_config
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError
from prompt_toolkit.input import create_pipe_input

from bricksrl.teleoperation import KeyboardDriver


@pytest.fixture
def walker(tmp_path: Path) -> plugin.BricksRobot:
    robot = make_robot_from_config(
        plugin.BricksWalkerConfig(id="w", seed=1, calibration_dir=tmp_path)
    )
    assert isinstance(robot, plugin.BricksWalker)
    return robot


@pytest.mark.parametrize(
    "kind", ["bricksrl", "bricksrl_walker", "bricksrl_two_wheeler", "bricksrl_robo_arm"]
)
def test_every_description_connects_observes_and_acts(kind: str, tmp_path: Path) -> None:
    config = RobotConfig.get_choice_class(kind)(id="r", seed=1, calibration_dir=tmp_path)
    robot = make_robot_from_config(config)
    features = robot.observation_features
    robot.connect()
    assert robot.is_connected and robot.is_calibrated
    before = robot.get_observation()
    assert before.keys() == features.keys()
    highest = {command.name: command.high for command in robot.task.interface.commands}
    assert robot.send_action(
        {name: value + 1e6 for name, value in highest.items()}
    ) == pytest.approx(highest)
    assert robot.get_observation() != before
    robot.disconnect()
    assert not robot.is_connected


def test_the_camera_of_an_environment_is_one_of_the_robot(tmp_path: Path) -> None:
    robot = make_robot_from_config(
        plugin.BricksRobotConfig(env="RoboArm_mixed-v0", id="r", seed=1, calibration_dir=tmp_path)
    )
    robot.connect()
    image = robot.get_observation()["image"]
    assert robot.observation_features["image"] == image.shape == (64, 64, 3)
    assert image.dtype == "uint8" and len(robot.cameras) == 1
    robot.disconnect()


def test_sensors_on_the_computer_are_observed(tmp_path: Path) -> None:
    (tmp_path / "timed.py").write_text(
        "from dataclasses import replace\n"
        "from brickhub.entry import Entry\n"
        "from bricksrl.envs.host_sensors.host_sensor import HostSensor\n"
        "from bricksrl.envs.tasks.spinning import SPINNING\n"
        "CLOCK = HostSensor('clock', (Entry('second', 0, 60, 's'),), open=dict, twin=lambda "
        "world: (world.now_s(),))\n"
        "TASK = replace(SPINNING, id='Timed-v0', sensors=(CLOCK,))\n"
    )
    env = f"{tmp_path / 'timed.py'}:TASK"
    robot = make_robot_from_config(
        plugin.BricksRobotConfig(env=env, id="r", seed=1, calibration_dir=tmp_path)
    )
    robot.connect()
    assert robot.observation_features["second"] is float and robot.get_observation()["second"] > 0
    robot.disconnect()


def test_what_is_not_connected_says_so(walker: plugin.BricksRobot) -> None:
    with pytest.raises(DeviceNotConnectedError):
        walker.get_observation()
    walker.connect()
    with pytest.raises(DeviceAlreadyConnectedError):
        walker.connect()
    walker.disconnect()


def test_a_lost_link_is_an_error_and_the_robot_connects_again(walker: plugin.BricksRobot) -> None:
    walker.connect()
    rest = dict.fromkeys(walker.action_features, 0.0)
    walker.send_action(rest)
    walker._env.twin.in_reach = lambda: False
    with pytest.raises(ConnectionError, match="out of reach"):
        walker.send_action(rest)
    assert not walker.is_connected
    walker.connect()
    walker.send_action(rest)
    walker.disconnect()


def test_teleoperators_command_in_units(tmp_path: Path) -> None:
    hand = make_teleoperator_from_config(
        plugin.BricksRandomConfig(id="h", env="RunAway-v0", calibration_dir=tmp_path)
    )
    with pytest.raises(DeviceNotConnectedError):
        hand.get_action()
    hand.connect()
    chosen = [hand.get_action()["straight"] for _ in range(20)]
    assert min(chosen) < -20 and max(chosen) > 20 and all(abs(value) <= 100 for value in chosen)
    hand.disconnect()
    keys = make_teleoperator_from_config(
        plugin.BricksKeyboardConfig(id="k", calibration_dir=tmp_path)
    )
    with pytest.raises(ConnectionError, match="terminal"):
        keys.connect()


def test_robot_rests_while_nobody_drives(tmp_path: Path) -> None:
    """The space bar, or the first button of a gamepad, gives control back."""
    keys = make_teleoperator_from_config(
        plugin.BricksKeyboardConfig(id="k", env="Walker-v0", calibration_dir=tmp_path)
    )
    with create_pipe_input() as source:
        keys._driver = KeyboardDriver([command.entry for command in keys.commands], source=source)
        source.send_text("a")
        assert keys.get_action()["left_front"] == -100.0
        source.send_text(" ")
        assert set(keys.get_action().values()) == {0.0}


def test_lerobots_own_commands_record_and_replay(tmp_path: Path) -> None:
    pytest.importorskip("lerobot.scripts.lerobot_record", exc_type=ImportError)
    root = tmp_path / "walker"
    robot = [
        "--robot.type=bricksrl_walker",
        "--robot.id=w",
        f"--robot.calibration_dir={tmp_path / 'c'}",
        "--robot.seed=1",
    ]
    data = ["--dataset.repo_id=me/walker", f"--dataset.root={root}", "--play_sounds=false"]
    record = [
        *(
            "--teleop.type=bricksrl_random",
            "--teleop.id=h",
            f"--teleop.calibration_dir={tmp_path / 'h'}",
        ),
        *(
            "--dataset.single_task=walk",
            "--dataset.fps=10",
            "--dataset.num_episodes=2",
            "--dataset.episode_time_s=2",
        ),
        *("--dataset.reset_time_s=0", "--dataset.push_to_hub=false", "--dataset.video=false"),
    ]
    _run("lerobot.scripts.lerobot_record", *robot, *data, *record)
    assert (root / "meta" / "info.json").exists()
    _run("lerobot.scripts.lerobot_replay", *robot, *data, "--dataset.episode=1")


def _run(module: str, *arguments: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", module, *arguments],
        check=False,
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert done.returncode == 0, done.stderr[-3000:]
