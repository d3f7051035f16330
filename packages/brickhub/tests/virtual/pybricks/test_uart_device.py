"""UART with nothing at its other end, as ``pb_type_uart_device.c`` and the hub's UART driver
(v4.0.1) treat it."""

from __future__ import annotations

import pytest
from hub_programs import output

HEAD = """
from pybricks.iodevices import UARTDevice
from pybricks.parameters import Port
from pybricks.tools import StopWatch, multitask, run_task, wait
watch = StopWatch()
def tried(call):
    watch.reset()
    try:
        return call(), watch.time()
    except OSError as e:
        return e.errno, watch.time()
"""


def test_nothing_arrives() -> None:
    source = (
        "uart = UARTDevice(Port.A, timeout=100)\n"
        "print(uart.waiting(), uart.read_all(), uart.clear(), uart.set_baudrate(9600))\n"
    )
    source += "print(uart.read(0), tried(uart.read), tried(lambda: uart.read(5)))"
    assert output(HEAD + source) == "0 b'' None None\nb'' (110, 100) (110, 100)"


def test_read_without_timeout_waits_for_ever() -> None:
    source = """
uart = UARTDevice(Port.A)
async def listen():
    await multitask(uart.read(), wait(5000), race=True)
    await multitask(uart.wait_until(b"ok"), wait(5000), race=True)
run_task(listen())
print(watch.time() // 1000, tried(uart.read), tried(lambda: uart.wait_until("ok")))
uart.clear()
async def listen_again():
    await multitask(uart.read(), wait(10), race=True)
run_task(listen_again())
"""
    # What was given up stays busy until it is cleared.
    assert output(HEAD + source) == "10 (16, 0) (16, 0)"


@pytest.mark.parametrize(
    ("made", "written", "took"),
    [("UARTDevice(Port.A)", 'b"x" * 115', "(None, 10)"),
        ("UARTDevice(Port.A, 9600)", '"x" * 48', "(None, 50)"),
     ("UARTDevice(Port.A, 2400, timeout=20)", "bytearray(24)", "(110, 20)"),
     ("UARTDevice(Port.A)", 'b""', "(None, 0)")],
)  # fmt: skip
def test_write_takes_ten_bits_a_byte(made: str, written: str, took: str) -> None:
    assert output(HEAD + f"uart = {made}\nprint(tried(lambda: uart.write({written})))") == took


@pytest.mark.parametrize(
    "call",
    [
        "UARTDevice(Port.A, timeout=0)",
        "UARTDevice(Port.A, 0)",
        "UARTDevice(Port.A, power_pin=3)",
        "UARTDevice(Port.A).write(3)",
        'UARTDevice(Port.A).wait_until("")',
    ],
)
def test_invalid_arguments(call: str) -> None:
    assert (
        output(f"{HEAD}try:\n    {call}\nexcept ValueError as e:\n    print(e)")
        == "Invalid argument"
    )


@pytest.mark.parametrize(
    ("answer", "then"),
    [(b"y", "y. Port power may be enabled.\nmade"), (b"n", "Cancelled. Power not enabled.\n95")],
)
def test_power_needs_permission(answer: bytes, then: str) -> None:
    source = (
        "try:\n    UARTDevice(Port.A, power_pin=1)\n    print('made')\n"
        "except OSError as e:\n    print(e.errno)"
    )
    warning = (
        "Custom electronics may damage your LEGO hub. Proceed at your own risk.\n"
        "Press Y to proceed. Press N to cancel.\n"
    )
    assert output(HEAD + source, {10: answer}) == warning + then
