"""Oscillators for legs that turn endlessly."""

from __future__ import annotations

import pytest

from brickhub.errors import DescriptionError
from brickhub.hub.interface import Interface, MotorAngle, RunAngle, TrackTarget, Wait
from brickhub.robot import HubKind, Motor, Robot
from brickhub.search.oscillators import oscillators

CRAB = Robot("crab", HubKind.TECHNIC, motors=(Motor("legs", "A"), Motor("claw", "B")))


def test_one_motor_that_turns_all_legs_needs_only_a_speed() -> None:
    interface = Interface(
        (RunAngle("legs", -100, 100, speed_deg_s=600),),
        (MotorAngle("legs"),),
        Wait(250),
    )
    found = oscillators(CRAB, interface)
    assert [entry.name for entry in found.numbers] == ["speed"]
    for angle_deg in (0.0, 123.0, 359.0):
        assert found.act([angle_deg], [0.5]) == pytest.approx([0.5])


def test_without_a_motor_that_turns_endlessly_there_are_none() -> None:
    interface = Interface(
        (RunAngle("legs", -100, 100, speed_deg_s=600),),
        (),
        Wait(250),
    )
    with pytest.raises(DescriptionError, match="need motors that turn endlessly"):
        oscillators(CRAB, interface)


def test_one_motor_beside_others_is_a_turntable_and_no_leg() -> None:
    interface = Interface(
        (
            RunAngle("legs", -100, 100, speed_deg_s=600),
            TrackTarget("claw", -40, 40),
        ),
        (MotorAngle("legs"),),
        Wait(250),
    )
    with pytest.raises(DescriptionError, match="need motors that turn endlessly"):
        oscillators(CRAB, interface)
