"""Numbers that robots tell one another over the air, from hub to hub: commands that a hub
broadcasts, and channels that it has observed.

The numbers of a robot go to its hub with its other commands; the hub broadcasts them as one tuple
by `BLERadio` of Pybricks 4, and another hub that has heard them answers them with its other
channels. They are in -1..1, in hundredths, so that each takes two of the 26 bytes of a broadcast.
A hub repeats its broadcast about ten times a second; what was heard counts for a second.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from brickhub.errors import DescriptionError, an
from brickhub.hub.commands import Command, Imports
from brickhub.hub.interface import Channel
from brickhub.hub.protocol import MAX_ACTIONS
from brickhub.robot import Robot

HUNDREDTHS = 100
"""What a number is on the wire and in the air: from -1..1 to a whole number of one byte."""
_LAST_CHANNEL = 255
"""Channels are 0 to 255 (``pb_type_ble_radio.c`` of Pybricks 4)."""
_IMPORTS: Imports = (("pybricks.messaging", "BLERadio"),)


@dataclass(frozen=True)
class Exchange:
    """Who tells whom how many numbers, as one of the robots takes part. Raises DescriptionError if
    a channel is out of range or named twice, or there are too many numbers.

    Attributes:
        own: channel on which the robot tells.
        others: channels to which it listens.
        numbers: count of what each robot tells.
    """

    own: int
    others: tuple[int, ...]
    numbers: int

    def __post_init__(self) -> None:
        channels = (self.own, *self.others)
        in_range = all(0 <= channel <= _LAST_CHANNEL for channel in channels)
        if not in_range or len(set(channels)) < len(channels):
            raise DescriptionError(
                f"robots tell one another numbers on the channels {', '.join(map(str, channels))}; "
                f"give each robot one of its own, from 0 to {_LAST_CHANNEL}"
            )
        if not 1 <= self.numbers <= MAX_ACTIONS:
            raise DescriptionError(
                f"each robot tells {self.numbers} numbers; give 1 to {MAX_ACTIONS}, which fit one "
                "write with the other commands"
            )

    @property
    def commands(self) -> tuple[TellNumber, ...]:
        """The numbers that the robot tells."""
        return tuple(TellNumber(self, index) for index in range(self.numbers))

    @property
    def channels(self) -> tuple[HeardNumber, ...]:
        """The numbers that the robot hears: all of the first other one, then of the next."""
        heard = []
        for channel in self.others:
            heard += [HeardNumber(self, channel, index) for index in range(self.numbers)]
        return tuple(heard)

    def check(self, robot: Robot) -> None:
        """Raise DescriptionError if the robot's hub has no Bluetooth."""
        if not robot.hub.model.has_bluetooth:
            raise DescriptionError(
                f"{an(robot.hub.value)} hub tells other hubs nothing, as it has no Bluetooth Low "
                "Energy; choose another hub"
            )

    def setup(self) -> tuple[str, ...]:
        """Statements of the hub program that make its radio."""
        kinds = f"[int] * {self.numbers}"
        return (
            f"radio = BLERadio(broadcast_channel={self.own}, observe_channels={list(self.others)})",
            "",
            "",
            "def heard(channel):",
            '    """What another hub tells, in hundredths; zeros if nothing was heard for 1 s."""',
            "    told = radio.observe(channel)",
            # Others in the room may use the channel for something else.
            f"    if type(told) != tuple or [type(number) for number in told] != {kinds}:",
            f"        return (0,) * {self.numbers}",
            f"    return [max(-{HUNDREDTHS}, min({HUNDREDTHS}, number)) for number in told]",
            "",
        )


@dataclass(frozen=True)
class TellNumber(Command):
    """Number in -1..1 that the hub broadcasts until the next step. ``index``: which of those that
    the robot tells."""

    exchange: Exchange
    index: int
    low: ClassVar[float] = -1.0
    high: ClassVar[float] = 1.0
    scale: ClassVar[int] = HUNDREDTHS
    unit: ClassVar[str] = ""
    imports: ClassVar[Imports] = _IMPORTS
    mirror_sign: ClassVar[int] = 0
    is_whole: ClassVar[bool] = False
    call: ClassVar[str] = "tell"
    description: ClassVar[str] = "tell the other robots {0.low:g} to {0.high:g}"

    @property
    def name(self) -> str:
        return f"tell_{self.index + 1}"

    def check(self, robot: Robot) -> None:
        self.exchange.check(robot)

    def setup(self, robot: Robot) -> tuple[str, ...]:
        return self.exchange.setup()

    def start(self, robot: Robot, amounts: Mapping[str, str]) -> str:
        # Others hear as many numbers as they expect, or nothing; one that is no command is 0.
        numbers = [amounts.get(number.name, "0") for number in self.exchange.commands]
        return f"radio.broadcast([{', '.join(numbers)}])"


@dataclass(frozen=True)
class HeardNumber(Channel):
    """Number in -1..1 that another hub told last; 0 if nothing of it was heard for a second.

    Attributes:
        channel: that of the other hub.
        index: which of the numbers that it tells.
    """

    exchange: Exchange
    channel: int
    index: int
    low: ClassVar[float] = -1.0
    high: ClassVar[float] = 1.0
    scale: ClassVar[int] = HUNDREDTHS
    unit: ClassVar[str] = ""
    imports: ClassVar[Imports] = _IMPORTS
    mirror_sign: ClassVar[int] = 0
    roughness: ClassVar[float] = 0.01

    @property
    def name(self) -> str:
        return f"heard_{self.channel}_{self.index + 1}"

    def check(self, robot: Robot) -> None:
        self.exchange.check(robot)

    def setup(self, robot: Robot) -> tuple[str, ...]:
        return self.exchange.setup()

    @property
    def statement(self) -> str:
        # All numbers of a hub are those of one message.
        return f"heard_{self.channel} = heard({self.channel})"

    @property
    def expression(self) -> str:
        return f"heard_{self.channel}[{self.index}] / {HUNDREDTHS}"
