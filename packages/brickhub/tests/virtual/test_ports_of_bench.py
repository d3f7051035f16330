"""What is said to be on the ports of the bench; numbers as the firmware's code (v4.1.0b2) prints
them on a computer."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import pytest
from hub_programs import output

from brickhub import robot as robots
from brickhub.errors import DescriptionError, TwinError
from brickhub.robot import HubKind, MotorKind, Sense, SensorKind
from brickhub.virtual.bench_body import FittedBench, described_end_stops
from brickhub.virtual.firmware.motor_model import MOTOR_TYPES
from brickhub.virtual.firmware.servo import servo_settings
from brickhub.virtual.given_readings import parse_device, parse_reading
from brickhub.virtual.machine import Machine
from brickhub.virtual.run import Operation, run_file

HEAD = """
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import ColorSensor, ForceSensor, Motor
from pybricks.iodevices import PUPDevice
from pybricks.robotics import DriveBase
from pybricks.tools import StopWatch, wait
"""


def run(folder: Path, source: str, *ports: str, readings: tuple[str, ...] = ()) -> str:
    program, out, err = folder / "main.py", io.BytesIO(), io.StringIO()
    program.write_text(HEAD + source, encoding="utf-8")
    operation = Operation(
        readings=[parse_reading(text) for text in readings], devices=dict(map(parse_device, ports))
    )
    code = run_file(program, stdout=out, stderr=err, time_limit_s=20, operation=operation)
    return out.getvalue().decode() + (err.getvalue() if code else "")


def test_interactive_motor_is_rated_1200_degrees_a_second(tmp_path: Path) -> None:
    source = (
        "m = Motor(Port.C)\nprint(m.control.limits())\nm.run(1700)\nwait(1500)\n"
        "print(m.speed() > 900)"
    )
    assert run(tmp_path, source, "C=interactive") == "(1200, 2000, 135)\nTrue\n"


def test_drive_base_of_interactive_motors_has_their_settings(tmp_path: Path) -> None:
    source = """
base = DriveBase(Motor(Port.A, Direction.COUNTERCLOCKWISE), Motor(Port.B), 56, 110)
print(base.settings())
watch = StopWatch()
base.straight(500)
base.turn(180)
print(watch.time())
"""
    assert run(tmp_path, source, "A=interactive", "B=INTERACTIVE") == "(234, 733, 203, 763)\n3685\n"


@pytest.mark.parametrize(
    "kind", [kind for kind in MotorKind if HubKind.PRIME.model.takes(kind.model)]
)
def test_each_kind_of_motor_can_be_on_a_port(tmp_path: Path, kind: MotorKind) -> None:
    works = (
        "Motor(Port.D).control.limits()[0] > 0"
        if kind.model.has_encoder
        else "DCMotor(Port.D).dc(50) is None"
    )
    source = (
        f"from pybricks.pupdevices import DCMotor\nprint(PUPDevice(Port.D).info()['id'], {works})"
    )
    assert run(tmp_path, source, f"D={kind.value}") == f"{kind.model.device_id} True\n"


def test_another_device_than_the_program_asks_for_is_not_there(tmp_path: Path) -> None:
    source = """
for device, port in ((Motor, Port.A), (Motor, Port.B), (ForceSensor, Port.B), (ColorSensor, Port.C), (ColorSensor, Port.B)):
    try:
        print(device(port).color())
    except OSError as error:
        print(error.errno)
"""  # noqa: E501
    shown = run(
        tmp_path, source, "A=nothing", "B=colorsensor", "C=interactive", readings=("B=blue",)
    )
    assert shown == "19\n19\n19\n19\nColor.BLUE\n"


def test_motors_of_the_move_hub_are_its_own(tmp_path: Path) -> None:
    body = FittedBench(HubKind.MOVE)
    source = """
from pybricks.hubs import MoveHub
from pybricks.pupdevices import Motor
from pybricks.parameters import Port
for port in (Port.A, Port.B, Port.C):
    motor = Motor(port)
    motor.run_angle(1400, 360)
    print(motor.angle() // 10)
"""
    assert output(source, body=body) == "36\n36\n35"
    assert [body.motors[port].value for port in "ABC"] == ["move-hub", "move-hub", "spike-medium"]
    own, other = (servo_settings(MOTOR_TYPES[body.motors[port]], 1000, 0) for port in "AC")
    assert (own.limits()[0], other.limits()[0]) == (1500, 1000)
    with pytest.raises(TwinError, match="port B of the move hub has the hub's own motor"):
        run(tmp_path, "from pybricks.hubs import MoveHub", "B=interactive")


def test_devices_are_named_by_kind() -> None:
    assert parse_device(" b = forcesensor ") == ("B", SensorKind.FORCE)
    assert parse_device("A=nothing") == ("A", None)
    for text in ("A=dynamo", "G=interactive", "5=interactive", "interactive"):
        with pytest.raises(DescriptionError, match="A=interactive, of spike-small, .*, or nothing"):
            parse_device(text)


def test_the_port_and_the_reading_there_must_suit_the_hub(tmp_path: Path) -> None:
    with pytest.raises(TwinError, match="the city hub has no port D; it has A, B"):
        run(tmp_path, "from pybricks.hubs import CityHub", "D=interactive")
    with pytest.raises(TwinError, match="an ev3-large does not fit port A of the prime hub"):
        run(tmp_path, "from pybricks.hubs import PrimeHub", "A=ev3-large")
    with pytest.raises(TwinError, match="senses force"):
        run(tmp_path, "", "A=ForceSensor", readings=("A.ambient=20%",))


def test_a_reading_is_set_by_hand_while_a_program_runs(tmp_path: Path) -> None:
    """Before and after the program has plugged in the sensor; in place of what is given."""
    program = tmp_path / "main.py"
    program.write_text(
        HEAD + "sensor = ColorSensor(Port.B)\nprint(sensor.color())\n"
        "wait(100)\nprint(sensor.color())\n",
        encoding="utf-8",
    )
    out = io.BytesIO()

    def attend(machine: Machine) -> None:
        bench = machine.body
        assert isinstance(bench, FittedBench)
        bench.set_reading("B", Sense.SURFACE, (0, 100, 100))
        machine.alarm_ms = 50
        machine.on_alarm = lambda: bench.set_reading("B", Sense.SURFACE, (240, 100, 100))

    operation = Operation(readings=[parse_reading("B=green")], attend=attend)
    assert run_file(program, stdout=out, operation=operation) == 0
    assert out.getvalue() == b"Color.RED\nColor.BLUE\n"


@pytest.mark.parametrize("stops", [(-90.0, 0.0), (0.0, 90.0), (-1.0, 1.0)])
def test_motor_may_stand_at_an_end_stop(stops: tuple[float, float]) -> None:
    motor = robots.Motor("arm", "A", end_stops_deg=stops)
    robot = robots.Robot("arm", robots.HubKind.PRIME, (motor,))
    assert described_end_stops(robot) == {"arm": stops}
    beside = replace(motor, end_stops_deg=(stops[0] + 200.0, stops[1] + 200.0))
    with pytest.raises(TwinError, match="but starts at 0 on the bench"):
        described_end_stops(replace(robot, motors=(beside,)))
