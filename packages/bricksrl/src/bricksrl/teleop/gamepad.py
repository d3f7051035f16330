"""Gamepad as a driver of a robot: read from its device file on Linux, and with pygame elsewhere."""

from __future__ import annotations

import importlib
import os
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol, Self

import torch
from torch import Tensor

from brickhub.entry import Entry
from bricksrl.errors import DataError
from bricksrl.teleop.mapping import push_action, rest_action

DEAD_ZONE, TRIGGER_ZONE = 0.1, 0.9
"""Released sticks do not return to exactly 0; an axis that is beyond the second at the start is a trigger, which rests at -1."""
_EVENT = struct.Struct("<IhBB")  # time in ms, value, kind, number: linux/joystick.h
_BUTTON, _AXIS, _INITIAL = 0x01, 0x02, 0x80
_AXIS_MAX = 32767


class Pad(Protocol):
    """Gamepad."""

    def axes(self) -> Sequence[float]:
        """Positions of its axes, each in -1..1, always as many."""

    def presses(self) -> int:
        """Number of presses of its first button since the last call."""

    def close(self) -> None:
        """Release the gamepad."""


class GamepadDriver:
    """Driver by gamepad: each axis of a stick drives one command, in order; the first button toggles between human and policy.
    Raises DataError if there is no gamepad.

    Args:
        commands: commands of the robot.
        in_charge: drive from the start.
        pad: the gamepad; by default the first one found.
    """

    def __init__(self, commands: Sequence[Entry], *, in_charge: bool = True, pad: Pad | None = None) -> None:
        self.in_charge = in_charge
        self._rest = rest_action(commands)
        self._pad = find_pad() if pad is None else pad
        self._sticks = [axis for axis, position in enumerate(self._pad.axes()) if abs(position) < TRIGGER_ZONE]

    def __call__(self, observation: Tensor) -> Tensor | None:
        """Action ``[m]``; ``None`` while the policy is in charge. Raises DataError if the gamepad was disconnected."""
        if self._pad.presses() % 2:
            self.in_charge = not self.in_charge
        if not self.in_charge:
            return None
        pushes = torch.zeros_like(self._rest)
        positions = self._pad.axes()
        axes = torch.tensor([positions[axis] for axis in self._sticks[: len(pushes)]])
        pushes[: len(axes)] = torch.where(axes.abs() < DEAD_ZONE, 0.0, axes)
        return push_action(pushes, self._rest)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._pad.close()


def find_pad() -> Pad:
    """The first gamepad of this computer. Raises DataError if there is no gamepad, or pygame is not installed."""
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
                f"cannot read the gamepad {device} ({error.strerror}); see that you may, or plug in another"
            ) from None
        self._axes: dict[int, float] = {}
        self._presses = 0

    def _read(self) -> None:
        try:
            while data := os.read(self._handle, _EVENT.size):
                _, value, kind, number = _EVENT.unpack(data)
                if kind & ~_INITIAL == _AXIS:
                    self._axes[number] = value / _AXIS_MAX
                elif kind == _BUTTON and number == 0:
                    self._presses += value
        except BlockingIOError:
            return
        except (OSError, struct.error):
            raise DataError(f"the gamepad {self._device} is gone; plug it in and start again") from None

    def axes(self) -> list[float]:
        self._read()
        return [self._axes.get(number, 0.0) for number in range(max(self._axes, default=-1) + 1)]

    def presses(self) -> int:
        self._read()
        presses, self._presses = self._presses, 0
        return presses

    def close(self) -> None:
        os.close(self._handle)


class PygamePad:
    """Gamepad read with pygame, which must be installed."""

    def __init__(self) -> None:
        try:
            pygame = importlib.import_module("pygame")
        except ImportError:
            raise DataError("no gamepad is here, or nothing to read it with; plug it in, and: pip install pygame") from None
        self._pygame = pygame
        pygame.display.init()  # needed for events, even without a window
        pygame.joystick.init()
        if not pygame.joystick.get_count():
            raise DataError("no gamepad is here; plug one in, or drive with the keyboard")
        self._stick = pygame.joystick.Joystick(0)
        self._stick.init()

    def axes(self) -> list[float]:
        self._pygame.event.pump()
        return [self._stick.get_axis(i) for i in range(self._stick.get_numaxes())]

    def presses(self) -> int:
        events = self._pygame.event.get()  # of all kinds: a full queue takes no presses
        if any(event.type == self._pygame.JOYDEVICEREMOVED for event in events):
            raise DataError("the gamepad is gone; plug it in and start again")
        return sum(event.type == self._pygame.JOYBUTTONDOWN and event.button == 0 for event in events)

    def close(self) -> None:
        self._pygame.joystick.quit()
        self._pygame.display.quit()
