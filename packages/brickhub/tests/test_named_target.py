"""Targets of commands, by name: robots in users' files, and what houses to the right add."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import described
import pytest
from described import ROBO_ARM, TWO_WHEELER

from brickhub import target
from brickhub.errors import DescriptionError, TwinError, UnknownNameError
from brickhub.hub.interface import Distance, MotorAngle, Pitch, Roll, RunAngle, Wait, YawRate
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.program.generate import validate
from brickhub.robot import (
    BENCH,
    HubKind,
    Motor,
    PoweredUpSensor,
    Robot,
    SensorKind,
    UltrasonicSensor,
)
from brickhub.target import Target, find_in_files, whole_interface
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.virtual_transport import VirtualHub

finder = target._finder  # that of the installed houses; the tests' own knows this one only


def test_robot_in_a_users_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(
        "from brickhub.robot import HubKind, Motor, Robot\n"
        "MINE = Robot('mine', HubKind.CITY, (Motor('arm', 'A'),))\n"
    )
    for name in (str(path), f"{path}:MINE"):
        found = find_in_files(name)
        robot = Robot("mine", HubKind.CITY, (Motor("arm", "A"),))
        assert (found.name, found.robot, found.interface, found.scene) == (
            "mine",
            robot,
            whole_interface(robot),
            None,
        )
        body = found.make_body()
        assert type(body) is BenchBody and body.robot == robot and body is not found.make_body()


def test_bench_is_a_robot_by_name() -> None:
    found = find_in_files("bench")
    assert found.robot is BENCH and type(found.make_body()) is BenchBody


@pytest.mark.parametrize(
    ("name", "error", "says"),
    [
        (
            "walker",
            UnknownNameError,
            "no robot 'walker'; name a Python file with one, such as my_robot.py, or bench",
        ),
        ("RunAway-v0", UnknownNameError, "no robot 'RunAway-v0'"),
        ("my_robot.ldr", UnknownNameError, "no robot 'my_robot.ldr'"),
        (
            "nowhere.py",
            UnknownNameError,
            "no file nowhere.py in .*; give the path of a Python file, or go to the right folder",
        ),
        (
            described.__file__,
            UnknownNameError,
            "has 3 robots .TWO_WHEELER, WALKER, ROBO_ARM.; name one: .*:ROBOT$",
        ),
        (
            f"{described.__file__}:SPINNING",
            DescriptionError,
            "is not a robot; name a Robot that is written there",
        ),
    ],
)
def test_unknown_or_wrong_robot_raises(name: str, error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says) as caught:
        find_in_files(name)
    assert "\n" not in str(caught.value)


def test_sensor_without_reading_has_no_bench(tmp_path: Path) -> None:
    path = tmp_path / "seeing.py"
    path.write_text(
        "from brickhub.robot import HubKind, PoweredUpSensor, Robot, SensorKind\n"
        "SEEING = Robot('seeing', HubKind.CITY, sensors=(PoweredUpSensor('light', 'A', "
        "SensorKind.COLOR),))\n"
    )
    with pytest.raises(TwinError, match="sensor 'light' of robot 'seeing' has no reading"):
        find_in_files(str(path)).make_body()


def test_interface_has_every_motor_and_sensor() -> None:
    whole = whole_interface(TWO_WHEELER)
    assert whole.commands == (RunAngle("left", -600, 600, 1000), RunAngle("right", -600, 600, 1000))
    assert whole.channels == (
        MotorAngle("left"),
        MotorAngle("right"),
        Pitch(),
        Roll(),
        YawRate(),
        Distance("eyes"),
    )
    assert whole.settle == Wait(50)
    arm = whole_interface(ROBO_ARM)
    assert arm.channels == (
        MotorAngle("rotation"),
        MotorAngle("low", 10, 70),
        MotorAngle("high", -150, 10),
        MotorAngle("grab", -148, -45),
    )
    sensors = (
        UltrasonicSensor("one", "A"),
        UltrasonicSensor("two", "B"),
        PoweredUpSensor("light", "C", SensorKind.COLOR),
    )
    assert whole_interface(Robot("r", HubKind.PRIME, sensors=sensors)).channels == (
        Distance("one"),
    )


@pytest.mark.parametrize(
    "robot",
    [described.TWO_WHEELER, described.WALKER, ROBO_ARM, BENCH],
    ids=lambda robot: robot.name,
)
def test_interface_runs_on_a_hub(robot: Robot) -> None:
    whole = whole_interface(robot)
    validate(robot, whole)
    with HubLink(VirtualHub(BenchBody(robot)), robot, whole) as link:
        before = link.read().values
        after = link.act([command.high / 10 for command in whole.commands]).values
    assert len(before) == len(whole.channels)
    assert (
        len(
            {*range(len(robot.motors))}
            - {i for i in range(len(robot.motors)) if before[i] != after[i]}
        )
        == 0
    ), "each turns"


def entry_point(house: str) -> SimpleNamespace:
    def find(name: str) -> Target:
        return Target(f"{name} of {house}", BENCH, whole_interface(BENCH), lambda: BenchBody(BENCH))

    return SimpleNamespace(name=house, load=lambda: find)


@pytest.mark.parametrize(
    ("installed", "found"),
    [
        ((), "bench"),
        (("bricktwin",), "bench of bricktwin"),
        (("bricksrl", "bricktwin"), "bench of bricksrl"),
        (("stranger",), "bench"),
    ],
)
def test_last_house_finds_the_robot(
    monkeypatch: pytest.MonkeyPatch, installed: tuple[str, ...], found: str
) -> None:
    monkeypatch.setattr(
        target.metadata, "entry_points", lambda group: [entry_point(house) for house in installed]
    )
    monkeypatch.setattr(target, "_finder", finder.__wrapped__)
    assert target.find("bench").name == found
