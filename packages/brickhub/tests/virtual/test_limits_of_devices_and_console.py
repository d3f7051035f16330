"""What is just accepted of a user's devices, readings and messages, and how fast output is sent."""

from __future__ import annotations

import io
from typing import Any

import pytest
from hub_programs import output

from brickhub.errors import DescriptionError, TwinError
from brickhub.robot import BENCH, Sense
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.given_readings import (
    GivenReading,
    by_port,
    parse_end_stop,
    parse_reading,
    parse_start,
    port_of,
)
from brickhub.virtual.machine import Machine
from brickhub.virtual.own_devices import OwnDevice, OwnI2c, OwnMode, OwnUart
from brickhub.virtual.run import StreamConsole
from brickhub.virtual.stimuli import (
    beacon,
    brightness_pct,
    color,
    number,
    pitch_and_roll,
    reflection_pct,
    rotation,
)


def nothing(_time_s: float) -> list[int]:
    return [0]


# ---- devices of the user's own


@pytest.mark.parametrize(
    ("options", "fits"),
    [
        ({"name": "M"}, True),
        ({"name": "M" * 11}, True),
        ({"name": "M" * 12}, False),
        ({"name": ""}, False),
        ({"bits": 8, "count": 32}, True),
        ({"bits": 8, "count": 33}, False),
        ({"bits": 16, "count": 16}, True),
        ({"bits": 16, "count": 17}, False),
        ({"bits": 32, "count": 8}, True),
        ({"bits": 32, "count": 9}, False),
        ({"count": 0}, False),
        ({"count": -1}, False),
        ({"bits": 24}, False),
    ],
)
def test_modes(options: dict[str, Any], fits: bool) -> None:
    """A message has 32 bytes."""
    arguments = {"name": "M", "read": nothing, **options}
    if fits:
        OwnMode(**arguments)
        return
    with pytest.raises(DescriptionError):
        OwnMode(**arguments)


@pytest.mark.parametrize(
    ("bits", "value", "fits"),
    [
        (8, 127, True),
        (8, 128, False),
        (8, -128, True),
        (8, -129, False),
        (16, 32_767, True),
        (16, 32_768, False),
        (16, -32_768, True),
        (32, 2**31 - 1, True),
        (32, 2**31, False),
        (32, -(2**31), True),
        (32, -(2**31) - 1, False),
        (32, True, False),
        (32, 1.0, False),
    ],
)
def test_values_of_modes_are_signed(bits: int, value: Any, fits: bool) -> None:
    mode = OwnMode("M", lambda _: [value], bits=bits)
    if fits:
        assert mode.values(0.0) == (value,)
        return
    with pytest.raises(DescriptionError, match=f"return 1 whole numbers of {bits} bits"):
        mode.values(0.0)


@pytest.mark.parametrize(
    ("number_of_modes", "device_id", "fits"),
    [(1, 0, True), (16, 255, True), (17, 5, False), (0, 5, False), (1, 256, False), (1, -1, False)],
)
def test_devices(number_of_modes: int, device_id: int, fits: bool) -> None:
    modes = tuple(OwnMode(f"M{index}", nothing) for index in range(number_of_modes))
    if fits:
        assert OwnDevice(device_id, modes).modes == modes
        return
    with pytest.raises(DescriptionError):
        OwnDevice(device_id, modes)


@pytest.mark.parametrize(("address", "fits"), [(0, True), (127, True), (128, False), (-1, False)])
def test_addresses_have_seven_bits(address: int, fits: bool) -> None:
    if fits:
        assert OwnI2c(address).bytes_of(1, 2, 0.0) is None
        assert not OwnI2c(address).take(1, b"", 0.0)
        return
    with pytest.raises(DescriptionError, match=f"a device at the I2C address {address}"):
        OwnI2c(address)


def test_functions_get_the_time_and_what_is_written() -> None:
    got: list[object] = []
    mode = OwnMode("M", lambda time_s: [round(time_s)], write=lambda *given: got.append(given))
    assert mode.values(2.4) == (2,)
    mode.take([5, 6], 3.5)
    bus = OwnI2c(
        3,
        lambda register, length, time_s: bytes([register or 0, length]),
        lambda *given: got.append(given),
    )
    assert bus.bytes_of(7, 2, 1.0) == b"\7\2"
    assert bus.take(9, b"ab", 4.5)
    uart = OwnUart(lambda written, time_s: bytearray(written * 2))
    assert uart.answered(b"x", 1.0) == b"xx"
    assert got == [([5, 6], 3.5), (9, b"ab", 4.5)]


# ---- readings


@pytest.mark.parametrize(
    ("text", "port", "sense", "value", "unit"),
    [
        ("B=red", "B", Sense.SURFACE, (0, 100, 100), ""),
        ("b=RED", "B", Sense.SURFACE, (0, 100, 100), ""),
        ("B=120,80,50", "B", None, (120.0, 80.0, 50.0), ""),
        ("B=40%", "B", None, 40.0, "%"),
        ("B = 200mm", "B", None, None, None),
        ("B=200 mm", "B", Sense.DISTANCE, 200.0, "mm"),
        ("B=3N", "B", Sense.FORCE, 3.0, "N"),
        ("B=pressed", "B", Sense.FORCE, 10.0, ""),
        ("B=released", "B", Sense.FORCE, 0.0, ""),
        ("B=10,-5deg", "B", Sense.TILT, (10.0, -5.0), "deg"),
        ("B=10deg", "B", Sense.TILT, 10.0, "deg"),
        ("B.ambient=20%", "B", Sense.AMBIENT, 20.0, "%"),
        ("S2=5", "2", None, 5.0, ""),
        ("f=-2.5", "F", None, -2.5, ""),
        ("B=+3", "B", None, 3.0, ""),
        ("B=1,2", "B", None, (1.0, 2.0), ""),
        ("B=1,2,3,4", "B", None, None, None),
        ("B=1,2mm", "B", None, None, None),
        ("B=1,2,3deg", "B", None, None, None),
        ("B=1,2%", "B", None, None, None),
        ("B=1..2", "B", None, None, None),
        ("B=", "B", None, None, None),
        ("G=5", "B", None, None, None),
        ("B=1e999", "B", None, None, None),
        ("B=5cm", "B", None, None, None),
        ("B.x=5", "B", None, None, None),
    ],
)
def test_texts_of_readings(
    text: str, port: str, sense: Sense | None, value: Any, unit: str | None
) -> None:
    if unit is None:
        with pytest.raises(TwinError):
            parse_reading(text)
        return
    assert parse_reading(text) == GivenReading(port, sense, (0.0,), (value,), (unit,))


@pytest.mark.parametrize("text", ["B=35.5 cm", "B=3 inch", "B=1,2 rad"])
def test_other_units_are_told(text: str) -> None:
    with pytest.raises(TwinError, match="write it in mm, N, % or deg: 355 mm for 35.5 cm"):
        parse_reading(text)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("A=0..0", (0.0, 0.0)),
        ("A=-1..1", (-1.0, 1.0)),
        ("A=0.1..5", None),
        ("A=-5..-0.1", None),
        ("A=1..-1", None),
        ("A=-1.2.3..5", None),
        ("A=5", None),
    ],
)
def test_end_stops_enclose_zero(text: str, says: tuple[float, float] | None) -> None:
    if says is None:
        with pytest.raises(DescriptionError):
            parse_end_stop(text)
        return
    assert parse_end_stop(text) == ("A", says)


@pytest.mark.parametrize(
    ("text", "start"), [("A=-180", -180.0), ("A=179.9", 179.9), ("A=180", None), ("A=-180.1", None)]
)
def test_starts_are_within_a_turn(text: str, start: float | None) -> None:
    if start is None:
        with pytest.raises(DescriptionError):
            parse_start(text)
        return
    assert parse_start(text) == ("A", start)


def test_ports_of_texts() -> None:
    assert [port_of(text) for text in ("b=5", " S2 = x", "s4", "A")] == ["B", "2", "4", "A"]
    assert by_port("--start", [("A", 1), ("B", 2)]) == {"A": 1, "B": 2}
    with pytest.raises(DescriptionError, match="--start names port A twice; name it once"):
        by_port("--start", [("A", 1), ("B", 2), ("A", 3)])


# ---- stimuli


@pytest.mark.parametrize(
    ("sensed", "hsv"),
    [
        (40.4, (0, 0, 40)),
        (-5, (0, 0, 0)),
        (150.0, (0, 0, 100)),
        ((359.6, 50.4, 60.6), (0, 50, 61)),
        ((-30.0, -5.0, 120.0), (330, 0, 100)),
        ((725.0, 101.0, 99.6), (5, 100, 100)),
    ],
)
def test_colors_of_stimuli(sensed: Any, hsv: tuple[int, int, int]) -> None:
    assert color(sensed) == hsv


@pytest.mark.parametrize(
    ("sensed", "percent"), [(30.5, 30.5), (-1, 0.0), (101, 100.0), ((5.0, 6.0, 7.0), 7.0)]
)
def test_brightness_of_stimuli(sensed: Any, percent: float) -> None:
    assert brightness_pct(sensed) == percent


@pytest.mark.parametrize(
    ("hsv", "percent"),
    [
        ((0, 0, 0), 0),
        ((0, 0, 100), 100),
        ((0, 100, 100), 33),
        ((60, 100, 100), 66),
        ((120, 50, 80), 53),
        ((0, 0, 37), 37),
        ((0, 100, 3), 1),
    ],
)
def test_reflection_is_the_mean_of_the_channels(hsv: tuple[int, int, int], percent: int) -> None:
    assert reflection_pct(hsv) == percent


def test_kinds_of_stimuli() -> None:
    assert number(3) == 3.0 and number((4.0,)) == 4.0
    assert pitch_and_roll((1.0, 2.0)) == (1.0, 2.0)
    assert rotation(5) == (5.0, 0.0) and rotation((5.0, 6.0)) == (5.0, 6.0)
    assert beacon(()) is None and beacon((7.0, 8.0)) == (7.0, 8.0)
    for call, wrong, wanted in (
        (number, (1.0, 2.0), "a number"),
        (pitch_and_roll, 5.0, r"\(pitch, roll\)"),
        (rotation, (1.0, 2.0, 3.0), r"\(angle, rate\)"),
        (beacon, (1.0,), r"\(distance, direction\)"),
        (color, (1.0, 2.0), r"a brightness or \(hue, saturation, value\)"),
    ):
        with pytest.raises(TwinError, match=f"; give {wanted}$"):
            call(wrong)


# ---- messages of the radio


RADIO = """
from pybricks.messaging import BLERadio
def error(call, *values):
    try:
        return call(*values)
    except Exception as raised:
        return repr(raised)
"""


@pytest.mark.parametrize(
    ("message", "size"),
    [
        ("bytes({})", 24),
        ("'x' * {}", 24),
        ("[bytes({})]", 25),
        ("(1, bytes({}))", 23),
        ("(128, bytes({}))", 22),
        ("(-128, bytes({}))", 23),
        ("(-129, bytes({}))", 22),
        ("(32767, bytes({}))", 22),
        ("(32768, bytes({}))", 20),
        ("(0.5, bytes({}))", 20),
        ("(True, False, bytes({}))", 23),
        ("('ab', bytes({}))", 22),
    ],
)
def test_a_message_has_26_bytes(message: str, size: int) -> None:
    """A byte for the type of each value, and one for a single value; numbers have one, two or four
    more."""
    longest, longer = message.format(size), message.format(size + 1)
    source = f"radio = BLERadio(1)\nprint(error(radio.broadcast, {longest}))\n"
    source += f"print(error(radio.broadcast, {longer}))"
    refused = "ValueError('payload limited to 26 bytes',)"
    assert output(RADIO + source).splitlines() == ["None", refused]


@pytest.mark.parametrize(
    ("arguments", "answer"),
    [
        ("0, [0]", "None"),
        ("255, [255]", "None"),
        ("256, []", "ValueError('Broadcast channel must be 0 to 255 or None',)"),
        ("-1, []", "ValueError('Broadcast channel must be 0 to 255 or None',)"),
        ("None, [256]", "ValueError('observe channel must be 0 to 255',)"),
        ("None, [5, -1]", "ValueError('observe channel must be 0 to 255',)"),
        ("None, list(range(255))", "None"),
        ("None, [1] * 256", "ValueError('Too many observe channels',)"),
        ("1.0, []", 'TypeError("can\'t convert float to int",)'),
    ],
)
def test_channels_of_the_radio(arguments: str, answer: str) -> None:
    source = f"print(error(lambda: BLERadio({arguments}) and None))"
    assert output(RADIO + source) == answer


def test_channels_are_kept_in_a_byte() -> None:
    source = """
radio = BLERadio(None, [2, 7])
print(radio.observe(2), radio.observe(258), radio.signal_strength(7), radio.version())
print(error(radio.observe, 3), error(radio.signal_strength, 259))
print(error(radio.broadcast, 1), error(radio.observe, 2.0))
"""
    assert output(RADIO + source).splitlines() == [
        "None None -128 v1.0",
        "ValueError('channel not configured',) ValueError('channel not configured',)",
        (
            "RuntimeError('no broadcast channel selected',) "
            'TypeError("can\'t convert float to int",)'
        ),
    ]


# ---- output on its way


def sending(*sizes: int, pauses_ms: int = 0) -> tuple[list[int], bytes]:
    """Times (ms) after each of several outputs, and all of them."""
    machine = Machine(BenchBody(BENCH))
    out = io.BytesIO()
    console = StreamConsole(machine, None, out)
    times_ms = []
    for size in sizes:
        console.write(b"x" * size)
        times_ms.append(machine.time_ms)
        if pauses_ms:
            machine.advance(pauses_ms)
    return times_ms, out.getvalue()


@pytest.mark.parametrize(
    ("sizes", "times_ms"),
    [
        ((511,), [0]),
        ((512,), [1]),
        ((571,), [1]),
        ((572,), [2]),
        ((300, 211), [0, 0]),
        ((300, 212), [0, 1]),
        ((511, 1), [0, 1]),
        ((511, 60, 60), [0, 1, 2]),
        ((511, 61), [0, 2]),
    ],
)
def test_output_waits_for_a_full_buffer(sizes: tuple[int, ...], times_ms: list[int]) -> None:
    """Of 511 bytes, of which 60 are sent each millisecond."""
    found_ms, written = sending(*sizes)
    assert found_ms == times_ms
    assert written == b"x" * sum(sizes)


def test_the_buffer_is_sent_meanwhile() -> None:
    times_ms, _ = sending(511, 511, 511, pauses_ms=9)
    assert times_ms == [0, 9, 18]
    times_ms, _ = sending(511, 511, pauses_ms=5)
    assert times_ms == [0, 9]


@pytest.mark.parametrize(
    ("typed", "count", "read"), [(b"abc", 2, b"ab"), ("a\nb", 3, b"a\rb"), (b"abc", 3, b"abc")]
)
def test_input_is_read_in_pieces(typed: Any, count: int, read: bytes) -> None:
    stream = io.StringIO(typed) if isinstance(typed, str) else io.BytesIO(typed)
    console = StreamConsole(Machine(BenchBody(BENCH)), stream, io.BytesIO())
    assert console.available() == len(typed)
    assert console.read(count) == read
    assert console.available() == len(typed) - count
    with pytest.raises(EOFError, match="the program waits for input, and there is no more"):
        console.read(len(typed) - count + 1)
    without = StreamConsole(Machine(BenchBody(BENCH)), None, io.BytesIO())
    assert without.available() == 0
    with pytest.raises(EOFError, match="several hubs in a room have none"):
        without.read(1)


def test_lines_end_as_on_this_computer() -> None:
    out = io.BytesIO()
    StreamConsole(Machine(BenchBody(BENCH)), None, out).write(b"a\r\nb\n\rc\r\n")
    assert out.getvalue() == b"a\nb\n\rc\n"
