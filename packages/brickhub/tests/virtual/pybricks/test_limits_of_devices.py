"""Lengths, numbers and times that devices of a program just accept: messages, names, channels,
serial lines, forces and lights."""

from __future__ import annotations

from typing import Any

import pytest
from hub_programs import Console, output

from brickhub.robot import BENCH, HubKind, PoweredUpSensor, Robot, SensorKind
from brickhub.virtual.bench_body import BenchBody, FittedBench
from brickhub.virtual.interpreter import execute
from brickhub.virtual.machine import Machine
from brickhub.virtual.panel import Panel
from brickhub.virtual.pybricks import modules

HEAD = """
from pybricks.hubs import ThisHub
from pybricks.iodevices import *
from pybricks.parameters import *
from pybricks.pupdevices import *
from pybricks.tools import *
hub = ThisHub()
watch = StopWatch()
def error(call, *values, **named):
    try:
        return call(*values, **named)
    except OSError as raised:
        return raised.errno
    except Exception as raised:
        return repr(raised)
def took(call, *values, **named):
    watch.reset()
    answer = error(call, *values, **named)
    return answer, watch.time()
"""
WRONG = "ValueError('Invalid argument',)"


def shown(source: str, arrivals: dict[int, bytes] | None = None) -> list[str]:
    return output(HEAD + source, arrivals, body=FittedBench(HubKind.PRIME)).splitlines()


def with_remote(source: str, *held: str) -> tuple[list[str], Panel]:
    panel = Panel(BENCH.hub, near=["remote"])
    for button in held:
        panel.hold(f"remote.{button}")
    machine = Machine(BenchBody(BENCH), panel)
    console = Console(machine, {})
    execute(HEAD + source, "main.py", modules(machine, console), console)
    return console.written.decode().replace("\r\n", "\n").splitlines(), panel


# ---- wireless devices


@pytest.mark.parametrize(
    ("message", "answer"),
    [
        ("bytes([2, 0])", "ValueError('bad length',)"),
        ("bytes([3, 0, 1])", "19"),
        ("bytes([20] + [0] * 19)", "19"),
        ("bytes([21] + [0] * 20)", "ValueError('bad length',)"),
        ("bytes([4, 0, 1])", "ValueError('length in header wrong',)"),
        ("bytes([2, 0, 1])", "ValueError('length in header wrong',)"),
        ("5", "TypeError('object with buffer protocol required',)"),
    ],
)
def test_messages_of_legos_protocol(message: str, answer: str) -> None:
    source = f"far = LWP3Device(32, connect=False)\nprint(error(far.write, {message}))"
    assert shown(source) == [answer]


@pytest.mark.parametrize(
    ("name", "answer"),
    [
        ("'a'", "None"),
        ("'a' * 14", "None"),
        ("'a' * 15", "ValueError('bad name length',)"),
        ("''", "ValueError('bad name length',)"),
        ("'\\u00e9' * 7", "None"),
        ("'\\u00e9' * 8", "ValueError('bad name length',)"),
    ],
)
def test_names_have_14_bytes(name: str, answer: str) -> None:
    printed, panel = with_remote(f"remote = Remote()\nprint(error(remote.name, {name}))")
    assert printed == [answer]
    assert (panel.remote_name is not None) == (answer == "None")


def test_a_remote_is_found_in_half_a_second_and_has_its_name() -> None:
    source = """
remote = Remote(timeout=500)
print(watch.time(), remote.name(), remote.buttons.pressed(), error(remote.light.on, 5))
print(remote.light.on(Color.RED), remote.light.off())
remote.disconnect()
print(error(remote.name), error(remote.buttons.pressed), error(remote.light.off))
"""
    printed, _ = with_remote(source)
    assert printed == [
        '500 Handset set() TypeError("can\'t convert int to Color",)',
        "None None",
        "19 19 19",
    ]


@pytest.mark.parametrize(
    ("held", "button"),
    [
        ("left_plus", "LEFT_PLUS"),
        ("left_minus", "LEFT_MINUS"),
        ("left", "LEFT"),
        ("center", "CENTER"),
        ("right_plus", "RIGHT_PLUS"),
        ("right_minus", "RIGHT_MINUS"),
        ("right", "RIGHT"),
    ],
)
def test_buttons_of_a_remote(held: str, button: str) -> None:
    printed, _ = with_remote("print(Remote().buttons.pressed())", held)
    assert printed == [f"{{Button.{button}}}"]


def test_devices_that_are_never_near() -> None:
    source = """
for kind in (TechnicMoveHub, DuploTrain, MarioHub):
    device = kind(connect=False)
    for name in ("drive", "headlights", "sound", "speed", "color", "hsv", "name"):
        if hasattr(device, name):
            print(name, error(getattr(device, name)), end=" ")
    print(took(kind, timeout=70))
mario = MarioHub(connect=False)
print(mario.detectable_colors([Color.RED]), error(mario.detectable_colors, [Color.RED, 5]))
print(mario.detectable_colors(), error(LWP3Device, "a"), error(LWP3Device, 32, num_notifications=1.5))
"""  # noqa: E501
    assert shown(source) == [
        "drive 19 name 19 (110, 71)",
        "drive 19 headlights 19 sound 19 speed 19 color 19 name 19 (110, 71)",
        "color 19 hsv 19 name 19 (110, 71)",
        'None TypeError("can\'t convert int to Color",)',
        ('None TypeError("can\'t convert str to int",) TypeError("can\'t convert float to int",)'),
    ]


def test_a_scan_for_other_devices_finds_none() -> None:
    brick = """
from pybricks.messaging import bluetooth_scan
from pybricks.tools import StopWatch
watch = StopWatch()
print(bluetooth_scan(30), watch.time())
print(bluetooth_scan(num_results=1), watch.time())
for call in (lambda: bluetooth_scan("a"), lambda: bluetooth_scan(5, 1.5)):
    try:
        call()
    except TypeError as raised:
        print(raised)
"""
    assert output(brick, body=FittedBench(HubKind.EV3)).splitlines() == [
        "[] 30",
        "[] 10030",
        "can't convert str to int",
        "can't convert float to int",
    ]


@pytest.mark.parametrize(
    ("modes", "answer"),
    [
        ("[(255, 1)]", "None"),
        ("[(256, 1)]", "TypeError('modes must be a list of (mode, size) tuples',)"),
        ("[(1,)]", "TypeError('modes must be a list of (mode, size) tuples',)"),
        ("[(1, 2, 3)]", "TypeError('modes must be a list of (mode, size) tuples',)"),
        ("[(1, 2), (1, 3)]", "ValueError('mode numbers must be unique',)"),
        ("((1, 2),)", 'TypeError("can\'t convert tuple to list",)'),
        ("5", "TypeError(\"object 'int' isn't a tuple or list\",)"),
        ("[(1, 2.0)]", 'TypeError("can\'t convert float to int",)'),
    ],
)
def test_modes_of_app_data(modes: str, answer: str) -> None:
    printed, _ = with_host(f"print(error(lambda: AppData({modes}) and None))")
    assert printed == [answer]


class Host(Console):
    """A console with a host that takes the program's data, and at first sends some of its own."""

    def __init__(self, machine: Machine, first: bytes) -> None:
        super().__init__(machine, {})
        self.inbox = bytearray()
        self.first = first
        self.sent: list[bytes] = []

    def write_app_data(self, data: bytes) -> None:
        if not self.sent:
            self.inbox[: len(self.first)] = self.first
        self.sent.append(data)


def with_host(source: str, first: bytes = b"") -> tuple[list[str], list[bytes]]:
    """What a program prints, and what it sends to the host."""
    machine = Machine(BenchBody(BENCH))
    host = Host(machine, first)
    head = f"{HEAD}from pybricks.messaging import AppData\n"
    execute(head + source, "main.py", modules(machine, host), host)
    return host.written.decode().replace("\r\n", "\n").splitlines(), host.sent


def test_app_data_is_one_buffer_in_the_order_of_its_modes() -> None:
    source = """
app = AppData([(9, 2), (4, 3)])
print(app.get_bytes(4), app.get_bytes(9), app.get_bytes(9, 1))
for wrong in ((9, 2), (9, -1), (5,)):
    print(error(app.get_bytes, *wrong))
print(error(app.write_bytes, bytes(20)))
print(error(app.write_bytes, bytearray(1)))
print(error(app.configure, 1, 2, bytes(17)))
print(error(AppData, [(1, 2)]))
app.close()
print(error(lambda: AppData([(1, 2)]) and None))
"""
    printed, sent = with_host(source, b"abcde")
    assert printed == [
        "b'abc' b'de' 101",
        "ValueError('index out of range',)",
        "ValueError('index out of range',)",
        "ValueError('invalid mode',)",
        WRONG,
        "TypeError(\"can't convert 'bytearray' object to str implicitly\",)",
        WRONG,
        "RuntimeError('host rx_buffer already allocated',)",
        "None",
    ]
    assert sent == [bytes([0, 4, 9]), bytes([0, 1])], "it tells the host its modes"


def test_app_data_goes_to_the_host() -> None:
    source = """
app = AppData([(1, 4)])
app.write_bytes(bytes(range(19)))
app.write_bytes("ab")
app.configure(257, 3, b"xyz")
app.configure(1, 2, bytes(16))
"""
    _, (modes, *sent) = with_host(source)
    assert modes == bytes([0, 1])
    assert sent == [bytes(range(19)), b"ab", b"\1\1\3xyz", b"\1\1\2" + bytes(16)]


# ---- serial lines


@pytest.mark.parametrize(
    ("arguments", "answer"),
    [
        ("Port.A", "True"),
        ("Port.A, 1", "True"),
        ("Port.A, 0", WRONG),
        ("Port.A, 9600, 1", "True"),
        ("Port.A, 9600, 0", WRONG),
        ("Port.A, 9600, -5", WRONG),
        ("Port.A, 9600, None, 3", WRONG),
        ("Port.A, 9600, None, -1", WRONG),
        ("Port.A, 9600, None, 0", "True"),
        ("'A'", 'TypeError("can\'t convert str to Port",)'),
    ],
)
def test_settings_of_a_serial_line(arguments: str, answer: str) -> None:
    source = f"print(error(lambda: UARTDevice({arguments}) is not None))"
    assert shown(source) == [answer]


@pytest.mark.parametrize(
    ("key", "answer"), [(b"y", "True"), (b"Y", "True"), (b"n", "95"), (b"x", "95")]
)
@pytest.mark.parametrize("pin", [1, 2])
def test_power_on_a_pin_is_asked_for(key: bytes, answer: str, pin: int) -> None:
    source = f"print(error(lambda: UARTDevice(Port.A, power_pin={pin}) is not None))"
    *_, said, last = shown(source, {0: key})
    assert last == answer
    if answer == "True":
        assert said == f"{key.decode()}. Port power may be enabled."
    else:
        assert said == "Cancelled. Power not enabled."


@pytest.mark.parametrize(
    ("rate", "size", "time_ms"),
    [(9600, 1, 2), (9600, 24, 25), (9600, 96, 100), (115200, 100, 9), (1, 1, 10_000), (9600, 0, 0)],
)
def test_a_byte_takes_ten_bits(rate: int, size: int, time_ms: int) -> None:
    source = f"uart = UARTDevice(Port.A, {rate})\nprint(took(uart.write, bytes({size})))"
    assert shown(source) == [f"(None, {time_ms})"]


@pytest.mark.parametrize(
    ("call", "answer"),
    [
        ("uart.read, 1", "(110, 40)"),
        ("uart.read, 0", "(b'', 0)"),
        ("uart.write, bytes(100)", "(110, 40)"),
        ("uart.write, bytes(38)", "(None, 40)"),
        ("uart.write, 'abc'", "(None, 4)"),
        ("uart.write, bytearray(2)", "(None, 3)"),
        ("uart.write, [1]", f'("{WRONG}", 0)'),
        ("uart.wait_until, b''", f'("{WRONG}", 0)'),
        ("uart.set_baudrate, 0", f'("{WRONG}", 0)'),
        ("uart.set_baudrate, 300", "(None, 0)"),
        ("uart.waiting,", "(0, 0)"),
        ("uart.read_all,", "(b'', 0)"),
        ("uart.clear,", "(None, 0)"),
    ],
)
def test_a_line_without_a_device(call: str, answer: str) -> None:
    source = f"uart = UARTDevice(Port.A, 9600, timeout=40)\nprint(took({call}))"
    assert shown(source) == [answer]


# ---- sensors and lights


def told(kind: SensorKind, source: str, **sensed: Any) -> list[str]:
    """Output of a program with a sensor on port B, ``it``."""
    robot = Robot("one", HubKind.PRIME, sensors=(PoweredUpSensor("it", "B", kind),))
    readings = {
        ("it" if name == "it" else f"it.{name}"): (lambda angles, v=value: v)
        for name, value in sensed.items()
    }
    body = BenchBody(robot, readings)
    return output(f"{HEAD}it = {kind.value}(Port.B)\n{source}", robot=robot, body=body).splitlines()


@pytest.mark.parametrize(
    ("newtons", "touched", "distance"),
    [(0.0, False, "0.0"), (0.149, False, "0.099"), (0.15, False, "0.1"), (0.152, True, "0.101"),
     (10.0, True, "6.67"), (99.0, True, "6.67")],
)  # fmt: skip
def test_a_touch_is_a_tenth_of_a_millimetre(newtons: float, touched: bool, distance: str) -> None:
    source = "print(it.touched(), it.distance())"
    assert told(SensorKind.FORCE, source, it=newtons) == [f"{touched} {distance}"]


@pytest.mark.parametrize(
    ("newtons", "threshold", "pressed"),
    [
        (3.0, "", True),
        (2.999, "", False),
        (0.5, "0.5", True),
        (0.499, "0.5", False),
        (0.0, "0", True),
    ],
)
def test_a_button_is_pressed_by_the_force_that_is_asked_for(
    newtons: float, threshold: str, pressed: bool
) -> None:
    source = f"print(it.pressed({threshold}))"
    assert told(SensorKind.FORCE, source, it=newtons) == [str(pressed)]


@pytest.mark.parametrize(
    ("distance", "reflection", "shown_distance"),
    [(100, "0.2", 100), (50, "2.4", 50), (20, "9.0", 20), (10, "20.0", 10), (1, "100.0", 2)],
)
def test_reflection_of_an_infrared_sensor(
    distance: int, reflection: str, shown_distance: int
) -> None:
    source = "print(it.reflection(), it.distance(), it.count())"
    seen = told(SensorKind.INFRARED, source, it=distance, count=5)
    assert seen == [f"{reflection} {shown_distance} 0"]


@pytest.mark.parametrize(
    ("ambient", "seen"),
    [(0.0, "0.0"), (6.94, "0.69"), (6.96, "0.7"), (50.0, "5.0"), (100.0, "10.0")],
)
def test_ambient_light_in_tenths(ambient: float, seen: str) -> None:
    source = "print(it.ambient())"
    assert told(SensorKind.COLOR, source, it=0, ambient=ambient) == [seen]


@pytest.mark.parametrize(
    ("call", "brightness"),
    [
        ("on()", 100),
        ("on(50)", 50),
        ("on(-5)", 0),
        ("on(500)", 100),
        ("on([10, 70, 20])", 70),
        ("on((1, 2, 3.9))", 3),
        ("off()", 0),
    ],
)
def test_lights_of_a_color_sensor_show_the_brightest(call: str, brightness: int) -> None:
    robot = Robot("one", HubKind.PRIME, sensors=(PoweredUpSensor("it", "B", SensorKind.COLOR),))
    machine = Machine(BenchBody(robot, {"it": lambda angles: 0}))
    console = Console(machine, {})
    source = f"it = ColorSensor(Port.B)\nit.lights.on(33)\nwatch.reset()\nit.lights.{call}\n"
    source += "print(watch.time())"
    execute(HEAD + source, "main.py", modules(machine, console), console)
    assert machine.panel.lamps == {"B": brightness}
    assert console.written == b"11\r\n"


@pytest.mark.parametrize(("values", "count"), [("(1, 2)", 3), ("(1, 2, 3, 4)", 3), ("()", 3)])
def test_each_light_has_a_value(values: str, count: int) -> None:
    source = f"print(error(it.lights.on, {values}))"
    refused = f"ValueError('expected 1 number or tuple of {count} values',)"
    assert told(SensorKind.COLOR, source, it=0) == [refused]


@pytest.mark.parametrize(
    ("channel", "color", "answer"),
    [
        (1, "Color.RED", "None"),
        (4, "Color.BLUE", "None"),
        (0, "Color.RED", WRONG),
        (5, "Color.RED", WRONG),
        (1, "Color.GREEN", WRONG),
    ],
)
def test_channels_of_power_functions(channel: int, color: str, answer: str) -> None:
    source = f"print(error(lambda: PFMotor(it, {channel}, {color}) and None))"
    assert told(SensorKind.COLOR_DISTANCE, source, it=0) == [answer]


@pytest.mark.parametrize(
    ("colors", "answer"),
    [
        ("Color.RED", "None"),
        ("[Color.RED] * 9", "None"),
        ("[Color.RED] * 10", "None"),
        ("[Color.RED] * 8", 'TypeError("can\'t convert NoneType to Color",)'),
        ("[5] * 9", 'TypeError("can\'t convert int to Color",)'),
        ("5", "TypeError(\"'int' object isn't iterable\",)"),
    ],
)
def test_colors_of_nine_lights(colors: str, answer: str) -> None:
    source = f"it.off()\nprint(error(it.on, {colors}))\nprint(took(it.off))"
    assert told(SensorKind.COLOR_LIGHT_MATRIX, source) == [answer, "(None, 11)"]
