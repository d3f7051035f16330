"""Motion logs."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from described import RUN_AWAY

from brickhub.errors import TwinError
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.program.generate import generate
from brickhub.target import whole_interface
from brickhub.virtual.virtual_transport import VirtualHub
from bricktwin.robots import ROBOTS, TWO_WHEELER
from bricktwin.twin.make_body import make_body
from bricktwin.twin.motion_log import RunLog, identification_commands, read_log, record, write_log
from bricktwin.twin.scene import Scene


@pytest.fixture(scope="module")
def log() -> RunLog:
    interface = whole_interface(TWO_WHEELER)
    commands = identification_commands(interface, 30, np.random.default_rng(0))
    with HubLink(VirtualHub(make_body(TWO_WHEELER)), TWO_WHEELER, interface) as link:
        return record(link, TWO_WHEELER, interface, commands)


def assert_equal(one: RunLog, other: RunLog) -> None:
    for field in dataclasses.fields(RunLog):
        assert np.array_equal(getattr(one, field.name), getattr(other, field.name)), field.name


def test_log_has_commands_answers_hub_time(log: RunLog) -> None:
    assert log.robot == "two-wheeler"
    assert log.program_hash == generate(TWO_WHEELER, log.interface).hash
    assert log.commands.shape == (30, 2)
    assert log.channels.shape == (31, 6)
    assert (np.diff(log.times_ms) >= 50).all()
    assert not log.commands[:16].any(), "the robot rests at first"
    assert log.commands[16:].any(axis=1).all()


@pytest.mark.parametrize(
    "robot",
    [robot for robot in ROBOTS.values() if robot.hub.model.runs_programs],
    ids=lambda robot: robot.name,
)
def test_every_robot_has_a_log_interface(robot) -> None:
    interface = whole_interface(robot)
    generate(robot, interface)
    commands = identification_commands(interface, 120, np.random.default_rng(1))
    high = np.array([command.high for command in interface.commands])
    assert (np.abs(commands) <= high).all()
    assert (np.abs(commands) == high).mean(axis=0).min() > 0.3, "much of it at full speed"
    assert not commands.sum(axis=0).any(), "there and back"


def test_motion_log_round_trip(log: RunLog, tmp_path: Path) -> None:
    write_log(tmp_path / "log.jsonl", log)
    assert_equal(
        read_log(tmp_path / "log.jsonl"), dataclasses.replace(log, gaps_ms=log.gaps_ms.round(3))
    )
    header = json.loads((tmp_path / "log.jsonl").read_text().splitlines()[0])
    assert (header["robot"], header["program"]) == ("two-wheeler", f"{log.program_hash:08x}")


def test_log_that_an_editor_saved_is_read(log: RunLog, tmp_path: Path) -> None:
    write_log(tmp_path / "log.jsonl", log)
    text = (tmp_path / "log.jsonl").read_text()
    (tmp_path / "saved.jsonl").write_bytes(f"{text}\n".replace("\n", "\r\n").encode("utf-8-sig"))
    assert_equal(read_log(tmp_path / "saved.jsonl"), read_log(tmp_path / "log.jsonl"))


def test_drive_base_tasks_can_be_logged(tmp_path: Path) -> None:
    scene = Scene(wall_distance_mm=(200.0, 300.0), heading_deg=(-5.0, 5.0))
    with HubLink(VirtualHub(make_body(TWO_WHEELER, scene=scene)), TWO_WHEELER, RUN_AWAY) as link:
        log = record(link, TWO_WHEELER, RUN_AWAY, [[-50.0], [30.0]])
    write_log(tmp_path / "log.jsonl", log)
    assert_equal(
        read_log(tmp_path / "log.jsonl"), dataclasses.replace(log, gaps_ms=log.gaps_ms.round(3))
    )
    assert log.channels[1, 4] > log.channels[0, 4]


@pytest.mark.parametrize(
    "harm",
    [
        lambda lines: [],
        lambda lines: lines[:1],
        lambda lines: ["{}", *lines[1:]],
        lambda lines: [lines[0].replace('"bricksrl_log": 1', '"bricksrl_log": 9'), *lines[1:]],
        lambda lines: [lines[0].replace("RunAngle", "Teleport"), *lines[1:]],
        lambda lines: [*lines[:-1], lines[-1][:20]],
        lambda lines: [*lines[:-1], lines[-1].replace('"channels": [', '"channels": [1.0, ')],
        lambda lines: [lines[0], *lines[:0:-1]],
        lambda lines: [*lines[:-1], json.dumps(json.loads(lines[-1]) | {"time_ms": np.inf})],
        lambda lines: [*lines[:-1], json.dumps(json.loads(lines[-1]) | {"command": [np.nan, 0.0]})],
        lambda lines: ["[" * 100_000, *lines[1:]],
    ],
)
def test_damaged_log_raises(log: RunLog, tmp_path: Path, harm) -> None:
    path = tmp_path / "log.jsonl"
    write_log(path, log)
    path.write_text("\n".join(harm(path.read_text().splitlines())))
    with pytest.raises(TwinError, match="cannot read the log") as caught:
        read_log(path)
    assert "\n" not in str(caught.value)
    with pytest.raises(TwinError, match="cannot read the log"):
        read_log(tmp_path / "nothing.jsonl")


def _header(**values: object) -> Callable[[list[str]], list[str]]:
    return lambda lines: [json.dumps(json.loads(lines[0]) | values), *lines[1:]]


def _line_5(**values: object) -> Callable[[list[str]], list[str]]:
    return lambda lines: [*lines[:4], json.dumps(json.loads(lines[4]) | values), *lines[5:]]


def _command(**values: object) -> Callable[[list[str]], list[str]]:
    return lambda lines: _header(
        commands=[part | values for part in json.loads(lines[0])["commands"]]
    )(lines)


@pytest.mark.parametrize(
    ("harm", "reason"),
    [
        (lambda lines: [], "it is another file, or damaged"),
        (lambda lines: [*lines[:4], "3", *lines[5:]], "it is another file, or damaged"),
        (lambda lines: [*lines[:4], "9" * 5000, *lines[5:]], "it is another file, or damaged"),
        (_header(bricksrl_log=9), "format 9 is unknown"),
        (_header(program="zz"), "it is another file, or damaged"),
        (_header(settle=None), "it is another file, or damaged"),
        (_command(kind="Teleport"), "there is no command or channel 'Teleport'"),
        (_command(kind=[]), "there is no command or channel ()"),
        (_command(kind="Command"), "there is no command or channel 'Command'"),
        (_command(speed_ms=3), "it is another file, or damaged"),
        (_command(speed_deg_s="fast"), "speed_deg_s is 'fast'; give a whole number"),
        (_command(motor=1), "motor is 1; give a text"),
        (_line_5(command=[1.0]), "it is another file, or damaged"),
        (_line_5(command=[[1.0], [2.0]]), "it is another file, or damaged"),
        (_line_5(command=[10**400, 0]), "it is another file, or damaged"),
        (_line_5(channels=None), "it is another file, or damaged"),
        (_line_5(gap_ms=None), "a number as gap_ms is missing"),
        (_line_5(time_ms="noon"), "its times are not whole numbers that increase"),
        (_line_5(time_ms=10**30), "its times are not whole numbers that increase"),
        (_line_5(time_ms=0), "its times are not whole numbers that increase"),
    ],
)
def test_error_says_what_is_wrong_with_a_log(
    log: RunLog, tmp_path: Path, harm, reason: str
) -> None:
    """In words of the log, not of Python."""
    path = tmp_path / "log.jsonl"
    write_log(path, log)
    path.write_text("\n".join(harm(path.read_text().splitlines())))
    with pytest.raises(TwinError) as caught:
        read_log(path)
    assert (
        str(caught.value)
        == f"cannot read the log {path} ({reason}); give a file that `bricktwin twin record` wrote"
    )


@pytest.mark.parametrize("content", [bytes(range(256)), '{"bricksrl_log": 1}\n{}'.encode("utf-16")])
def test_other_file_is_no_log(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "log.jsonl").write_bytes(content)
    with pytest.raises(TwinError, match="another file"):
        read_log(tmp_path / "log.jsonl")
