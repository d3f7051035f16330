"""What is seen and heard of a hub: icons, pixels, symbols, notes, and what it stores."""

from __future__ import annotations

import pytest
from hub_programs import Console

from brickhub.robot import BENCH, HubKind, Robot
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.interpreter import execute
from brickhub.virtual.machine import Machine
from brickhub.virtual.panel import Panel
from brickhub.virtual.pybricks import modules
from brickhub.virtual.pybricks.hub_panel import _parse_note

HEAD = """
from pybricks.hubs import ThisHub
from pybricks.parameters import *
from pybricks.tools import *
hub = ThisHub()
watch = StopWatch()
def error(call, *values, **named):
    try:
        return call(*values, **named)
    except Exception as raised:
        return repr(raised)
"""
ICONS = """
UP                DOWN              LEFT              RIGHT             HAPPY             SAD
..#..             .###.             ..#..             ..#..             ##.##             ##.##
.###.             .###.             .####             ####.             ##.##             ##.##
#####             #####             #####             #####             .....             .....
.###.             .###.             .####             ####.             #...#             .###.
.###.             ..#..             ..#..             ..#..             .###.             #...#
ARROW_UP          ARROW_DOWN        ARROW_LEFT        ARROW_RIGHT       TRUE              FALSE
..#..             ..#..             ..#..             ..#..             ....#             #...#
.###.             ..#..             .#...             ...#.             ...#.             .#.#.
#.#.#             #.#.#             #####             #####             #.#..             ..#..
..#..             .###.             .#...             ...#.             .#...             .#.#.
..#..             ..#..             ..#..             ..#..             .....             #...#
ARROW_RIGHT_UP    ARROW_RIGHT_DOWN  ARROW_LEFT_UP     ARROW_LEFT_DOWN   CLOCKWISE         COUNTERCLOCKWISE
..###             #....             ###..             ....#             ####.             .####
...##             .#...             ##...             ...#.             #..#.             .#..#
..#.#             ..#.#             #.#..             #.#..             #..#.             .#..#
.#...             ...##             ...#.             ##...             #.###             ###.#
#....             ..###             ....#             ###..             ...#.             .#...
EYE_LEFT          EYE_RIGHT         EYE_LEFT_BLINK    EYE_RIGHT_BLINK   EYE_LEFT_BROW     EYE_RIGHT_BROW
.....             .....             .....             .....             .....             .....
.....             .....             .....             .....             ##...             ...##
##...             ...##             .....             .....             .....             .....
##...             ...##             ##...             ...##             .....             .....
.....             .....             .....             .....             .....             .....
EYE_LEFT_BROW_UP  EYE_RIGHT_BROW_UP HEART             PAUSE             EMPTY             FULL
##...             ...##             .#.#.             .....             .....             #####
.....             .....             #####             .#.#.             .....             #####
.....             .....             #####             .#.#.             .....             #####
.....             .....             .###.             .#.#.             .....             #####
.....             .....             ..#..             .....             .....             #####
TRIANGLE_UP       TRIANGLE_DOWN     TRIANGLE_LEFT     TRIANGLE_RIGHT    SQUARE            CIRCLE
.....             .....             ...#.             .#...             .....             .###.
..#..             #####             ..##.             .##..             .###.             #####
.###.             .###.             .###.             .###.             .###.             #####
#####             ..#..             ..##.             .##..             .###.             #####
.....             .....             ...#.             .#...             .....             .###.
"""  # noqa: E501


def pictures() -> dict[str, str]:
    """The icons above by their names."""
    lines = ICONS.strip().splitlines()
    found = {}
    for start in range(0, len(lines), 6):
        names, *rows = [line.split() for line in lines[start : start + 6]]
        for column, name in enumerate(names):
            found[name] = "/".join(row[column] for row in rows)
    return found


class Seen:
    """The panel of a hub while a program runs, with what it printed."""

    def __init__(self, source: str, kind: HubKind = BENCH.hub, *held: str) -> None:
        robot = BENCH if kind is BENCH.hub else Robot("it", kind)
        panel = Panel(kind)
        for button in held:
            panel.hold(button)
        self.machine = Machine(BenchBody(robot), panel)
        self.displays: list[tuple[int, str]] = []
        self.sounds: list[tuple[int, int]] = []
        self.lights: list[tuple[int, object]] = []
        panel.on_change = self._look
        console = Console(self.machine, {})
        execute(HEAD + source, "main.py", modules(self.machine, console), console)
        self.printed = console.written.decode().replace("\r\n", "\n").splitlines()

    def _look(self, panel: Panel) -> None:
        now_ms = self.machine.time_ms
        display = panel.text or "/".join(
            "".join(".#"[level > 0] for level in panel.display[start : start + 5])
            for start in range(0, 25, 5)
        )
        if not self.displays or self.displays[-1][1] != display:
            self.displays.append((now_ms, display))
        if not self.sounds or self.sounds[-1][1] != panel.sound_hz:
            self.sounds.append((now_ms, panel.sound_hz))
        if not self.lights or self.lights[-1][1] != panel.light:
            self.lights.append((now_ms, panel.light))

    @property
    def pixels(self) -> list[int]:
        return list(self.machine.panel.display)


@pytest.mark.parametrize(("name", "picture"), pictures().items())
def test_icons_are_the_pictures_of_the_documentation(name: str, picture: str) -> None:
    pixels = Seen(f"hub.display.icon(Icon.{name})").pixels
    assert pixels == [100 if mark == "#" else 0 for mark in picture.replace("/", "")]


@pytest.mark.parametrize(
    "pair",
    [
        "LEFT RIGHT",
        "ARROW_LEFT ARROW_RIGHT",
        "ARROW_LEFT_UP ARROW_RIGHT_UP",
        "ARROW_LEFT_DOWN ARROW_RIGHT_DOWN",
        "CLOCKWISE COUNTERCLOCKWISE",
        "EYE_LEFT EYE_RIGHT",
        "EYE_LEFT_BLINK EYE_RIGHT_BLINK",
        "EYE_LEFT_BROW EYE_RIGHT_BROW",
        "EYE_LEFT_BROW_UP EYE_RIGHT_BROW_UP",
        "TRIANGLE_LEFT TRIANGLE_RIGHT",
    ],
)
def test_icons_of_both_sides_are_mirrored(pair: str) -> None:
    left, right = (pictures()[name].split("/") for name in pair.split())
    assert [row[::-1] for row in left] == right


@pytest.mark.parametrize(
    ("number", "lit"),
    [
        (0, []),
        (1, [24]),
        (2, [23]),
        (16, [20]),
        (32, [19]),
        (1 << 20, [4]),
        (1 << 24, [0]),
        (1 << 25, []),
        (0b10001_00000_00100_00000_01010, [0, 4, 12, 21, 23]),
        (0x1FFFFFF, list(range(25))),
    ],
)
def test_icons_of_numbers(number: int, lit: list[int]) -> None:
    """Five bits a row, the highest first; bits beyond the 25 are ignored."""
    pixels = Seen(f"hub.display.icon(Icon({number}))").pixels
    assert [place for place in range(25) if pixels[place] == 100] == lit
    assert set(pixels) <= {0, 100}


@pytest.mark.parametrize(
    ("side", "lit"),
    [("TOP", 1), ("FRONT", 1), ("RIGHT", 9), ("BOTTOM", 23), ("BACK", 23), ("LEFT", 15)],
)
def test_a_turned_display(side: str, lit: int) -> None:
    """The second pixel of the first row, where the named side of the hub is up."""
    source = f"hub.display.orientation(Side.{side})\n"
    single = Seen(source + "hub.display.pixel(0, 1, 30)").pixels
    assert [place for place, level in enumerate(single) if level] == [lit]
    assert single[lit] == 30
    rows = "[[0, 100, 0, 0, 0], [0] * 5, [0] * 5, [0] * 5, [0] * 5]"
    whole = Seen(source + f"hub.display.icon(Matrix({rows}))").pixels
    assert [place for place, level in enumerate(whole) if level] == [lit]


@pytest.mark.parametrize(
    ("row", "column", "place"),
    [(0, 0, 0), (0, 4, 4), (4, 0, 20), (4, 4, 24), (2, 3, 13), (1.9, 2.9, 7)],
)
def test_a_pixel(row: float, column: float, place: int) -> None:
    pixels = Seen(f"hub.display.on(10)\nhub.display.pixel({row}, {column})").pixels
    assert pixels == [100 if index == place else 10 for index in range(25)]


@pytest.mark.parametrize(("row", "column"), [(-1, 0), (0, -1), (5, 0), (0, 5)])
def test_a_pixel_beyond_the_display_is_ignored(row: int, column: int) -> None:
    assert Seen(f"hub.display.pixel({row}, {column})").pixels == [0] * 25


@pytest.mark.parametrize(
    ("call", "pixels"),
    [
        ("on()", [100] * 25),
        ("on(33.9)", [33] * 25),
        ("on(-5)", [0] * 25),
        ("on(500)", [100] * 25),
        ("icon([[0, 50, 100, 150, -5]] * 5)", [0, 50, 100, 100, 0] * 5),
        ("icon(Matrix([[0, 50.9, 100, 150, -5]] * 5))", [0, 50, 100, 100, 0] * 5),
        ("off()", [0] * 25),
    ],
)
def test_brightness_is_in_percent(call: str, pixels: list[int]) -> None:
    assert Seen(f"hub.display.{call}").pixels == pixels


@pytest.mark.parametrize(
    ("call", "shown"),
    [
        ("number(7)", "7"),
        ("number(-99)", "-99"),
        ("number(99)", "99"),
        ("number(100)", ">"),
        ("number(-100)", "<"),
        ("number(5.9)", "5"),
        ('char("a")', "a"),
        ('char(" ")', " "),
        ('char("~")', "~"),
    ],
)
def test_symbols(call: str, shown: str) -> None:
    assert Seen(f"hub.display.{call}").machine.panel.text == shown


@pytest.mark.parametrize(
    "call",
    [
        'char("")',
        'char("ab")',
        'char("\\x1f")',
        'char("\\x7f")',
        "icon([[0] * 5] * 4)",
        "icon([[0] * 5] * 6)",
        "icon([[0] * 4] * 5)",
        "icon(Matrix([[0] * 5] * 4))",
        "icon(Matrix([[0] * 4] * 5))",
        "animate([Icon.UP], 100)",
        "animate([Icon.UP] * 256, 100)",
        "animate([], 100)",
    ],
)
def test_refusals_of_the_display(call: str) -> None:
    source = f"print(error(lambda: hub.display.{call}))"
    assert Seen(source).printed == ["ValueError('Invalid argument',)"]


def test_an_animation_may_have_2_to_255_pictures() -> None:
    source = """
print(error(hub.display.animate, [Icon.UP, Icon.DOWN], 100))
print(error(hub.display.animate, [Icon.UP] * 255, 100))
"""
    assert Seen(source).printed == ["None", "None"]


def test_a_text_is_shown_letter_by_letter() -> None:
    empty = "/".join(["....."] * 5)
    seen = Seen('hub.display.text("ab")\nprint(watch.time())')
    assert seen.displays == [(0, "a"), (500, empty), (550, "b"), (1050, empty)]
    assert seen.printed == ["1100"]
    seen = Seen('hub.display.text("ab", 30, 0)\nprint(watch.time())')
    assert seen.displays == [(0, "a"), (30, "b"), (60, empty)]
    assert seen.printed == ["60"]
    seen = Seen('hub.display.text("a", off=7, on=5)\nprint(watch.time())')
    assert seen.displays == [(0, "a"), (5, empty)]
    assert seen.printed == ["12"]


# ---- sounds


def test_notes_have_the_frequencies_of_equal_temperament() -> None:
    """A4 has 440 Hz, and each of the twelve semitones is the twelfth root of two higher; the
    firmware cuts the digits off."""
    names = ["C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B"]
    for semitone, name in enumerate(names):
        lowest_hz = 440 * 2 ** ((semitone - 9) / 12) / 16
        for octave in range(2, 9):
            frequency_hz, _, _ = _parse_note(f"{name}{octave}/4", 2000)
            assert frequency_hz == (round(lowest_hz * 100) << octave) // 100
            assert frequency_hz == pytest.approx(lowest_hz * 2**octave, rel=0.003, abs=1)


@pytest.mark.parametrize(
    ("flat", "sharp"), [("Db", "C#"), ("Eb", "D#"), ("Gb", "F#"), ("Ab", "G#"), ("Bb", "A#")]
)
def test_a_flat_is_the_sharp_of_the_note_below(flat: str, sharp: str) -> None:
    assert _parse_note(f"{flat}4/4", 2000) == _parse_note(f"{sharp}4/4", 2000)


@pytest.mark.parametrize(
    ("note", "sound_ms", "total_ms"),
    [
        ("C4/1", 1750, 2000),
        ("C4/4", 437, 500),
        ("C4/4.", 656, 750),
        ("C4/4_", 500, 500),
        ("C4/4._", 750, 750),
        ("C4/16", 109, 125),
        ("C4/3", 582, 666),
        ("C4/32", 54, 62),
        ("R/2", 875, 1000),
    ],
)
def test_durations_of_notes(note: str, sound_ms: int, total_ms: int) -> None:
    """Of a bar of two seconds; the last eighth of a note is silent, unless it is tied."""
    assert _parse_note(note, 2000)[1:] == (sound_ms, total_ms)


@pytest.mark.parametrize(
    ("note", "says"),
    [
        ("", "Missing note name A-G or R"),
        ("H4/4", "Missing note name A-G or R"),
        ("a4/4", "Missing note name A-G or R"),
        ("C/4", "Missing octave number 2-8"),
        ("C1/4", "Missing octave number 2-8"),
        ("C9/4", "Missing octave number 2-8"),
        ("C4", "Missing /"),
        ("R4/4", "Missing /"),
        ("C4/", "Missing fractional value 1, 2, 4, 8, etc."),
        ("Cb4/4", "Cb is not allowed"),
        ("B#4/4", "B# is not allowed"),
        ("E#4/4", "E# is not allowed"),
        ("Fb4/4", "Fb is not allowed"),
    ],
)
def test_refusals_of_notes(note: str, says: str) -> None:
    with pytest.raises(ValueError, match=f"^{says}$"):
        _parse_note(note, 2000)


def test_a_melody_at_its_tempo() -> None:
    source = """
hub.speaker.play_notes(["A4/4", "R/4", "A5/8_"], tempo=60)
print(watch.time())
hub.speaker.play_notes(["A3/4"])
print(watch.time())
"""
    seen = Seen(source)
    assert seen.sounds == [(0, 440), (875, 0), (2000, 880), (2500, 0), (2500, 220), (2937, 0)]
    assert seen.printed == ["2500", "3000"]


def test_beeps() -> None:
    source = """
hub.speaker.beep()
print(watch.time())
hub.speaker.beep(700.9, 50)
print(watch.time(), hub.speaker.beep(300, -1), watch.time())
wait(20)
print(hub.speaker.volume(), hub.speaker.volume(250), hub.speaker.volume())
print(hub.speaker.volume(-3), hub.speaker.volume())
"""
    seen = Seen(source)
    assert seen.sounds == [(0, 500), (100, 0), (100, 700), (150, 0), (150, 300)]
    assert seen.printed == ["100", "150 None 150", "100 None 100", "None 0"]


# ---- light and buttons


def test_a_light_that_blinks() -> None:
    source = "hub.light.blink(Color.RED, [10, 20, 30])\nwait(100)"
    red = (0, 100, 100)
    assert Seen(source).lights[:5] == [(0, red), (11, None), (31, red), (71, None), (91, red)]


@pytest.mark.parametrize(
    ("color", "light"),
    [
        ("Color(10, 20, 30)", (10, 20, 30)),
        ("Color(10, 20, 1)", (10, 20, 1)),
        ("Color(10, 20, 0)", None),
        ("Color(10, 20, -5)", None),
        ("Color.NONE", None),
    ],
)
def test_a_color_without_brightness_is_off(color: str, light: tuple[int, int, int] | None) -> None:
    assert Seen(f"hub.light.on({color})").machine.panel.light == light


@pytest.mark.parametrize(("durations", "fits"), [("[1]", True), ("[0]", False), ("[5, -1]", False)])
def test_durations_of_a_blinking_light_are_positive(durations: str, fits: bool) -> None:
    (line,) = Seen(f"print(error(hub.light.blink, Color.RED, {durations}))").printed
    assert line == ("None" if fits else "ValueError('Invalid argument',)")


def test_buttons_of_a_hub() -> None:
    assert Seen("print(hub.buttons.pressed())").printed == ["set()"]
    held = ["left", "right", "bluetooth"]
    source = "print(hub.buttons.pressed() == {Button.LEFT, Button.RIGHT, Button.BLUETOOTH})"
    assert Seen(source, BENCH.hub, *held).printed == ["True"]


# ---- battery, charger, storage


def test_a_hub_at_rest() -> None:
    source = """
print(hub.battery.voltage(), hub.battery.current(), hub.battery.type(), hub.battery.temperature())
print(hub.charger.connected(), hub.charger.status(), hub.charger.current())
print(hub.system.reset_reason())
for name, value in sorted(hub.system.info().items()):
    print(name, value)
"""
    assert Seen(source).printed == [
        "7200 100 Li-ion 25000",
        "0 0 0",
        "0",
        "host_connected_ble True",
        "host_connected_usb False",
        "name Pybricks Hub",
        "program_id 0",
        "program_start_type 3",
        "reset_reason 0",
    ]


@pytest.mark.parametrize(
    ("call", "answer"),
    [
        ("0, write=b'ab'", "None"),
        ("510, write=b'ab'", "None"),
        ("511, write=b'ab'", "ValueError('Invalid argument',)"),
        ("512, write=b''", "None"),
        ("-1, write=b'ab'", "ValueError('Invalid argument',)"),
        ("511, read=1", "b'\\x00'"),
        ("512, read=0", "b''"),
        ("512, read=1", "ValueError('Invalid argument',)"),
        ("0, read=-1", "ValueError('Invalid argument',)"),
        ("-1, read=1", "ValueError('Invalid argument',)"),
        ("0", "TypeError('Must set either read (int) or write (bytes).',)"),
        ("0, read=1, write=b'a'", "TypeError('Must set either read (int) or write (bytes).',)"),
        ("0.5, read=1", 'TypeError("can\'t convert float to int",)'),
        ("0, read=1.5", 'TypeError("can\'t convert float to int",)'),
    ],
)
def test_storage_ends_at_512_bytes(call: str, answer: str) -> None:
    assert Seen(f"print(error(hub.system.storage, {call}))").printed == [answer]


def test_storage_keeps_what_is_written() -> None:
    source = """
hub.system.storage(3, write=b"abcd")
hub.system.storage(5, write=b"X")
print(hub.system.storage(2, read=6), hub.system.reset_storage(), hub.system.storage(2, read=6))
"""
    zeros = "b'\\x00\\x00\\x00\\x00\\x00\\x00'"
    assert Seen(source).printed == [f"b'\\x00abXd\\x00' None {zeros}"]


@pytest.mark.parametrize(
    ("argument", "buttons"),
    [
        ("None", set()),
        ("()", set()),
        ("Button.LEFT", {"left"}),
        ("(Button.LEFT, Button.RIGHT)", {"left", "right"}),
        ("{Button.CENTER}", {"center"}),
        ("Button", set()),
    ],
)
def test_stop_buttons(argument: str, buttons: set[str]) -> None:
    seen = Seen(f"hub.system.set_stop_button({argument})")
    assert seen.machine.panel.stop_buttons == buttons


@pytest.mark.parametrize(("argument", "buttons"), [("None", set()), ("5", {"center"})])
def test_a_hub_with_one_button_stops_by_that(argument: str, buttons: set[str]) -> None:
    seen = Seen(f"hub.system.set_stop_button({argument})", HubKind.CITY)
    assert seen.machine.panel.stop_buttons == buttons
