"""What is said to be on the ports of the bench; numbers as the firmware's code (v4.1.0b2) prints
them on a computer."""

from __future__ import annotations

import io
import re
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
from brickhub.virtual.given_readings import parse_device, parse_end_stop, parse_reading
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


EV3 = """
from pybricks.ev3devices import ColorSensor, InfraredSensor, TouchSensor, UltrasonicSensor
from pybricks.parameters import Port
"""


@pytest.mark.parametrize(
    ("ports", "source", "printed"),
    [
        ("4=UltrasonicSensor", "print(UltrasonicSensor(Port.S4).distance())", "2550"),
        ("S3=ColorSensor", "print(ColorSensor(Port.S3).reflection())", "0"),
        ("1=touchsensor", "print(TouchSensor(Port.S1).pressed())", "False"),
        ("4=InfraredSensor", "print(InfraredSensor(Port.S4).distance())", "100"),
    ],
)
def test_a_class_is_that_of_the_hub(ports: str, source: str, printed: str, tmp_path: Path) -> None:
    """Sensors of SPIKE and of EV3 have classes of one name."""
    assert run(tmp_path, EV3 + source, ports) == f"{printed}\n"


@pytest.mark.parametrize("reading", ["A=pressed", "D=200mm"])
def test_a_reading_is_for_a_port_of_sensors(reading: str) -> None:
    with pytest.raises(TwinError, match="of the ev3 hub takes no sensor; name one of 1, 2, 3, 4"):
        FittedBench(HubKind.EV3, [parse_reading(reading)])
    with pytest.raises(TwinError, match="of the move hub takes no sensor; name one of C, D"):
        FittedBench(HubKind.MOVE, [parse_reading("A=red")])


def test_starts_and_stops_are_for_ports_of_motors() -> None:
    refusal = "port 4 of the ev3 hub takes no motor; name one of A, B, C, D"
    with pytest.raises(TwinError, match=refusal):
        FittedBench(HubKind.EV3, starts={"4": 20.0})
    with pytest.raises(TwinError, match=refusal):
        FittedBench(HubKind.EV3, end_stops=dict([parse_end_stop("S4=-10..20")]))


@pytest.mark.parametrize(
    ("reading", "source", "refusal"),
    [
        ("4=200mm", "InfraredSensor(Port.S4).distance()", "InfraredSensor on port S4 .* in %, not"),
        ("4=40%", "UltrasonicSensor(Port.S4)", "UltrasonicSensor on port S4 .* in mm, not in %"),
        ("1=50%", "TouchSensor(Port.S1)", "TouchSensor on port S1 has its force in N, not in %"),
        ("3=200mm", "ColorSensor(Port.S3)", "the ColorSensor on port S3 senses surface or ambient"),
    ],
)
def test_a_reading_in_another_unit_is_refused(
    reading: str, source: str, refusal: str, tmp_path: Path
) -> None:
    assert re.search(f"TwinError: .*{refusal}", run(tmp_path, EV3 + source, readings=(reading,)))


def test_a_line_of_a_file_in_another_unit_is_named(tmp_path: Path) -> None:
    (tmp_path / "near.csv").write_text("0, 300\n1, 20%\n", encoding="utf-8")
    given = parse_reading("4=@near.csv", tmp_path)
    with pytest.raises(TwinError, match=r"near\.csv.*line 2: .* its distance in mm, not in %"):
        given.sense_of("Ev3UltrasonicSensor")


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
