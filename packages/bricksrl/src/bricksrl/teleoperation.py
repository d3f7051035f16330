"""Driving by hand with a keyboard, a gamepad or a Controller of LEGO's kits: keys, sticks and
levers as actions of any robot.

A released stick means that no motor moves, which is not the middle of every command's range: the
Walker's legs turn by -100 to 0 degrees. Fully up is the upper end of a command, fully down the
lower one. A gamepad is read from its device file on Linux, and with pygame elsewhere.
"""

from __future__ import annotations

import contextlib
import importlib
import math
import os
import signal
import struct
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, Self

from brickhub.entry import Entry
from brickhub.kits.radio import RealRadio, lego_package
from bricksrl.errors import DataError

if TYPE_CHECKING:
    from prompt_toolkit.input import Input
    from torch import Tensor

KEY_PAIRS = (("q", "a"), ("w", "s"), ("e", "d"), ("r", "f"), ("t", "g"), ("y", "h"))
"""Keys of each command in order: the key that raises it, and the key below that lowers it."""
DISCARD_KEY = "c-h"
"""Backspace, by prompt_toolkit's name for it."""
DEAD_ZONE = 0.1
"""Position below which a stick counts as released, as it does not return to exactly 0."""
TRIGGER_ZONE = 0.9
"""Position beyond which an axis at the start is a trigger, which rests at -1."""
_EVENT = struct.Struct("<IhBB")  # time in ms, value, kind, number: linux/joystick.h
_BUTTON = 0x01
_AXIS = 0x02
_INITIAL = 0x80
_AXIS_MAX = 32767


def at_rest(commands: Sequence[Entry]) -> list[float]:
    """Action ``[m]`` that moves nothing, or as little as possible; 0 for a command of unknown
    range."""
    actions = []
    for command in commands:
        span = command.high - command.low
        action = 0.0
        if math.isfinite(span) and span:
            # The action of the value 0; where the range has no 0, its end that is nearest to it.
            action = -(command.high + command.low) / span
        actions.append(min(max(action, -1.0), 1.0))
    return actions


def pushed(pushes: Sequence[float], rest: Sequence[float]) -> list[float]:
    """Action ``[m]`` for pushes from -1 (fully down) over 0 (released, the action ``rest``) to 1
    (fully up)."""
    actions = []
    for push, resting in zip(pushes, rest, strict=True):
        push = min(max(push, -1.0), 1.0)
        # The way from rest to the end of the range on that side.
        way = 1.0 - resting if push > 0.0 else 1.0 + resting
        actions.append(resting + push * way)
    return actions


def _action(pushes: Sequence[float], rest: Sequence[float]) -> Tensor:
    import torch

    return torch.tensor(pushed(pushes, rest))


def legend(commands: Sequence[Entry]) -> list[str]:
    """Keys and their functions, one line each."""
    lines = []
    for command, (up, down) in zip(commands, KEY_PAIRS, strict=False):
        lines.append(f"{up} / {down}    {command.name} up / down")
    return [*lines, "space    take over, or give back", "Ctrl-C   end"]


class Paced:
    """Driver that limits a simulation to ``rate_hz`` steps per second, so that a human can
    follow."""

    def __init__(
        self,
        driver: Callable[[Tensor], Tensor | None],
        rate_hz: float,
    ) -> None:
        self._driver = driver
        self._period_s = 1.0 / rate_hz
        self._due_s = time.perf_counter()

    def __call__(self, observation: Tensor) -> Tensor | None:
        """Wait for the next period, then call the driver."""
        self._due_s = max(self._due_s + self._period_s, time.perf_counter())
        time.sleep(max(0.0, self._due_s - time.perf_counter()))
        return self._driver(observation)


class KeyboardDriver:
    """Driver by keyboard: each command has a key to raise and one to lower it; a step applies the
    keys since the last step. Raises DataError if the robot has more commands than there are keys,
    or there is no terminal.

    A terminal reports key presses but no releases; a held key repeats. Use it as a context manager:
    inside, keys are read one by one and are not echoed.

    Args:
        commands: commands of the robot.
        in_charge: drive from the start; the space bar toggles between human and policy.
        source: source of the keys; by default the terminal.

    Attributes:
        on_discard: called when Backspace is pressed.
    """

    def __init__(
        self,
        commands: Sequence[Entry],
        *,
        in_charge: bool = True,
        source: Input | None = None,
    ) -> None:
        self.on_discard: Callable[[], None] = lambda: None
        if len(commands) > len(KEY_PAIRS):
            raise DataError(
                f"{len(commands)} commands are too many for the keyboard, which drives "
                f"{len(KEY_PAIRS)}; use the API"
            )
        self.in_charge = in_charge
        self._rest = at_rest(commands)
        self._keys: dict[str, tuple[int, float]] = {}
        for index, (up, down) in enumerate(KEY_PAIRS[: len(commands)]):
            self._keys |= {up: (index, 1.0), down: (index, -1.0)}
        if source is None and (sys.stdin is None or not sys.stdin.isatty()):
            raise DataError(
                "nobody sits at a terminal to press keys; run this in one, or drive with a gamepad"
            )
        from prompt_toolkit.input import create_input

        self._source: Input = create_input() if source is None else source
        self._raw_mode = contextlib.ExitStack()

    def __call__(self, observation: Tensor) -> Tensor | None:
        """Action ``[m]`` of the keys since the last call; ``None`` while the policy is in
        charge."""
        pushes = [0.0] * len(self._rest)
        for press in self._source.read_keys():
            key = str(getattr(press.key, "value", press.key))
            # In raw mode the terminal sends a key, and no signal.
            if key == "c-c":
                signal.raise_signal(signal.SIGINT)
            if key == " ":
                self.in_charge = not self.in_charge
            if key == DISCARD_KEY:
                self.on_discard()
            if key.lower() in self._keys:
                index, push = self._keys[key.lower()]
                pushes[index] = push
        return _action(pushes, self._rest) if self.in_charge else None

    def quiet(self) -> contextlib.AbstractContextManager[None]:
        """A context in which the terminal is restored, for a question and its answer."""
        return self._source.cooked_mode()

    def __enter__(self) -> Self:
        self._raw_mode.enter_context(self._source.raw_mode())
        return self

    def __exit__(self, *_: object) -> None:
        self._raw_mode.close()
        self._source.close()


class Pad(Protocol):
    """Gamepad."""

    def read(self) -> tuple[Sequence[float], int]:
        """Positions of its axes, each in -1..1, always as many, and the number of presses of its
        first button since the last call. Raises DataError if the gamepad was disconnected."""

    def close(self) -> None:
        """Release the gamepad."""


class GamepadDriver(contextlib.AbstractContextManager["GamepadDriver"]):
    """Driver by gamepad: each axis of a stick drives one command, in order; the first button
    toggles between human and policy. Raises DataError if there is no gamepad.

    Args:
        commands: commands of the robot.
        in_charge: drive from the start.
        pad: the gamepad; by default the first one found.
    """

    def __init__(
        self,
        commands: Sequence[Entry],
        *,
        in_charge: bool = True,
        pad: Pad | None = None,
    ) -> None:
        self.in_charge = in_charge
        self._rest = at_rest(commands)
        self._pad = find_pad() if pad is None else pad
        positions, _ = self._pad.read()
        self._sticks = [
            axis for axis, position in enumerate(positions) if abs(position) < TRIGGER_ZONE
        ]

    def __call__(self, observation: Tensor) -> Tensor | None:
        """Action ``[m]``; ``None`` while the policy is in charge. Raises DataError if the gamepad
        was disconnected."""
        positions, presses = self._pad.read()
        if presses % 2:
            self.in_charge = not self.in_charge
        if not self.in_charge:
            return None
        axes = [positions[axis] for axis in self._sticks[: len(self._rest)]]
        pushes = [0.0 if abs(axis) < DEAD_ZONE else axis for axis in axes]
        return _action(pushes + [0.0] * (len(self._rest) - len(axes)), self._rest)

    def __exit__(self, *_: object) -> None:
        self._pad.close()


def find_pad() -> Pad:
    """The first gamepad of this computer. Raises DataError if there is no gamepad, or pygame is not
    installed."""
    devices = sorted(Path("/dev/input").glob("js*")) if Path("/dev/input").is_dir() else []
    return LinuxPad(devices[0]) if devices else PygamePad()


class LinuxPad:
    """Gamepad read from its device file, such as ``/dev/input/js0``."""

    def __init__(self, device: Path) -> None:
        self._device = device
        try:
            self._handle = os.open(device, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
        except OSError as error:
            raise DataError(
                f"cannot read the gamepad {device} ({error.strerror}); see that you may, or plug "
                "in another"
            ) from None
        self._axes: dict[int, float] = {}

    def read(self) -> tuple[list[float], int]:
        presses = 0
        try:
            while data := os.read(self._handle, _EVENT.size):
                _, value, kind, number = _EVENT.unpack(data)
                if kind & ~_INITIAL == _AXIS:
                    self._axes[number] = value / _AXIS_MAX
                elif kind == _BUTTON and number == 0:
                    presses += value
        except BlockingIOError:
            pass
        except (OSError, struct.error):
            raise DataError(
                f"the gamepad {self._device} is gone; plug it in and start again"
            ) from None
        # The driver tells an axis when it moves; the kernel tells all of them at the start.
        count = max(self._axes, default=-1) + 1
        return [self._axes.get(number, 0.0) for number in range(count)], presses

    def close(self) -> None:
        os.close(self._handle)


class PygamePad:
    """Gamepad read with pygame, which must be installed."""

    def __init__(self) -> None:
        try:
            pygame = importlib.import_module("pygame")
        except ImportError:
            raise DataError(
                "no gamepad is here, or nothing to read it with; plug it in, and: pip "
                "install pygame"
            ) from None
        self._pygame = pygame
        # Needed for events, even without a window.
        pygame.display.init()
        pygame.joystick.init()
        if not pygame.joystick.get_count():
            raise DataError("no gamepad is here; plug one in, or drive with the keyboard")
        self._stick = pygame.joystick.Joystick(0)
        self._stick.init()

    def read(self) -> tuple[list[float], int]:
        # Of all kinds: a queue that is full takes no presses.
        events = self._pygame.event.get()
        if any(event.type == self._pygame.JOYDEVICEREMOVED for event in events):
            raise DataError("the gamepad is gone; plug it in and start again")
        axes = [self._stick.get_axis(i) for i in range(self._stick.get_numaxes())]
        presses = 0
        for event in events:
            if event.type == self._pygame.JOYBUTTONDOWN and event.button == 0:
                presses += 1
        return axes, presses

    def close(self) -> None:
        self._pygame.joystick.quit()
        self._pygame.display.quit()


class ControllerPad:
    """The Controller of LEGO's kits: its two levers drive the first two commands, its button takes
    over or gives back. Raises MediumUnavailableError without LEGO's package, DataError if no
    Controller is in reach."""

    def __init__(self) -> None:
        self._lego = lego_package(is_silent=True).Controller()
        # In a thread: in this one the package's event loop would take the signals of Windows.
        RealRadio().run(lambda: self._lego.connect(device_notification_delay=15))
        if not self._lego.connected:
            raise DataError(
                "no Controller of LEGO's kits is in reach; switch it on, and bring it near"
            )
        self._was_pressed = 0

    def read(self) -> tuple[list[float], int]:
        if not self._lego.connected:
            raise DataError("the Controller is gone; switch it on, bring it near, and start again")
        levers = self._lego.sensor
        is_pressed = self._lego.button.state
        presses = int(is_pressed > self._was_pressed)
        self._was_pressed = is_pressed
        return [levers.leftPercent / 100, levers.rightPercent / 100], presses

    def close(self) -> None:
        self._lego.disconnect()


DRIVERS: Mapping[str, Callable[..., Any]] = {
    "keyboard": KeyboardDriver,
    "gamepad": GamepadDriver,
    "controller": lambda commands, **options: GamepadDriver(
        commands, pad=ControllerPad(), **options
    ),
}
"""Drivers by the name of their device."""
