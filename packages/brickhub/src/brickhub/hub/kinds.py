"""Kinds of commands and channels: base classes of the numbers between a hub and this computer.

A kind is one frozen dataclass, in ``interface.py`` or in a user's file: it defines its requirements on a robot, its code in the
hub program, and its range, unit and scale. All values are in the units of their names.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from brickhub.entry import Entry
from brickhub.robot import Robot

WIRE_MAX = 2**15 - 1
"""Largest number on the wire, an int16."""

Imports = tuple[tuple[str, str], ...]
"""Pairs of a module and a name that a hub program imports from it."""


class _Number:
    """Number on the wire.

    Attributes:
        low, high: range in its unit; the hub clamps commands to it.
        scale: factor from the number to its fixed-point value on the wire.
        imports: names that the hub program imports for it, besides hub, ports and devices.
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
        """Name, range and unit."""
        return Entry(self.name, self.low, self.high, self.unit)


@dataclass(frozen=True)
class Command(_Number, ABC):
    """Number that is sent to the hub at every step, and its effect.

    Attributes:
        mover: moving object in the hub program, with the methods ``done()`` and ``stop()``; ``None`` for a light or a sound.
        ends: whether the move ends by itself, so that a step may wait for it.
        call: commands with the same ``call`` are the arguments of one call on the hub; ``None`` for a separate call.
        description: for the header of the hub program; a format of the command.
        code: statement that starts the move; a format of the command and the expression of its value. See `start`.
    """

    description: ClassVar[str] = "{0.low:g} to {0.high:g} {0.unit}"
    code: ClassVar[str]
    ends: ClassVar[bool] = True
    call: ClassVar[str | None] = None

    if TYPE_CHECKING:

        @property
        def mover(self) -> str | None: ...

    @abstractmethod
    def check(self, robot: Robot) -> None:
        """Raise DescriptionError unless the robot supports the command."""

    @abstractmethod
    def motors(self, robot: Robot) -> tuple[str, ...]:
        """Names of the motors that the command turns."""

    @abstractmethod
    def turns_deg(self, robot: Robot, amount: float) -> tuple[float, ...]:
        """Angle that each of its motors turns by; for an endless move, at least in one second."""

    def setup(self, robot: Robot) -> tuple[str, ...]:
        """Statements of the hub program that make the mover, after the motors; equal ones of several commands occur once."""
        return ()

    def start(self, robot: Robot, amount: str) -> str:
        """Statement of the hub program that starts the move, without waiting for its end; ``amount`` is an expression."""
        return self.code.format(self, amount)

    def start_all(self, robot: Robot, amounts: Mapping[str, str]) -> str:
        """Statement that starts all commands of one ``call``; ``amounts`` are expressions by command name."""
        return self.start(robot, amounts[self.name])


@dataclass(frozen=True)
class Channel(_Number, ABC):
    """Number that the hub reports at every step.

    Attributes:
        is_nominal: whether values beyond ``low`` and ``high`` are possible, up to the limits of the wire.
        noise, noise_share: names of the twin's physics parameters for its noise: the standard deviation, and an additional one as
            a share of the value.
        roughness: insignificant difference between a robot and its twin, in the unit, due to rounding and clock ticks.
    """

    is_nominal: ClassVar[bool] = False
    noise: ClassVar[str | None] = None
    noise_share: ClassVar[str | None] = None
    roughness: ClassVar[float] = 1.0

    @property
    def device(self) -> str | None:
        """Name of the motor or sensor that the channel reads; ``None`` for the hub itself."""
        return None

    def devices(self, robot: Robot) -> tuple[str, ...]:
        """Names of the motors and sensors that the hub program needs for the channel."""
        return () if self.device is None else (self.device,)

    @property
    def wraps(self) -> bool:
        """True for an angle that wraps from 360 to 0."""
        return False

    @property
    def limits(self) -> tuple[float, float] | None:
        """Possible range, if ``low`` and ``high`` are only nominal."""
        return (-WIRE_MAX / self.scale, WIRE_MAX / self.scale) if self.is_nominal else None

    @property
    def entry(self) -> Entry:
        return Entry(self.name, self.low, self.high, self.unit, self.limits, self.wraps)

    @abstractmethod
    def check(self, robot: Robot) -> None:
        """Raise DescriptionError unless the robot supports the channel."""

    def setup(self, robot: Robot) -> tuple[str, ...]:
        """Statements of the hub program that make the object to read, after the motors; equal ones occur once."""
        return ()

    @property
    def statement(self) -> str | None:
        """Line of the hub program before all channels are read, such as a call that returns several numbers.

        Equal lines of several channels occur once.
        """
        return None

    @property
    @abstractmethod
    def expression(self) -> str:
        """Expression of the value in the hub program, in its unit, from ``hub``, ``motor_NAME`` and ``sensor_NAME``."""
