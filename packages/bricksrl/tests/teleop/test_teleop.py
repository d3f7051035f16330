from __future__ import annotations

import os
import struct
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

from brickhub.entry import Entry
from bricksrl.envs import get_task, list_envs
from bricksrl.errors import DataError
from bricksrl.teleoperation import (
    GamepadDriver,
    KeyboardDriver,
    LinuxPad,
    Paced,
    PygamePad,
    at_rest,
    legend,
    pushed,
)

pytestmark = pytest.mark.realtime

LEG, ARM = Entry("leg", -100.0, 0.0, "deg"), Entry("arm", -30.0, 30.0, "deg")
NOTHING = torch.zeros(3)


def test_released_controls_do_not_move() -> None:
    rest = at_rest([LEG, ARM, Entry("unknown"), Entry("far", 10.0, 20.0, "deg")])
    assert rest == [1.0, 0.0, 0.0, -1.0]  # 0 degrees, and the nearest to it
    assert pushed([0.0] * 4, rest) == rest
    assert pushed([1.0] * 4, rest) == [1.0] * 4
    assert pushed([-1.0] * 4, rest) == [-1.0] * 4
    assert pushed([-0.5, 0.5, 9.0, 0.0], rest) == [0.0, 0.5, 1.0, -1.0]


def test_each_command_has_a_key_to_raise_and_one_below_to_lower_it() -> None:
    assert legend([LEG, ARM]) == [
        "q / a    leg up / down",
        "w / s    arm up / down",
        "space    take over, or give back",
        "Ctrl-C   end",
    ]


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are of POSIX")
class TestKeyboard:
    def keyboard(self, **options: bool) -> tuple[KeyboardDriver, int]:
        import pty

        from prompt_toolkit.input.vt100 import Vt100Input

        ours, theirs = pty.openpty()
        self.terminal = os.fdopen(theirs, "r")
        return KeyboardDriver([LEG, ARM], source=Vt100Input(self.terminal), **options), ours

    def test_keyboard_controls(self) -> None:
        driver, hand = self.keyboard()
        with driver:
            assert driver(NOTHING).tolist() == [1.0, 0.0]
            os.write(hand, b"aw")
            assert driver(NOTHING).tolist() == [-1.0, 1.0]
            assert driver(NOTHING).tolist() == [1.0, 0.0]  # nothing was pressed since
            os.write(hand, b" q")
            assert driver(NOTHING) is None
            os.write(hand, b"S ")
            assert driver(NOTHING).tolist() == [1.0, -1.0]
            os.write(hand, b"\x03")
            with pytest.raises(KeyboardInterrupt):
                driver(NOTHING)
        self.terminal.close()
        os.close(hand)

    def test_question_needs_enter_key(self) -> None:
        driver, hand = self.keyboard()
        with driver:
            with driver.quiet():
                os.write(hand, b"\r")  # what the key sends; raw, it would end no line
                assert self.terminal.readline() == "\n"
            os.write(hand, b"a")
            assert driver(NOTHING).tolist() == [-1.0, 0.0]
        self.terminal.close()
        os.close(hand)

    def test_policy_acts_until_intervention(self) -> None:
        driver, hand = self.keyboard(in_charge=False)
        with driver:
            os.write(hand, b"q")
            assert driver(NOTHING) is None
            os.write(hand, b" ")
            assert driver(NOTHING) is not None
        self.terminal.close()
        os.close(hand)

    def test_keyboard_needs_terminal(self, monkeypatch: pytest.MonkeyPatch) -> None:
        with Path(os.devnull).open() as nothing:
            monkeypatch.setattr(sys, "stdin", nothing)
            with pytest.raises(DataError, match="nobody sits at a terminal"):
                KeyboardDriver([LEG])

    def test_too_many_commands_for_controls_raise(self) -> None:
        with pytest.raises(DataError, match="7 commands are too many"):
            KeyboardDriver([ARM] * 7)


@pytest.mark.skipif(sys.platform == "win32", reason="device files are of POSIX")
class TestGamepad:
    def pad(self, tmp_path: Path) -> tuple[LinuxPad, int]:
        os.mkfifo(tmp_path / "js0")
        pad = LinuxPad(tmp_path / "js0")
        return pad, os.open(tmp_path / "js0", os.O_WRONLY)

    def test_gamepad_controls(self, tmp_path: Path) -> None:
        pad, hand = self.pad(tmp_path)

        def event(value: int, kind: int, number: int) -> None:
            os.write(hand, struct.pack("<IhBB", 1, value, kind, number))

        # as they stand when the device is opened: the second is a trigger
        for axis, position in enumerate((0, -32767, 0)):
            event(position, 0x82, axis)
        with GamepadDriver([LEG, ARM], pad=pad) as driver:
            assert driver(NOTHING).tolist() == [1.0, 0.0]
            event(-32767, 0x02, 0)
            event(16384, 0x02, 2)
            assert driver(NOTHING).tolist() == pytest.approx([-1.0, 0.5], abs=1e-4)
            # sticks stay where they are
            assert driver(NOTHING).tolist() == pytest.approx([-1.0, 0.5], abs=1e-4)
            event(1000, 0x02, 2)  # within the dead zone
            assert driver(NOTHING).tolist() == [-1.0, 0.0]
            event(1, 0x01, 0)
            event(0, 0x01, 0)
            assert driver(NOTHING) is None
            event(1, 0x01, 0)
            assert driver(NOTHING) is not None
        os.close(hand)

    def test_missing_gamepad_raises(self, tmp_path: Path) -> None:
        with pytest.raises(DataError, match="cannot read the gamepad"):
            LinuxPad(tmp_path / "js9")

    def test_missing_pygame_names_package(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, "pygame", None)
        with pytest.raises(DataError, match="pip install pygame"):
            PygamePad()


class PlayedPygame:
    """The used part of pygame, with one gamepad whose trigger is its second axis."""

    JOYAXISMOTION, JOYBUTTONDOWN, JOYDEVICEREMOVED = range(3)
    QUEUE = 100

    def __init__(self) -> None:
        self.display = self.joystick = self.event = self
        self.positions = [0.0, -1.0, 0.0]
        self.queue: list[SimpleNamespace] = []
        self.init = self.quit = self.pump = lambda: None
        self.get_count, self.get_numaxes, self.get_axis = (
            lambda: 1,
            lambda: 3,
            lambda axis: self.positions[axis],
        )
        self.Joystick = lambda number: self

    def post(self, kind: int, **fields: int) -> None:
        if len(self.queue) < self.QUEUE:
            self.queue.append(SimpleNamespace(type=kind, **fields))

    def get(self, kind: int | None = None) -> list[SimpleNamespace]:
        taken = [event for event in self.queue if kind in (None, event.type)]
        self.queue = [event for event in self.queue if event not in taken]
        return taken


def test_pygame_pad_hears_presses_after_long_drive(monkeypatch: pytest.MonkeyPatch) -> None:
    pygame = PlayedPygame()
    monkeypatch.setitem(sys.modules, "pygame", pygame)
    with GamepadDriver([LEG, ARM], pad=PygamePad()) as driver:
        for position in (0.5, -0.5) * PlayedPygame.QUEUE:
            pygame.positions[2] = position
            pygame.post(pygame.JOYAXISMOTION, axis=2)
            assert driver(NOTHING).tolist() == [1.0, position]
        pygame.post(pygame.JOYBUTTONDOWN, button=0)
        assert driver(NOTHING) is None
        pygame.post(pygame.JOYDEVICEREMOVED)
        with pytest.raises(DataError, match="the gamepad is gone"):
            driver(NOTHING)


def test_paced_driver_waits() -> None:
    paced = Paced(lambda _: torch.ones(1), 50.0)
    started = time.monotonic()
    for _ in range(5):
        assert paced(NOTHING) is not None
    assert 0.09 <= time.monotonic() - started < 2.0


@pytest.mark.parametrize("name", list_envs())
def test_robot_that_nobody_touches_stands_still_where_its_task_allows_it(name: str) -> None:
    """As the page about data says: only LineFollow's always rolls, at 40 mm/s."""
    commands = get_task(name).interface.commands
    rest = at_rest([command.entry for command in commands])
    values = [
        command.low + (action + 1.0) / 2.0 * (command.high - command.low)
        for command, action in zip(commands, rest, strict=True)
    ]
    assert values == pytest.approx([40.0 if each.low > 0 else 0.0 for each in commands], abs=1e-6)
    assert any(each.low > 0 for each in commands) is name.startswith("LineFollow")
