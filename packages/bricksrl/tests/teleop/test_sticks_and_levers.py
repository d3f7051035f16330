"""Sticks, levers and keys as actions, with devices that are made up."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from brickhub.entry import Entry
from bricksrl import teleoperation
from bricksrl.errors import DataError
from bricksrl.teleoperation import (
    ControllerPad,
    GamepadDriver,
    KeyboardDriver,
    LinuxPad,
    Paced,
    PygamePad,
    at_rest,
    find_pad,
    legend,
    pushed,
)

ARM = Entry("arm", -30.0, 30.0, "deg")
LEG = Entry("leg", -100.0, 0.0, "deg")
NOTHING = torch.zeros(3)


@pytest.mark.parametrize(
    ("low", "high", "rest"),
    [
        (-30.0, 30.0, 0.0),
        (-100.0, 0.0, 1.0),
        (0.0, 50.0, -1.0),
        (-10.0, 30.0, -0.5),
        (40.0, 80.0, -1.0),
        (-80.0, -40.0, 1.0),
        (5.0, 5.0, 0.0),
        (-float("inf"), 0.0, 0.0),
    ],
)
def test_rest_is_the_action_of_nothing(low: float, high: float, rest: float) -> None:
    assert at_rest([Entry("motor", low, high)]) == [rest]


def test_pushes_reach_from_rest_to_the_ends() -> None:
    rest = [0.5] * 5
    assert pushed([1.0, 0.5, 0.0, -0.5, -1.0], rest) == [1.0, 0.75, 0.5, -0.25, -1.0]
    assert pushed([2.0, -2.0], [0.5, 0.5]) == [1.0, -1.0]


def test_keys_are_told_as_far_as_there_are_some() -> None:
    lines = legend([ARM] * 7)
    assert len(lines) == 6 + 2
    assert lines[5] == "y / h    arm up / down"


class Sticks:
    """A gamepad with positions and presses as told."""

    def __init__(self, *positions: float) -> None:
        self.positions: Sequence[float] = positions
        self.presses = 0
        self.is_open = True

    def read(self) -> tuple[Sequence[float], int]:
        presses = self.presses
        self.presses = 0
        return self.positions, presses

    def close(self) -> None:
        self.is_open = False


@pytest.mark.parametrize(
    ("position", "action"), [(0.0, 0.0), (0.09, 0.0), (-0.09, 0.0), (0.1, 0.1), (-0.5, -0.5)]
)
def test_stick_near_its_middle_is_released(position: float, action: float) -> None:
    pad = Sticks(0.0)
    with GamepadDriver([ARM], pad=pad) as driver:
        pad.positions = (position,)
        acted = driver(NOTHING)
        assert acted is not None and acted.tolist() == pytest.approx([action])
    assert not pad.is_open


@pytest.mark.parametrize(("at_start", "is_stick"), [(0.89, True), (0.9, False), (-0.95, False)])
def test_axis_that_rests_at_its_end_is_a_trigger(at_start: float, is_stick: bool) -> None:
    pad = Sticks(at_start, 0.0)
    driver = GamepadDriver([ARM], pad=pad)
    pad.positions = (0.25, 0.75)
    acted = driver(NOTHING)
    assert acted is not None and acted.tolist() == [0.25 if is_stick else 0.75]


def test_commands_without_a_stick_rest() -> None:
    pad = Sticks(0.0)
    driver = GamepadDriver([ARM, LEG, ARM], pad=pad)
    pad.positions = (0.5,)
    acted = driver(NOTHING)
    assert acted is not None and acted.tolist() == [0.5, 1.0, 0.0]


def test_each_press_takes_over_or_gives_back() -> None:
    pad = Sticks(0.0)
    driver = GamepadDriver([ARM], pad=pad, in_charge=False)
    assert driver(NOTHING) is None
    found = []
    for presses in (1, 0, 2, 1, 3):
        pad.presses = presses
        found.append(driver(NOTHING) is not None)
    assert found == [True, True, True, False, True]


class Keys:
    """A terminal with keys that were pressed."""

    def __init__(self, *keys: Any) -> None:
        self.pressed: list[Any] = list(keys)
        self.is_open = True

    def read_keys(self) -> list[Any]:
        pressed = [SimpleNamespace(key=key) for key in self.pressed]
        self.pressed = []
        return pressed

    def close(self) -> None:
        self.is_open = False


def keyboard(source: Keys, count: int = 2, **options: Any) -> KeyboardDriver:
    given: Any = source
    return KeyboardDriver([ARM] * count, source=given, **options)


def test_last_key_of_a_command_counts() -> None:
    keys = Keys()
    driver = keyboard(keys, 6)
    for pressed, action in (
        (("q",), [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        (("q", "a"), [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        (("S", "e", "f", "t", "H"), [0.0, -1.0, 1.0, -1.0, 1.0, -1.0]),
        (("x", "7"), [0.0] * 6),
    ):
        keys.pressed = list(pressed)
        acted = driver(NOTHING)
        assert acted is not None and acted.tolist() == action


def test_backspace_discards_and_the_space_bar_hands_over() -> None:
    discarded: list[bool] = []
    keys = Keys(SimpleNamespace(value="c-h"), " ")
    driver = keyboard(keys)
    driver.on_discard()
    driver.on_discard = lambda: discarded.append(True)
    assert driver(NOTHING) is None and discarded == [True]
    keys.pressed = [" ", "w"]
    acted = driver(NOTHING)
    assert acted is not None and acted.tolist() == [0.0, 1.0]
    driver.__exit__()
    assert not keys.is_open


def test_six_commands_have_keys_and_seven_are_too_many() -> None:
    keyboard(Keys(), 6)
    with pytest.raises(DataError) as raised:
        keyboard(Keys(), 7)
    assert str(raised.value) == (
        "7 commands are too many for the keyboard, which drives 6; use the API"
    )


class Clock:
    """Time that passes while somebody sleeps."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.slept_s: list[float] = []

    def perf_counter(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.slept_s.append(seconds)
        self.now_s += seconds


def test_simulation_keeps_its_rate_and_makes_up_for_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Four steps a second; a step that took long is not followed by faster ones."""
    clock = Clock()
    monkeypatch.setattr(teleoperation, "time", clock)
    paced = Paced(lambda observation: observation + 1.0, 4.0)
    acted = paced(NOTHING)
    assert acted is not None and acted.tolist() == [1.0] * 3
    clock.now_s += 0.125
    paced(NOTHING)
    clock.now_s += 5.0
    paced(NOTHING)
    paced(NOTHING)
    assert clock.slept_s == pytest.approx([0.25, 0.125, 0.0, 0.25])


class Lego:
    """LEGO's package, with a Controller in reach or none."""

    def __init__(self, *, connected: bool) -> None:
        self.connected = connected
        self.sensor = SimpleNamespace(leftPercent=0, rightPercent=0)
        self.button = SimpleNamespace(state=0)
        self.asked: list[Any] = []

    def Controller(self) -> Lego:  # noqa: N802  LEGO's name
        return self

    def connect(self, **options: Any) -> None:
        self.asked.append(options)

    def disconnect(self) -> None:
        self.connected = False


def controller(monkeypatch: pytest.MonkeyPatch, lego: Lego) -> ControllerPad:
    monkeypatch.setattr(teleoperation, "lego_package", lambda *, is_silent: lego)
    radio = SimpleNamespace(run=lambda function: function())
    monkeypatch.setattr(teleoperation, "RealRadio", lambda: radio)
    return ControllerPad()


def test_levers_of_a_controller_are_sticks_and_its_button_is_told_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lego = Lego(connected=True)
    pad = controller(monkeypatch, lego)
    assert pad.read() == ([0.0, 0.0], 0)
    lego.sensor = SimpleNamespace(leftPercent=-100, rightPercent=25)
    found = []
    for state in (1, 1, 0, 1):
        lego.button.state = state
        found.append(pad.read())
    assert [presses for _, presses in found] == [1, 0, 0, 1]
    assert found[0][0] == [-1.0, 0.25]
    pad.close()
    with pytest.raises(DataError, match="^the Controller is gone; switch it on, bring it near,"):
        pad.read()


def test_missing_controller_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(DataError) as raised:
        controller(monkeypatch, Lego(connected=False))
    assert str(raised.value) == (
        "no Controller of LEGO's kits is in reach; switch it on, and bring it near"
    )


def test_missing_gamepad_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[str] = []
    display = SimpleNamespace(init=lambda: started.append("display"))
    joystick = SimpleNamespace(init=lambda: started.append("joystick"), get_count=lambda: 0)
    pygame = SimpleNamespace(display=display, joystick=joystick)
    monkeypatch.setattr(teleoperation.importlib, "import_module", lambda name: pygame)
    with pytest.raises(DataError) as raised:
        PygamePad()
    assert str(raised.value) == "no gamepad is here; plug one in, or drive with the keyboard"
    assert started == ["display", "joystick"]


def test_other_buttons_of_a_gamepad_are_no_presses(monkeypatch: pytest.MonkeyPatch) -> None:
    quits: list[str] = []
    stick = SimpleNamespace(
        init=lambda: None, get_numaxes=lambda: 2, get_axis=lambda axis: axis / 2
    )
    joystick = SimpleNamespace(
        init=lambda: None,
        get_count=lambda: 1,
        Joystick=lambda number: stick if number == 0 else None,
        quit=lambda: quits.append("joystick"),
    )
    display = SimpleNamespace(init=lambda: None, quit=lambda: quits.append("display"))
    buttons = [SimpleNamespace(type=1, button=number) for number in (0, 1, 0, 5)]
    moved = SimpleNamespace(type=0)
    event = SimpleNamespace(get=lambda: [moved, *buttons])
    pygame = SimpleNamespace(
        display=display, joystick=joystick, event=event, JOYBUTTONDOWN=1, JOYDEVICEREMOVED=2
    )
    monkeypatch.setattr(teleoperation.importlib, "import_module", lambda name: pygame)
    pad = PygamePad()
    assert pad.read() == ([0.0, 0.5], 2)
    pad.close()
    assert quits == ["joystick", "display"]


of_posix = pytest.mark.skipif(sys.platform == "win32", reason="device files are of POSIX")


@of_posix
def test_device_file_that_ends_is_a_gamepad_that_is_gone(tmp_path: Path) -> None:
    device = tmp_path / "js0"
    device.write_bytes(b"1234567")
    pad = LinuxPad(device)
    with pytest.raises(DataError) as raised:
        pad.read()
    assert str(raised.value) == f"the gamepad {device} is gone; plug it in and start again"
    pad.close()


@of_posix
def test_moves_and_presses_of_a_device_file_are_read(tmp_path: Path) -> None:
    """An axis is from -32767 to 32767; button 0 alone is counted, and not as it stands at the
    start."""
    event = teleoperation._EVENT.pack
    device = tmp_path / "js0"
    events = [
        event(1, 32767, 0x82, 2),
        event(1, -32767, 0x02, 0),
        event(1, 1, 0x81, 0),
        event(1, 1, 0x01, 0),
        event(1, 0, 0x01, 0),
        event(1, 1, 0x01, 1),
    ]
    device.write_bytes(b"".join(events))
    pad = LinuxPad(device)
    assert pad.read() == ([-1.0, 0.0, 1.0], 1)
    assert pad.read() == ([-1.0, 0.0, 1.0], 0), "sticks stay where they are"
    pad.close()


def test_first_gamepad_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    devices = [Path("/dev/input/js1"), Path("/dev/input/js0")]
    monkeypatch.setattr(teleoperation, "LinuxPad", lambda device: ("linux", device))
    monkeypatch.setattr(teleoperation, "PygamePad", lambda: "pygame")
    monkeypatch.setattr(Path, "glob", lambda folder, pattern: iter(devices))
    monkeypatch.setattr(Path, "is_dir", lambda folder: True)
    assert find_pad() == ("linux", Path("/dev/input/js0"))
    devices.clear()
    assert find_pad() == "pygame"
    monkeypatch.setattr(Path, "is_dir", lambda folder: False)
    assert find_pad() == "pygame"
