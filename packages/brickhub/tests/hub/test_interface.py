"""Commands and channels: names, ranges, units."""

from __future__ import annotations

import dataclasses

import pytest

from brickhub.hub.interface import (
    Channel,
    Command,
    Distance,
    DriveStraight,
    MotorAngle,
    Pitch,
    Roll,
    RunAngle,
    YawRate,
)

COMMANDS: list[Command] = [RunAngle("left", -100, 50, 400), DriveStraight(-100, 50)]
CHANNELS: list[Channel] = [MotorAngle("left"), Pitch(), Roll(), YawRate(), Distance("eyes")]


def test_names() -> None:
    assert [command.name for command in COMMANDS] == ["left", "straight"]
    assert [channel.name for channel in CHANNELS] == [
        "left_angle",
        "pitch",
        "roll",
        "yaw_rate",
        "distance",
    ]
    assert [channel.unit for channel in CHANNELS] == ["deg", "deg", "deg", "deg/s", "mm"]


def test_command_ranges_have_units() -> None:
    assert {(command.low, command.high) for command in COMMANDS} == {(-100, 50)}


@pytest.mark.parametrize("item", [*COMMANDS, *CHANNELS])
def test_every_range_fits_an_int16(item: Command | Channel) -> None:
    assert item.low < item.high
    assert item.low * item.scale > -(2**15) and item.high * item.scale < 2**15


@pytest.mark.parametrize(
    ("low", "high", "wraps"), [(0, 360, True), (0, 359, False), (-180, 180, False), (10, 70, False)]
)
def test_full_turn_angles_wrap(low: float, high: float, wraps: bool) -> None:
    assert MotorAngle("left", low, high).wraps is wraps
    assert MotorAngle("left").wraps


@pytest.mark.parametrize("item", [*COMMANDS, *CHANNELS])
def test_interfaces_are_values(item: Command | Channel) -> None:
    assert item == dataclasses.replace(item)
    assert hash(item) == hash(dataclasses.replace(item))
    with pytest.raises(dataclasses.FrozenInstanceError):
        item.low = 0  # type: ignore[misc, union-attr]


def test_nominal_range_is_exceeded_as_far_as_the_wire_goes() -> None:
    """What reads more than its nominal range still fits the 16 bits, at the channel's scale."""
    for channel in CHANNELS:
        if channel.limits is None:
            continue
        low, high = channel.limits
        assert low == -high and high >= channel.high
        assert high * channel.scale == pytest.approx(2**15, rel=1e-3)
    scales = {channel.scale for channel in CHANNELS if channel.limits is not None}
    assert scales - {1}, "one of them has a scale"
