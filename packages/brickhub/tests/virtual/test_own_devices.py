"""Devices of one's own: Python functions answer what a program asks."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pytest
from described import TWO_WHEELER

from brickhub.cli import main
from brickhub.errors import DescriptionError, TwinError
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.body import Body
from brickhub.virtual.own_devices import AnyOwnDevice, OwnDevice, OwnMode, OwnUart
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


def run(
    tmp_path: Path, source: str, devices: dict[str, AnyOwnDevice], body: Body | None = None
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


@pytest.mark.parametrize(
    ("function", "says"),
    [
        (lambda _: [300], r"mode M returned (300,); return 1 whole numbers of 8 bits"),
        (lambda _: [1, 2], r"mode M returned (1, 2)"),
        (lambda _: [0.5], r"mode M returned (0.5,)"),
        (lambda _: 1 / 0, "the function of mode M failed (ZeroDivisionError: division by zero)"),
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
    ],
)
def test_invalid_descriptions_are_refused(make: object, says: str) -> None:
    with pytest.raises(DescriptionError, match=says):
        make()  # type: ignore[operator]


def test_ports_are_checked(tmp_path: Path) -> None:
    with pytest.raises(TwinError, match="the prime hub has no port Z"):
        run(tmp_path, "", {"Z": gauge()})
    with pytest.raises(TwinError, match="port E of 'two-wheeler' has another device"):
        run(tmp_path, "", {"E": gauge()}, BenchBody(TWO_WHEELER))


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
    for words, says in (
        ("A=mine.py:NONE", "mine.py:NONE is no OwnDevice or OwnUart"),
        ("A=no.py", "there is no file no.py"),
        ("=mine.py", "names no port"),
    ):
        assert main(("run", "main.py", "--port", words)) == 2
        assert says in capfd.readouterr().err
