"""An Xbox controller: what a program reads for each button, stick and trigger."""

from __future__ import annotations

import pytest
from hub_programs import Console

from brickhub.robot import BENCH
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.interpreter import execute
from brickhub.virtual.machine import Machine
from brickhub.virtual.panel import Panel
from brickhub.virtual.pybricks import modules

HEAD = """
from pybricks.iodevices import XboxController
from pybricks.tools import StopWatch, multitask, run_task, wait
box = XboxController()
def error(call, *values, **named):
    try:
        return call(*values, **named)
    except Exception as raised:
        return repr(raised)
"""
AT_REST = (0,) * 12
REST_OF_STICK = (0, 0)


def printed(source: str, *held: str) -> list[str]:
    """What a program prints while these buttons of the controller are held."""
    panel = Panel(BENCH.hub, near=["xbox"])
    for button in held:
        panel.hold(f"xbox.{button}")
    machine = Machine(BenchBody(BENCH), panel)
    console = Console(machine, {})
    execute(HEAD + source, "main.py", modules(machine, console), console)
    return console.written.decode().replace("\r\n", "\n").splitlines()


def state_with(**changes: int) -> tuple[int, ...]:
    """The raw state of which only the named numbers are not zero."""
    names = (
        *("left_x", "left_y", "right_x", "right_y", "left_trigger", "right_trigger"),
        *("dpad", "buttons", "upload", "profile", "trigger_switches", "paddles"),
    )
    return tuple(changes.get(name, 0) for name in names)


@pytest.mark.parametrize(
    ("button", "bits", "shown"),
    [
        ("a", 1, "A"),
        ("b", 2, "B"),
        ("x", 8, "X"),
        ("y", 16, "Y"),
        ("lb", 64, "LB"),
        ("rb", 128, "RB"),
        ("view", 1024, "VIEW"),
        ("menu", 2048, "MENU"),
        ("guide", 4096, "GUIDE"),
        ("lj", 8192, "LJ"),
        ("rj", 16384, "RJ"),
    ],
)
def test_each_button_has_its_bit_and_its_name(button: str, bits: int, shown: str) -> None:
    lines = printed("print(box.state())\nprint(box.buttons.pressed())", button)
    assert lines == [str(state_with(buttons=bits)), f"{{Button.{shown}}}"]


@pytest.mark.parametrize(
    ("button", "changed", "shown"),
    [
        ("p1", {"paddles": 1}, "P1"),
        ("p2", {"paddles": 2}, "P2"),
        ("p3", {"paddles": 4}, "P3"),
        ("p4", {"paddles": 8}, "P4"),
        ("upload", {"upload": 1}, "UPLOAD"),
    ],
)
def test_paddles_and_the_upload_button_have_numbers_of_their_own(
    button: str, changed: dict[str, int], shown: str
) -> None:
    lines = printed("print(box.state())\nprint(box.buttons.pressed())", button)
    assert lines == [str(state_with(**changed)), f"{{Button.{shown}}}"]


@pytest.mark.parametrize(
    ("held", "direction"),
    [
        ("", 0),
        ("up", 1),
        ("up right", 2),
        ("right", 3),
        ("right down", 4),
        ("down", 5),
        ("down left", 6),
        ("left", 7),
        ("left up", 8),
        ("left right", 0),
        ("up down", 0),
        ("up down left right", 0),
        ("left right up", 1),
        ("up down right", 3),
        ("left right down", 5),
        ("up down left", 7),
    ],
)
def test_the_pad_counts_its_directions_clockwise_from_up(held: str, direction: int) -> None:
    """Opposite directions cancel each other out."""
    lines = printed("print(box.dpad())\nprint(box.state())", *held.split())
    assert lines == [str(direction), str(state_with(dpad=direction))]


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize(
    ("held", "percents", "raw_x", "raw_y"),
    [
        ("up", (0, 100), 0, -32767),
        ("down", (0, -100), 0, 32768),
        ("left", (-100, 0), -32767, 0),
        ("right", (100, 0), 32768, 0),
        ("up right", (100, 100), 32768, -32767),
        ("down left", (-100, -100), -32767, 32768),
        ("left right", (0, 0), 0, 0),
        ("up down", (0, 0), 0, 0),
    ],
)
def test_sticks_go_all_the_way(
    side: str, held: str, percents: tuple[int, int], raw_x: int, raw_y: int
) -> None:
    """In percent to the right and up; the raw numbers of the controller count downwards."""
    buttons = [f"joystick_{side}_{direction}" for direction in held.split()]
    source = "print(box.joystick_left(), box.joystick_right())\nprint(box.state())"
    both = (percents, REST_OF_STICK) if side == "left" else (REST_OF_STICK, percents)
    raw = state_with(**{f"{side}_x": raw_x, f"{side}_y": raw_y})
    assert printed(source, *buttons) == [f"{both[0]} {both[1]}", str(raw)]


@pytest.mark.parametrize(
    ("held", "percents", "raw"),
    [
        ("", (0, 0), (0, 0)),
        ("left_trigger", (100, 0), (1023, 0)),
        ("right_trigger", (0, 100), (0, 1023)),
        ("left_trigger right_trigger", (100, 100), (1023, 1023)),
    ],
)
def test_triggers_are_pulled_all_the_way(
    held: str, percents: tuple[int, int], raw: tuple[int, int]
) -> None:
    lines = printed("print(box.triggers())\nprint(box.state())", *held.split())
    assert lines == [str(percents), str(state_with(left_trigger=raw[0], right_trigger=raw[1]))]


def test_all_buttons_together() -> None:
    buttons = "a b x y lb rb view menu guide lj rj"
    (line,) = printed("print(box.state())", *buttons.split(), "p1", "p2", "p3", "p4")
    assert line == str(state_with(buttons=0x7CDB, paddles=15))


def test_nothing_is_pressed_at_rest() -> None:
    source = "print(box.state())\nprint(box.buttons.pressed(), box.profile(), box.triggers())"
    assert printed(source) == [str(AT_REST), "set() 0 (0, 0)"]


def test_rumbling_takes_one_power_or_one_for_each_of_the_four_motors() -> None:
    source = """
print(error(box.rumble), error(box.rumble, 50), error(box.rumble, (1, 2, 3, 4)))
print(error(box.rumble, [1, 2, 3, 4], 100, 2, 50))
print(error(box.rumble, power=1, duration=2, count=3, delay=4))
for powers in ((), (1,), (1, 2, 3), (1, 2, 3, 4, 5)):
    print(error(box.rumble, powers))
print(error(box.rumble, "a"))
print(error(box.rumble, (1, 2, 3, "a")))
print(error(box.rumble, 50, "a"))
print(error(box.rumble, 50, 200, "a"))
print(error(box.rumble, 50, 200, 1, "a"))
"""
    wrong_count = "ValueError('expected 1 number or tuple of 4 values',)"
    wrong_type = 'TypeError("can\'t convert str to int",)'
    assert printed(source) == [
        "None None None",
        "None",
        "None",
        *[wrong_count] * 4,
        *[wrong_type] * 5,
    ]


def test_a_disconnected_controller_answers_nothing() -> None:
    source = """
def number(call):
    try:
        return call()
    except OSError as raised:
        return raised.errno
box.disconnect()
for call in (box.state, box.dpad, box.profile, box.joystick_left, box.joystick_right,
             box.triggers, box.rumble, box.name, box.buttons.pressed):
    print(number(call))
box.connect()
print(box.name(), box.profile())
"""
    *refused, again = printed(source)
    assert refused == ["19"] * 9
    assert again == "Xbox Wireless Controller 0"


def test_a_connected_controller_is_not_found_again() -> None:
    """The hub searches twice, with two seconds between, and each search ends a millisecond late."""
    source = """
watch = StopWatch()
print(error(XboxController, 10, None, 100), watch.time())
"""
    assert printed(source) == ["OSError(110, 'Timed out') 2202"]


def test_a_search_needs_half_a_second_and_a_deadzone_is_a_number() -> None:
    source = """
watch = StopWatch()
box.disconnect()
box.connect()
print(watch.time())
box.disconnect()
print(error(XboxController, "a"))
print(error(XboxController, 10, "a" * 15))
"""
    took, wrong_type, names = printed(source)
    assert int(took) == 500
    assert wrong_type == 'TypeError("can\'t convert str to int",)'
    assert names == "ValueError('Name too long',)"
