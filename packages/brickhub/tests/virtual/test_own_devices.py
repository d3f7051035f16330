"""Devices of one's own: Python functions answer what a program asks."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from described import TWO_WHEELER

from brickhub.cli import main
from brickhub.errors import DescriptionError, TwinError
from brickhub.robot import HubKind
from brickhub.virtual.bench_body import BenchBody, FittedBench
from brickhub.virtual.body import Body
from brickhub.virtual.own_devices import (
    AnyOwnDevice,
    OwnDevice,
    OwnDeviceOf,
    OwnI2c,
    OwnMode,
    OwnUart,
    TrueRobot,
)
from brickhub.virtual.run import Operation, run_file

GAUGE = """
from pybricks.iodevices import PUPDevice
from pybricks.parameters import Port
from pybricks.tools import wait
gauge = PUPDevice(Port.{port})
print(gauge.info())
wait(2000)
print(gauge.read(0)[0] // 10, gauge.read(1))
gauge.write(1, (7, -8))
print(gauge.read(1))
"""
UART = """
from pybricks.iodevices import UARTDevice
from pybricks.parameters import Port
from pybricks.tools import wait
uart = UARTDevice(Port.A, 9600, timeout=500)
uart.write(b"ping\\n")
print(uart.read(4), uart.waiting(), uart.read_all())
uart.write("x" * 5)
wait(100)
print(uart.waiting())
uart.clear()
print(uart.waiting())
uart.write("more")
uart.wait_until(b"!")
print(uart.read_all())
try:
    uart.read(1)
except OSError as e:
    print(e.errno)
"""

I2C = """
from pybricks.hubs import EV3Brick
from pybricks.iodevices import I2CDevice
from pybricks.parameters import Port
from pybricks.tools import StopWatch, run_task
brick = EV3Brick()
device = I2CDevice(Port.S2, 0x1E)
def error(function, *values):
    try:
        function(*values)
    except Exception as e:
        return e.errno if isinstance(e, OSError) else "refused"
device.write(0x20, b"\\x07\\x08")
print(device.read(0x20, 2), device.read(0x21), device.read(reg=0x20, length=0), device.read())
device.write(3)
device.write(None, bytearray(b"abc"))
print(error(device.read, 0x30, 1), error(device.read, 256), error(device.read, 0, 33), error(device.write, 0, 5))
print(error(I2CDevice(Port.S2, 0x1F).read, 0x20), error(I2CDevice, Port.S1, 0x1E))
watch = StopWatch()
device.read(0, 30)
print(watch.time())
async def read():
    print(await device.read(0x21, 1))
run_task(read())
"""  # noqa: E501


def run(
    tmp_path: Path,
    source: str,
    devices: Mapping[str, AnyOwnDevice | OwnDeviceOf],
    body: Body | None = None,
) -> tuple[int, str, str]:
    path, out, err = tmp_path / "main.py", io.BytesIO(), io.StringIO()
    path.write_text(source)
    operation = Operation(own_devices=devices)
    code = run_file(path, body, stdout=out, stderr=err, operation=operation)
    return code, out.getvalue().decode(), err.getvalue()


def gauge() -> OwnDevice:
    pair = [1, 2]

    def write(values: object, time_s: float) -> None:
        assert time_s > 2.0
        pair[:] = values  # type: ignore[call-overload]

    level = OwnMode("LEVEL", lambda time_s: [round(100 * time_s)])
    return OwnDevice(200, (level, OwnMode("PAIR", lambda _: pair, 2, 8, write)))


@pytest.mark.parametrize("body", [None, BenchBody(TWO_WHEELER)])
def test_powered_up_device_on_the_bench_and_of_a_robot(tmp_path: Path, body: Body | None) -> None:
    code, out, err = run(tmp_path, GAUGE.format(port="D"), {"D": gauge()}, body)
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        "{'id': 200, 'modes': (('LEVEL', 1, 2), ('PAIR', 2, 0))}",
        "20 (1, 2)",
        "(7, -8)",
    ]


def test_uart_answers(tmp_path: Path) -> None:
    heard = []

    def answer(written: bytes, time_s: float) -> bytes:
        if written:
            heard.append(written)
        return {b"ping\n": b"pong\n?", b"xxxxx": b"abc", b"more": b"end!rest"}.get(written, b"")

    code, out, err = run(tmp_path, UART, {"A": OwnUart(answer)})
    assert (code, err) == (0, "")
    assert out.splitlines() == ["b'pong' 2 b'\\n?'", "3", "0", "b'rest'", "110"]
    assert heard == [b"ping\n", b"xxxxx", b"more"]


def registers(written: list[object]) -> OwnI2c:
    """A device with registers; 0x30 fails."""
    memory = bytearray(256)

    def read(register: int | None, length: int, time_s: float) -> bytes:
        if register is None:
            return b"?" * length
        return bytes(memory[register : register + length])

    def write(register: int | None, data: bytes, time_s: float) -> None:
        written.append((register, data))
        if register is not None:
            memory[register : register + len(data)] = data

    return OwnI2c(0x1E, read, write)


def test_i2c_device_answers(tmp_path: Path) -> None:
    written: list[object] = []
    code, out, err = run(tmp_path, I2C, {"2": registers(written)})
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        r"b'\x07\x08' b'\x08' b'' b'?'",
        "None refused refused refused",
        "5 19",
        "30",
        r"b'\x08'",
    ]
    assert written == [(0x20, b"\x07\x08"), (3, b""), (None, b"abc")]


def test_i2c_device_without_functions_does_not_answer(tmp_path: Path) -> None:
    source = I2C.partition("device.write(0x20")[0]
    source += "print(error(device.read, 1), error(device.write, 1, b'x'))\n"
    assert run(tmp_path, source, {"2": OwnI2c(0x1E)})[1] == "5 5\n"


@pytest.mark.parametrize(
    ("device", "says"),
    [
        (OwnI2c(0x1E, lambda *_: b"12"), "I2C device at 30 returned b'12'; return 1 bytes"),
        (OwnI2c(0x1E, lambda *_: 5), "I2C device at 30 returned 5; return 1 bytes"),  # type: ignore[arg-type,return-value]
        (OwnI2c(0x1E, lambda *_: b"1"[7]), "I2C device at 30 failed (IndexError"),  # type: ignore[arg-type,return-value]
    ],
)
def test_answers_on_the_bus_that_do_not_fit_are_named(
    tmp_path: Path, device: OwnI2c, says: str
) -> None:
    source = I2C.partition("device.write(0x20")[0] + "device.read(1)\n"
    code, _, err = run(tmp_path, source, {"2": device})
    assert code == 1 and says in err


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (lambda *_: "text", "the function of the UART returned 'text'; return bytes"),
        (
            lambda *_: 1 / 0,
            "failed (ZeroDivisionError: division by zero, test_own_devices.py, line ",
        ),
    ],
)
def test_answers_of_a_uart_that_do_not_fit_are_named(
    tmp_path: Path, answer: Any, says: str
) -> None:
    code, _, err = run(tmp_path, UART, {"A": OwnUart(answer)})
    assert code == 1 and says in err


def test_function_that_is_written_to_and_fails_is_named(tmp_path: Path) -> None:
    mode = OwnMode("M", lambda _: [0], write=lambda values, _: values[3])  # type: ignore[arg-type,return-value]
    source = GAUGE.format(port="A").partition("print(")[0] + "gauge.write(0, [5])\n"
    code, _, err = run(tmp_path, source, {"A": OwnDevice(1, (mode,))})
    assert code == 1 and "the function of mode M failed (IndexError" in err


@pytest.mark.parametrize(
    ("function", "says"),
    [
        (lambda _: [300], r"mode M returned (300,); return 1 whole numbers of 8 bits"),
        (lambda _: [1, 2], r"mode M returned (1, 2)"),
        (lambda _: [0.5], r"mode M returned (0.5,)"),
        (lambda _: 1 / 0, "the function of mode M failed (ZeroDivisionError: division by zero, "),
        (lambda _: 5, "the function of mode M failed (TypeError"),
    ],
)
def test_values_that_do_not_fit_are_named(tmp_path: Path, function: Any, says: str) -> None:
    device = OwnDevice(1, (OwnMode("M", function, bits=8),))
    source = GAUGE.format(port="A").partition("wait(2000)")[0] + "gauge.read(0)\n"
    code, _, err = run(tmp_path, source, {"A": device})
    assert code == 1 and says in err


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: OwnMode("", lambda _: [0]), "give it 1 to 11 characters"),
        (lambda: OwnMode("M", lambda _: [0], bits=12), "give 8, 16 or 32"),
        (lambda: OwnMode("M", lambda _: [0], count=9), "no more than 32 bytes"),
        (lambda: OwnMode("M", lambda _: [0], count=0), "give at least one"),
        (lambda: OwnDevice(1, ()), "a device of 0 modes; give it 1 to 16"),
        (lambda: OwnDevice(256, gauge().modes), "the id 256; give a whole number from 0 to 255"),
        (lambda: OwnDevice("9", gauge().modes), "the id '9'; give"),  # type: ignore[arg-type]
        (lambda: OwnI2c(128), "at the I2C address 128; give 0 to 127, without the bit for"),
    ],
)
def test_invalid_descriptions_are_refused(make: object, says: str) -> None:
    with pytest.raises(DescriptionError, match=says):
        make()  # type: ignore[operator]


def test_ports_are_checked(tmp_path: Path) -> None:
    with pytest.raises(TwinError, match="the prime hub has no port Z"):
        run(tmp_path, "", {"Z": gauge()})
    with pytest.raises(TwinError, match="port E of 'two-wheeler' has a motor"):
        run(tmp_path, "", {"E": gauge()}, BenchBody(TWO_WHEELER))
    with pytest.raises(TwinError, match="an I2C device does not fit port A of the prime hub"):
        run(tmp_path, "", {"A": OwnI2c(3)})


def test_command(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(
        "from brickhub.virtual.own_devices import *\n"
        "GAUGE = OwnDevice(9, (OwnMode('LEVEL', lambda time_s: [5]),))\nNONE = 3\n"
    )
    (tmp_path / "main.py").write_text(
        "from pybricks.iodevices import PUPDevice\nfrom pybricks.parameters import Port\n"
        "print(PUPDevice(Port.A).read(0))\n"
    )
    for reference in ("mine.py:GAUGE", "mine.py"):
        assert main(("run", "main.py", "--port", f"A={reference}")) == 0
        assert capfd.readouterr().out == "(5,)\n"
    (tmp_path / "bus.py").write_text(
        "from brickhub.virtual.own_devices import *\nBUS = OwnI2c(3, lambda *_: b'7')\n"
    )
    (tmp_path / "brick.py").write_text(
        "from pybricks.hubs import EV3Brick\nfrom pybricks.iodevices import I2CDevice\n"
        "from pybricks.parameters import Port\nprint(I2CDevice(Port.S4, 3).read(9))\n"
    )
    assert main(("run", "brick.py", "--port", "S4=bus.py")) == 0
    assert capfd.readouterr().out == "b'7'\n"
    (tmp_path / "two.py").write_text(
        "from brickhub.virtual.own_devices import *\nONE = OwnI2c(3)\nTWO = OwnI2c(4)\n"
    )
    for words, says in (
        ("A=mine.py:NONE", "mine.py:NONE is no OwnDevice, OwnUart or OwnI2c"),
        ("A=no.py", "there is no file no.py"),
        ("A=mine.py:OTHER", "there is no 'OTHER' in mine.py; name a device that is written"),
        ("A=two.py", "two.py has 2 devices (ONE, TWO); name one: two.py:DEVICE"),
        ("=mine.py", "names no port"),
    ):
        assert main(("run", "main.py", "--port", words)) == 2
        assert says in capfd.readouterr().err


COMPASS = """
from pybricks.iodevices import PUPDevice
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import Motor
from pybricks.robotics import DriveBase
compass = PUPDevice(Port.F)
base = DriveBase(Motor(Port.E, Direction.COUNTERCLOCKWISE), Motor(Port.A), 56, 130)
base.turn(90)
print(compass.read(0))
base.straight(200)
print(compass.read(1))
"""


def compass(robot: TrueRobot) -> OwnDevice:
    north = OwnMode("NORTH", lambda _: [round(robot.heading_deg())])
    rest = (robot.x_mm, robot.y_mm, lambda: robot.angle_deg("A"))
    return OwnDevice(201, (north, OwnMode("REST", lambda _: [round(read()) for read in rest], 3)))


def test_a_device_measures_the_robot_on_a_bench(tmp_path: Path) -> None:
    code, out, err = run(tmp_path, COMPASS, {"F": compass})
    assert (code, err) == (0, "")
    north, rest = map(eval, out.splitlines())
    assert north == pytest.approx([90], abs=2)
    # A bench goes nowhere: wheels of 56 mm turn by 409 degrees, less the 209 of the turn.
    assert rest == pytest.approx([0, 0, 409 - 209], abs=3)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda robot: 3, "the function <lambda> returned 3; return an OwnDevice, OwnUart or"),
        (lambda robot: robot.x, "the function of <lambda> failed (AttributeError"),
        (lambda robot: robot.angle_deg("B"), "port B of 'bench' has no motor"),
    ],
)
def test_what_makes_no_device_is_refused(
    tmp_path: Path, make: Callable[[TrueRobot], AnyOwnDevice], says: str
) -> None:
    with pytest.raises(DescriptionError, match=re.escape(says)):
        run(tmp_path, "", {"A": make})


AGAIN = """
from pybricks.iodevices import UARTDevice
from pybricks.parameters import Port
from pybricks.tools import StopWatch, multitask, run_task, wait
uart = UARTDevice(Port.A, timeout=50)
watch = StopWatch()
for pattern in ("one", b"two", "three"):
    uart.wait_until(pattern)
    print(pattern, uart.waiting() > 0)
print(uart.read(4), uart.read(2), uart.read(0), uart.waiting())
uart.clear()
for _ in range(2):
    watch.reset()
    try:
        uart.read(1)
    except OSError as e:
        print(e.errno, watch.time())
    try:
        uart.write(b"x" * 1000)
    except OSError as e:
        print(e.errno, watch.time())
async def two():
    await multitask(uart.wait_until("never"), wait(10), race=True)
run_task(two())
try:
    uart.wait_until("one")
except OSError as e:
    print(e.errno)
"""


def test_a_uart_is_free_again_after_each_transfer(tmp_path: Path) -> None:
    sent = iter([b"one and two, then three: four5"])
    code, out, err = run(tmp_path, AGAIN, {"A": OwnUart(lambda _written, _time_s: next(sent, b""))})
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        "one True",
        "b'two' True",
        "three True",
        "b': fo' b'ur' b'' 1",
        # 1000 bytes take 86.8 ms of 115200 bits a second
        *["110 50", "110 100"] * 2,
        "16",
    ]


WRITES = """
from pybricks.iodevices import PUPDevice
from pybricks.parameters import Port
device = PUPDevice(Port.C)
for values in ((-128, 127), (-129, 0), (0, 128), (1,), (1, 2, 3), (1.0, 2)):
    try:
        device.write(1, values)
        print("written")
    except (TypeError, ValueError) as e:
        print(e)
for mode in (0, 2, 255, 257, -255):
    try:
        print(device.write(mode, (5, 6)))
    except ValueError as e:
        print(e)
for mode in (0, 256, 2):
    try:
        print(device.read(mode))
    except ValueError as e:
        print(e)
print(device.reset())
"""


def test_what_fits_a_mode_is_written(tmp_path: Path) -> None:
    written = []
    pair = OwnMode("PAIR", lambda _: (1, 2), 2, 8, lambda values, _: written.append(tuple(values)))
    device = OwnDevice(200, (OwnMode("LEVEL", lambda _: [7]), pair))
    code, out, err = run(tmp_path, WRITES, {"C": device})
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        "written",
        "Value out of range for int8",
        "Value out of range for int8",
        "Expected 2 values",
        "Expected 2 values",
        "can't convert float to int",
        "Mode not writable",
        "Invalid mode",
        "Invalid mode",
        "None",
        "None",
        "(7,)",
        "(7,)",
        "Invalid argument",
        "None",
    ]
    assert written == [(-128, 127), (5, 6), (5, 6)]


LIMITS_OF_I2C = """
from pybricks.iodevices import AnalogSensor, I2CDevice
from pybricks.parameters import Port
from pybricks.tools import StopWatch
device = I2CDevice(Port.S2, 0x1E)
watch = StopWatch()
def took(function, *values):
    watch.reset()
    try:
        function(*values)
        return watch.time()
    except Exception:
        return "refused"
print([took(device.read, None, length) for length in (0, 1, 32, 33, -1)])
print([took(device.read, register, 1) for register in (0, 255, 256, -1)])
print([took(device.write, 1, bytes(count)) for count in (0, 32, 33)])
open = AnalogSensor(Port.S1, custom=True)
print(open.voltage(), open.resistance(), open.active(), open.passive())
for arguments in ((Port.S1,), (Port.A, True)):
    try:
        AnalogSensor(*arguments)
    except OSError as e:
        print(e.errno)
"""


def test_a_transfer_on_the_bus_has_limits_and_takes_nine_bits_a_byte(tmp_path: Path) -> None:
    body = FittedBench(HubKind.EV3)
    code, out, err = run(tmp_path, LIMITS_OF_I2C, {"2": registers([])}, body)
    assert (code, err) == (0, "")
    # the address and a register come first; a millisecond is 9.6 bits
    assert out.splitlines() == [
        "[1, 2, 31, 'refused', 'refused']",
        "[3, 3, 'refused', 'refused']",
        "[2, 32, 'refused']",
        "4972 1073741823 None None",
        "19",
        "95",
    ]
