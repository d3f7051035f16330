"""Kinds of commands and channels: base classes of the numbers between a hub and this computer.

A kind is one frozen dataclass, in ``interface.py`` or in a file of the user's own: it says what it needs of a robot, how it is
written in the hub program, and what its numbers are. All values are in the units of their names.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from bricksrl.entry import Entry
from bricksrl.robots import Robot

WIRE_MAX = 2**15 - 1
"""The largest number of the wire, an int16."""

Imports = tuple[tuple[str, str], ...]
"""Modules, and a name in each, that a hub program imports."""


class _Number:
    """A number of the wire.

    Attributes:
        low, high: range, in the unit; a hub clamps commands to it.
        scale: the number times this goes over the wire.
        imports: names that the hub program needs for it, beside hub, ports and devices.
    """

    scale: ClassVar[int] = 10
    imports: ClassVar[Imports] = ()

    if TYPE_CHECKING:  # fields, properties or constants of each kind

        @property
        def name(self) -> str: ...

        @property
        def low(self) -> float: ...

        @property
        def high(self) -> float: ...

        @property
        def unit(self) -> str: ...

    @property
    def entry(self) -> Entry:
        """Its name, range and unit."""
        return Entry(self.name, self.low, self.high, self.unit)


@dataclass(frozen=True)
class Command(_Number, ABC):
    """A number that the hub is sent at every step, and what it does with it.

    Attributes:
        mover: the moving object on the hub, which can be asked whether it is ``done()`` and told to ``stop()``; ``None`` for a
            light or a sound.
        ends: whether the move ends by itself, so that a step may wait for it.
        call: commands with the same one are the arguments of one call on the hub; ``None`` for a call of its own.
    """

    ends: ClassVar[bool] = True
    call: ClassVar[str | None] = None

    if TYPE_CHECKING:

        @property
        def mover(self) -> str | None: ...

    @abstractmethod
    def check(self, robot: Robot) -> None:
        """Raise DescriptionError unless the robot can carry it out."""

    @abstractmethod
    def motors(self, robot: Robot) -> tuple[str, ...]:
        """Names of the motors that it turns."""

    @abstractmethod
    def turns_deg(self, robot: Robot, amount: float) -> tuple[float, ...]:
        """Angle that each of its motors turns by; of a move that goes on, what it turns by in a second at least."""

    @property
    @abstractmethod
    def text(self) -> str:
        """Its meaning, for the top of the hub program."""

    def setup(self, robot: Robot) -> tuple[str, ...]:
        """Statements of the hub program that make the mover, after the motors; there once, however many commands have them."""
        return ()

    @abstractmethod
    def start(self, robot: Robot, amount: str) -> str:
        """Statement of the hub program that starts the move, without waiting for its end; ``amount`` is an expression."""

    def start_all(self, robot: Robot, amounts: Mapping[str, str]) -> str:
        """Statement that starts all commands of one ``call``: expressions of their amounts by their names."""
        return self.start(robot, amounts[self.name])


@dataclass(frozen=True)
class Channel(_Number, ABC):
    """A number that the hub reports at every step.

    Attributes:
        noise, noise_share: parameters of the twin's physics: the standard deviation of its noise, and what comes on top as a
            share of the value.
        roughness: difference between a robot and its twin, in the unit, that means nothing: rounding, how a tick falls.
    """

    noise: ClassVar[str | None] = None
    noise_share: ClassVar[str | None] = None
    roughness: ClassVar[float] = 1.0

    @property
    def device(self) -> str | None:
        """Name of the motor or sensor that it reads; ``None`` for the hub itself."""
        return None

    def devices(self, robot: Robot) -> tuple[str, ...]:
        """Names of the motors and sensors that the hub program needs for it."""
        return () if self.device is None else (self.device,)

    @property
    def wraps(self) -> bool:
        """An angle that runs around from 360 to 0."""
        return False

    @property
    def limits(self) -> tuple[float, float] | None:
        """Ends of what can occur, where the range is only nominal."""
        return None

    @property
    def entry(self) -> Entry:
        return Entry(self.name, self.low, self.high, self.unit, self.limits, self.wraps)

    @abstractmethod
    def check(self, robot: Robot) -> None:
        """Raise DescriptionError unless the robot has what it reads."""

    def setup(self, robot: Robot) -> tuple[str, ...]:
        """Statements of the hub program that make what it reads, after the motors; there once, as those of commands."""
        return ()

    @property
    def statement(self) -> str | None:
        """Line of the hub program before all channels are read, such as a call that gives several numbers.

        It is there once, however many channels have it.
        """
        return None

    @property
    @abstractmethod
    def expression(self) -> str:
        """Its value in the hub program, in its unit: an expression of ``hub``, ``motor_NAME`` and ``sensor_NAME``."""
