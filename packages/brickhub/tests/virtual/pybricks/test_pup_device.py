"""``PUPDevice`` as ``pb_type_iodevices_pupdevice.c`` and ``port_lump.c`` (v4.0.1) treat it."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from brickhub.virtual.given_readings import parse_reading
from brickhub.virtual.pybricks.device_modes import MODES
from brickhub.virtual.run import Operation, run_file

HEAD = """
from pybricks.hubs import PrimeHub
from pybricks.iodevices import PUPDevice
from pybricks.parameters import Color, Port
from pybricks.pupdevices import *
from pybricks.tools import StopWatch, multitask, run_task, wait
hub = PrimeHub()
watch = StopWatch()
def tried(call, *args):
    watch.reset()
    try:
        return call(*args)
    except OSError as e:
        return e.errno
    except Exception as e:
        return e
"""


def told(device: str, source: str, folder: Path, *readings: str) -> str:
    """Output of a program with a device on port B, ``it``, and the same as ``raw``."""
    path = folder / "main.py"
    path.write_text(HEAD + f"it = {device}(Port.B)\nraw = PUPDevice(Port.B)\n" + source)
    out, err = io.BytesIO(), io.StringIO()
    operation = Operation([], [parse_reading(reading) for reading in readings], {})
    assert run_file(path, stdout=out, stderr=err, time_limit_s=60, operation=operation) == 0, (
        err.getvalue()
    )
    return out.getvalue().decode().replace("\r\n", "\n").removesuffix("\n")


def test_info_names_the_modes(tmp_path: Path) -> None:
    printed = told(
        "ForceSensor",
        "info = raw.info()\nprint(info['id'], len(info['modes']), info['modes'][4])",
        tmp_path,
    )
    assert printed == "63 7 ('FRAW', 1, 1)"
    assert told("Motor", "print(raw.info()['modes'])", tmp_path) == (
        "(('POWER', 1, 0), ('SPEED', 1, 0), ('POS', 1, 2), ('APOS', 1, 1), ('CALIB', 2, 1), "
        "('STATS', 14, 1))"
    )


@pytest.mark.parametrize(("device", "number"), [("Light", 8), ("DCMotor", 1)])
def test_passive_device_has_only_a_number(device: str, number: int, tmp_path: Path) -> None:
    source = "print(raw.info(), tried(raw.read, 0), tried(raw.write, 0, (1,)), tried(raw.reset))"
    assert told(device, source, tmp_path) == f"{{'id': {number}}} 1 1 1"


@pytest.mark.parametrize("number", MODES)
def test_values_fit_the_data_types(number: int) -> None:
    names = [mode.name for mode in MODES[number].modes]
    assert len(set(names)) == len(names) <= 16
    # the longest message
    assert all(mode.count * mode.data_type.bits // 8 <= 32 for mode in MODES[number].modes)


@pytest.mark.parametrize(
    ("device", "reading", "mode", "values"),
    [
        ("ColorSensor", "B=red", 0, (9,)),
        ("ColorSensor", "B=none", 0, (-1,)),
        ("ColorSensor", "B=40%", 1, (40,)),
        ("ColorSensor", "B.ambient=30%", 2, (30,)),
        ("ColorSensor", "B=white", 5, (1024, 1024, 1024, 0)),
        ("ColorSensor", "B=120,80,50", 6, (120, 800, 500)),
        ("ColorDistanceSensor", "B=blue", 0, (3,)),
        ("ColorDistanceSensor", "B.distance=40%", 1, (4,)),
        ("ColorDistanceSensor", "B=red", 6, (440, 0, 0)),
        ("ColorDistanceSensor", "B=red", 10, (0,) * 8),
        ("UltrasonicSensor", "B=250mm", 0, (250,)),
        ("UltrasonicSensor", "B=2000mm", 0, (-1,)),
        ("UltrasonicSensor", "B=250mm", 1, (250,)),
        ("UltrasonicSensor", "B=330mm", 1, (-1,)),
        ("UltrasonicSensor", "B=343mm", 4, (2000,)),
        ("ForceSensor", "B=2.5N", 0, (25,)),
        ("ForceSensor", "B=pressed", 1, (1,)),
        ("TiltSensor", "B=10,-5deg", 0, (-5, 10)),
        ("InfraredSensor", "B=50%", 0, (5,)),
        ("InfraredSensor", "B.count=3", 1, (3,)),
        ("InfraredSensor", "B=50%", 2, (12, 0, 0)),
    ],
)
def test_reads_what_the_sensor_senses(
    device: str, reading: str, mode: int, values: tuple[int, ...], tmp_path: Path
) -> None:
    assert told(device, f"print(raw.read({mode}))", tmp_path, reading) == str(values)


def test_firmware_computes_its_values_from_the_raw_ones(tmp_path: Path) -> None:
    """In the arithmetic of ``pb_type_pupdevices_*.c``, up to the rounding of the raw values."""
    spike = (
        "r, g, b, _ = raw.read(5)\nv = max(r, g, b) * 100 // 1024\n"
        "print(abs(it.hsv().v - v * (150 - v // 2) // 100) <= 1)"
    )
    assert told("ColorSensor", spike, tmp_path, "B=200,70,60") == "True"
    boost = "v = max(raw.read(6)) * 100 // 440\nprint(abs(it.hsv().v - v * (200 - v) // 100) <= 1)"
    assert told("ColorDistanceSensor", boost, tmp_path, "B=200,70,75") == "True"
    force = (
        "c = raw.read(6)\nprint(it.force(), 10 * (raw.read(4)[0] - c[2] - c[1]) / (c[6] - c[2]))"
    )
    assert told("ForceSensor", force, tmp_path, "B=4N") == "4.0 3.9747632"


@pytest.mark.parametrize(
    ("call", "answer"),
    [
        ("raw.read, 10", "Invalid argument"), ("raw.read, -1", "Invalid argument"),
        ("raw.read, 257", "(0,)"),
        ("raw.read, 1.0", "can't convert float to int"), ("raw.write, 10, (1,)", "Invalid mode"),
        ("raw.write, 5, (1, 2, 3, 4)", "Mode not writable"),
        ("raw.write, 3, (1, 2)", "Expected 3 values"),
        ("raw.write, 3, ()", "Expected 3 values"), ("raw.write, 3, 100",
         "object 'int' isn't a tuple or list"),
        ("raw.write, 3, (1, 2, 128)", "Value out of range for int8"),
        ("raw.write, 3, (1, 2, 0.5)", "can't convert float to int"),
        ("raw.write, 3, [100, 0, -128]", "None"),
    ],
)  # fmt: skip
def test_firmware_errors(call: str, answer: str, tmp_path: Path) -> None:
    assert told("ColorSensor", f"print(tried({call}))", tmp_path) == answer


def test_changing_the_mode_takes_as_long_as_with_the_sensors_own_class(tmp_path: Path) -> None:
    source = """
def timed(call, *args):
    watch.reset()
    call(*args)
    return watch.time()
print(timed(raw.read, 5), timed(raw.read, 1), timed(raw.read, 1), timed(it.color), timed(raw.write, 3, (1, 2, 3)))
"""  # noqa: E501
    assert told("ColorSensor", source, tmp_path) == "0 31 0 31 11"
    assert (
        told("ColorDistanceSensor", "print(tried(raw.write, 7, (5,)), watch.time())", tmp_path)
        == "None 252"
    )


def test_awaited_in_tasks(tmp_path: Path) -> None:
    source = """
async def main():
    print(await raw.write(5, (10, 20, 30, 40)), await raw.read(0))
    print(await multitask(raw.read(4), wait(100)))
run_task(main())
"""
    assert told("UltrasonicSensor", source, tmp_path, "B=343mm") == "None (343,)\n((2000,), None)"


def test_motor_in_another_mode_is_lost_to_its_class(tmp_path: Path) -> None:
    """``pbio_servo_update_all`` gives it up, and ``pbio_port_lump_assert_type_id`` finds none until
    its mode is back."""
    source = """
it.run_angle(500, 450)
print(raw.read(4), it.angle())
print(raw.read(2), raw.read(3), tried(it.angle), tried(Motor, Port.B))
print(raw.write(0, (50,)), raw.reset(), Motor(Port.B).angle())
"""
    assert told("Motor", source, tmp_path) == "(0, 892) 449\n(449,) (89,) 19 19\nNone None 89"


def test_speed_of_a_turning_motor(tmp_path: Path) -> None:
    source = "it.run(500)\nwait(500)\nprint(raw.read(1))\nwait(10)\nprint(0 < raw.read(1)[0] < 60)"
    assert told("Motor", source, tmp_path) == "(0,)\nTrue"
