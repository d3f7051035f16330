"""Following of an edge: on a computer and on a hub."""

from __future__ import annotations

import math
from typing import Any

import pytest

from brickhub.errors import DescriptionError
from brickhub.hub.commands import DriveSpeed, DriveTurnRate
from brickhub.hub.interface import Interface, SensorReading, Wait, YawRate
from brickhub.robot import HubKind, PoweredUpSensor, Robot, SensorKind
from brickhub.robot.line_edge import LINE_EDGES, LineEdge, edge_of
from brickhub.search.edge import edge_following

LIGHT = SensorReading("light", "reflection", 0, 100, "%")


def test_the_turn_is_in_proportion_to_the_brightness_and_the_hub_computes_the_same() -> None:
    commands = (DriveSpeed(0, 200), DriveTurnRate(-100, 100))
    following = edge_following(Interface(commands, (LIGHT,), Wait(50)), 40.0)
    wanted = {40.0: 0.0, 60.0: 0.4, 30.0: -0.2, 100.0: 1.0, 0.0: -0.8}
    on_hub: dict[str, Any] = {"umath": math}
    source = following.hub_source().replace("import umath", "")
    exec(source, on_hub)  # noqa: S102  our own program
    for reflection_pct, turn in wanted.items():
        actions = [pytest.approx(-0.5), pytest.approx(turn)]
        assert following.act([reflection_pct], (50.0, 2.0)) == actions
        assert on_hub["act_by"]([reflection_pct], (50.0, 2.0)) == actions


def test_who_observes_its_turning_turns_less_the_faster_it_already_does() -> None:
    commands = (DriveSpeed(0, 200), DriveTurnRate(-100, 100))
    following = edge_following(Interface(commands, (LIGHT, YawRate()), Wait(50)), 40.0)
    assert [number.name for number in following.numbers] == ["speed", "gain", "damping"]
    on_hub: dict[str, Any] = {"umath": math}
    exec(following.hub_source().replace("import umath", ""), on_hub)  # noqa: S102  our own program
    # Brighter by 10 %: to the right by 20 deg/s, less half of the 30 that it turns to the right.
    for yaw_deg_s, turn in ((0.0, 0.2), (-30.0, 0.05), (30.0, 0.35)):
        actions = [pytest.approx(-0.5), pytest.approx(turn)]
        assert following.act([50.0, yaw_deg_s], (50.0, 2.0, 0.5)) == actions
        assert on_hub["act_by"]([50.0, yaw_deg_s], (50.0, 2.0, 0.5)) == actions


def test_speeds_of_any_range_are_shares_of_it() -> None:
    commands = (DriveSpeed(-100, -40), DriveTurnRate(-45, 45))
    following = edge_following(Interface(commands, (LIGHT,), Wait(50)), 40.0)
    on_hub: dict[str, Any] = {"umath": math}
    exec(following.hub_source().replace("import umath", ""), on_hub)  # noqa: S102  our own program
    for speed_mm_s, share in ((-100.0, -1.0), (-70.0, 0.0), (-40.0, 1.0)):
        assert following.act([40.0], (speed_mm_s, 1.0)) == [share, 0.0]
        assert on_hub["act_by"]([40.0], (speed_mm_s, 1.0)) == [share, 0.0]


@pytest.mark.parametrize(
    ("side", "range_"),
    [("left", (0.0, 5.0)), ("right", (-5.0, 0.0)), (None, (-5.0, 5.0))],
)
def test_only_turns_towards_an_edge_that_is_known_are_tried(
    side: Any, range_: tuple[float, float]
) -> None:
    commands = (DriveSpeed(40, 100), DriveTurnRate(-45, 45))
    speed, gain = edge_following(Interface(commands, (LIGHT,), Wait(50)), 40.0, side).numbers
    assert (speed.low, speed.high) == (40.0, 100.0)
    assert (gain.low, gain.high) == range_


@pytest.mark.parametrize(
    "commands",
    [(DriveSpeed(0, 200),), (DriveSpeed(0, 200), DriveTurnRate(-50, 100))],
)
def test_other_commands_are_refused(commands: tuple[DriveSpeed | DriveTurnRate, ...]) -> None:
    with pytest.raises(DescriptionError, match="a turn rate to both sides"):
        edge_following(Interface(commands, (LIGHT,), Wait(50)), 40.0)


def test_who_reads_no_reflection_first_follows_no_edge() -> None:
    commands = (DriveSpeed(0, 200), DriveTurnRate(-100, 100))
    for channels in ((YawRate(), LIGHT), (SensorReading("light", "ambient", 0, 100, "%"),)):
        with pytest.raises(DescriptionError, match="observes a reflection first"):
            edge_following(Interface(commands, channels, Wait(50)), 40.0)


def test_an_edge_is_halfway_between_line_and_floor_and_bare_just_before_either() -> None:
    edge = LineEdge(10.0, 70.0)
    assert edge.edge_pct == 40.0
    # What is bare of the line, or of the floor, differs from both by no more than noise.
    assert 70.0 - 5.0 < edge.edge_pct + edge.bare_pct < 70.0
    assert 10.0 < edge.edge_pct - edge.bare_pct < 10.0 + 5.0
    for kind, found in LINE_EDGES.items():
        light = PoweredUpSensor("light", "3" if kind is SensorKind.EV3_COLOR else "C", kind)
        hub = HubKind.EV3 if kind is SensorKind.EV3_COLOR else HubKind.PRIME
        robot = Robot("r", hub, sensors=(light,))
        assert edge_of(robot) is found and 0 < found.line_pct < 10 < 60 < found.floor_pct < 100
        with pytest.raises(DescriptionError, match="no sensor 'eye'"):
            edge_of(robot, "eye")
