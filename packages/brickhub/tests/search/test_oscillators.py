"""Oscillators for legs that turn endlessly."""

from __future__ import annotations

import math
from typing import Any

import pytest

from brickhub.errors import DescriptionError
from brickhub.hub.interface import (
    Interface,
    MotorAngle,
    RunAngle,
    RunDuty,
    RunSpeed,
    TrackTarget,
    UntilDone,
    Wait,
)
from brickhub.robot import Direction, HubKind, Motor, Robot
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


LEFT, RIGHT, BACK = Motor("left", "A"), Motor("right", "B"), Motor("back", "C")
OTHER_WAY = Motor("right", "B", direction=Direction.COUNTERCLOCKWISE)
TAIL = Motor("tail", "D")


def crawler(right: Motor = RIGHT) -> Robot:
    """Two legs that are mirror images, one in the middle, and one beside."""
    motors = (LEFT, right, BACK, TAIL)
    return Robot("crawler", HubKind.PRIME, motors, mirrored=(("left", "right"), ("back", "back")))


def angles_of(*names: str) -> tuple[MotorAngle, ...]:
    return tuple(map(MotorAngle, names))


@pytest.mark.parametrize(
    ("command", "settle", "steps", "turn_deg"),
    [
        # What an action of 1 turns further than one of 0, in a step.
        (RunSpeed("left", -600, 600), Wait(250), 1, 150.0),
        (RunSpeed("left", -200, 600), Wait(100), 1, 40.0),
        (RunSpeed("left", -600, 600), Wait(250), 3, 450.0),
        (RunSpeed("left", -600, 600), UntilDone(), 1, 600.0),
        (RunAngle("left", -100, 100, speed_deg_s=600), Wait(250), 1, 100.0),
        (RunAngle("left", -20, 100, speed_deg_s=600), Wait(250), 2, 120.0),
    ],
)
def test_a_leg_ahead_by_what_an_action_turns_is_held_back_by_it(
    command: RunSpeed | RunAngle, settle: Any, steps: int, turn_deg: float
) -> None:
    robot = Robot("one", HubKind.PRIME, (LEFT,))
    found = oscillators(robot, Interface((command,), angles_of("left"), settle), steps=steps)
    (leg,) = found.legs
    assert leg.gain * turn_deg == pytest.approx(1.0)


@pytest.mark.parametrize(("right", "sign"), [(OTHER_WAY, 1), (RIGHT, -1)])
def test_mirror_images_lag_by_half_a_turn_and_the_hub_computes_the_same(
    right: Motor, sign: int
) -> None:
    names = ("tail", "right", "back", "left")
    interface = Interface(
        tuple(RunSpeed(name, -360, 360) for name in names), angles_of(*reversed(names)), Wait(500)
    )
    found = oscillators(crawler(right), interface)
    # The pair comes first; then each leg of its own has a phase.
    legs = [(leg.angle, leg.action, leg.sign, leg.half_turn_deg, leg.place) for leg in found.legs]
    assert legs[:2] == [(0, 3, 1, 0.0, 0), (2, 1, sign, 180.0, 0)]
    assert sorted(legs[2:]) == [(1, 2, 1, 0.0, 2), (3, 0, 1, 0.0, 1)]
    speed, *phases = found.numbers
    assert (speed.name, speed.low, speed.high) == ("speed", -1.0, 1.0)
    assert [(one.name, one.low, one.high, one.wraps) for one in phases] == [
        ("tail_phase", 0.0, 360.0, True),
        ("back_phase", 0.0, 360.0, True),
    ]
    on_hub: dict[str, Any] = {"umath": math}
    exec(found.hub_source().replace("import umath", ""), on_hub)  # noqa: S102  our own program
    numbers = (0.25, 90.0, 200.0)
    # All at their phases, wherever the first one is: they turn at one speed.
    for start_deg in (0.0, 130.0):
        at_phase = [
            start_deg,
            (start_deg + 200.0) % 360.0,
            sign * (start_deg + 180.0) % 360.0,
            start_deg + 90.0,
        ]
        wanted = [0.25, sign * 0.25, 0.25, 0.25]
        assert found.act(at_phase, numbers) == pytest.approx(wanted)
        assert on_hub["act_by"](at_phase, numbers) == pytest.approx(wanted, abs=1e-4)
    # The back leg is 12 degrees ahead of the others: each is off the mean by a part of it, and an
    # action of 1 turns by 180 degrees.
    at_phase[1] += 12.0
    actions = found.act(at_phase, numbers)
    assert actions[2] < 0.25 < actions[0] == actions[3]
    assert actions[0] - actions[2] == pytest.approx(12.0 / 180.0)
    assert on_hub["act_by"](at_phase, numbers) == pytest.approx(actions, abs=1e-4)


def test_motors_that_are_no_legs_do_nothing() -> None:
    interface = Interface(
        (RunSpeed("left", -360, 360), TrackTarget("back", -40, 40), RunSpeed("right", -360, 360)),
        angles_of("left", "right", "back"),
        Wait(500),
    )
    found = oscillators(crawler(), interface)
    assert [leg.action for leg in found.legs] == [0, 2]
    assert found.act([0.0, 180.0, 33.0], [1.0])[1] == 0.0 and found.size == 3
    # Nor does one whose angle is not observed, or of which nothing is known but its voltage.
    with pytest.raises(DescriptionError, match="need motors that turn endlessly"):
        oscillators(crawler(), Interface(interface.commands, angles_of("left"), Wait(500)))
    duties = (RunDuty("left"), RunDuty("right"))
    with pytest.raises(DescriptionError, match="need motors that turn endlessly"):
        oscillators(crawler(), Interface(duties, angles_of("left", "right"), Wait(500)))


def test_a_mirror_image_whose_angle_is_not_observed_leaves_a_leg_of_its_own() -> None:
    interface = Interface(
        (RunSpeed("left", -360, 360), RunSpeed("back", -360, 360), RunSpeed("right", -360, 360)),
        angles_of("left", "back"),
        Wait(500),
    )
    found = oscillators(crawler(), interface)
    assert [(leg.angle, leg.half_turn_deg, leg.place) for leg in found.legs] == [
        (0, 0.0, 0),
        (1, 0.0, 1),
    ]
    # Where an angle is elsewhere in an observation, it is read there.
    moved = oscillators(crawler(), interface, angles={"left_angle": 7, "back_angle": 9})
    assert [leg.angle for leg in moved.legs] == [7, 9]
