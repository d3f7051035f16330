"""``Motor.log`` and controller logs."""

from __future__ import annotations

import pytest
from hub_programs import output

from brickhub.robot import BENCH, MotorKind
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.firmware.motor_model import MOTOR_TYPES

IMPORTS = """
from pybricks.parameters import Direction, Port, Stop
from pybricks.pupdevices import Motor
from pybricks.robotics import DriveBase
from pybricks.tools import wait
"""
MOTOR = IMPORTS + "motor = Motor(Port.A)\n"
MODEL = MOTOR_TYPES[MotorKind.SPIKE_MEDIUM].model


def files(text: str) -> dict[str, list[list[int]]]:
    """Files that pybricksdev would save: rows by name."""
    found: dict[str, list[list[int]]] = {}
    name = ""
    for line in text.split("\n"):
        if line.startswith("PB_OF:"):
            name = line.removeprefix("PB_OF:")
            found[name] = []
        elif line == "PB_EOF":
            name = ""
        elif name:
            found[name].append([int(number) for number in line.split(", ")])
    return found


def test_log_of_motor_and_controller() -> None:
    logged = files(
        output(
            MOTOR
            + (
                "motor.log.start(400)\nmotor.control.log.start(400)\nmotor.run_target(500, 90)\n"
                "motor.stop()\nwait(20)\n"
            )
            + "motor.log.save('build/servo.txt')\nmotor.control.log.save()"
        )
    )
    servo, control = logged["build/servo.txt"], logged["log.txt"]
    assert {len(row) for row in servo} == {11} and {len(row) for row in control} == {13}
    assert [row[0] for row in servo] == [5 * n - 1 for n in range(1, len(servo) + 1)]
    assert len(servo) == 80 and servo[-1][2] in (89, 90)
    for (
        time_ms,
        ticks,
        angle,
        speed,
        actuation,
        voltage,
        *_,
        feedback,
        feedforward,
        _,
    ), row in zip(servo, control, strict=False):
        assert (time_ms, angle, speed, feedback) == (row[0], row[2], row[3], row[5])
        assert ticks == 10 * (time_ms + 1) and actuation == 2
        assert voltage == MODEL.voltage_mv(feedback + feedforward)
        assert row[5] == sum(row[10:13]) and row[4] & 3 == 3 and row[1] == 10 * time_ms
    references = [row[6] for row in control]
    assert references == sorted(references) and max(row[7] for row in control) == pytest.approx(
        415, abs=10
    )


def test_log_of_passive_motor() -> None:
    logged = files(
        output(
            MOTOR
            + (
                "motor.log.start(50)\nmotor.control.log.start(50)\nwait(20)\nmotor.dc(50)\n"
                "wait(100)\n"
            )
            + "motor.log.save('a')\nmotor.control.log.save('b')"
        )
    )
    assert [row[4] for row in logged["a"]] == [0] * 4 + [2] * 6
    assert [row[5] for row in logged["a"]][3:5] == [0, 3600]
    assert logged["b"] == []


@pytest.mark.parametrize(
    ("down_sample", "times"), [(1, [4, 9, 14, 19]), (2, [9, 19]), (3, [14]), (0, [4, 9, 14, 19])]
)
def test_log_is_downsampled_and_bounded(down_sample: int, times: list[int]) -> None:
    program = MOTOR + f"motor.log.start(20, {down_sample})\nwait(200)\nmotor.log.save('a')"
    assert [row[0] for row in files(output(program))["a"]] == times


def test_log_stops_and_restarts() -> None:
    program = "motor.log.start(100)\nwait(10)\nmotor.log.stop()\nwait(50)\nmotor.log.save('a')\n"
    program += "motor.log.start(duration=100, down_sample=2)\nwait(20)\nmotor.log.save(path='b')"
    logged = files(output(MOTOR + program))
    assert [row[0] for row in logged["a"]] == [4, 9] and [row[0] for row in logged["b"]] == [9, 19]


def test_log_of_stall() -> None:
    """Friction blocks a motor with a low torque limit."""
    body = BenchBody(BENCH)
    body.motor_friction_scale = 1.5
    program = MOTOR + "motor.control.limits(torque=1)\nmotor.control.log.start(2000)\n"
    rows = files(
        output(program + "motor.run(100)\nwait(1000)\nmotor.control.log.save('a')", body=body)
    )["a"]
    assert rows[-1][4] == 3 | 1 << 2 | 1 << 3 | 1 << 4, (
        "a torque, stalled, complete (it runs for ever), at its limit"
    )


def test_log_of_drive_base() -> None:
    program = (
        IMPORTS
        + "base = DriveBase(Motor(Port.A, Direction.COUNTERCLOCKWISE), Motor(Port.B), 56, 130)\n"
    )
    program += (
        "base.distance_control.log.start(2000)\nbase.heading_control.log.start(2000)\n"
        "base.straight(100)\nbase.turn(90)\n"
    )
    program += (
        "base.distance_control.log.save('distance')\n"
        "base.heading_control.log.save('heading')\nprint(base.state()[0])"
    )
    logged = files(output(program))
    distance, heading = logged["distance"], logged["heading"]
    assert distance[-1][2] == pytest.approx(100, abs=2) and max(
        row[3] for row in distance
    ) == pytest.approx(195, abs=15)
    assert heading[-1][2] == pytest.approx(90, abs=2) and heading[0][2] == 0
    assert all(abs(row[2] - row[8]) <= 3 for row in distance + heading), (
        "the observer is near what is measured"
    )


@pytest.mark.parametrize(
    "call", ["motor.log.start(-1)", "motor.log.save(3)", "motor.log.start()", "motor.log.get()"]
)
def test_invalid_arguments_raise(call: str) -> None:
    program = (
        f"try:\n    {call}\nexcept (MemoryError, TypeError, AttributeError):\n    print('refused')"
    )
    assert output(MOTOR + program).split("\n")[-1] == "refused"


def test_a_log_of_no_time_is_empty() -> None:
    program = MOTOR + "motor.log.start(0)\nmotor.run_angle(400, 90)\nmotor.log.save('a')\n"
    assert files(output(program)) == {"a": []}


def test_logging_does_not_change_motion() -> None:
    move = "motor.run_angle(400, 200)\nprint(motor.angle(), motor.speed(), motor.load())\n"
    move += "motor.run_time(300, 200)\nprint(motor.angle())"
    assert output(MOTOR + "motor.log.start(900)\nmotor.control.log.start(900)\n" + move) == output(
        MOTOR + move
    )
