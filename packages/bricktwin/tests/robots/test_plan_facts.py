"""Facts of plans: what each device is, where it looks, and what it moves, by the plans' own
measures."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from bricktwin.plans import ldraw_file
from bricktwin.plans.plan import make_plan
from bricktwin.plans.planned_robot import planned_as_drawn, planned_robot
from bricktwin.robots import plans
from bricktwin.robots.plan_facts import DeviceFacts, PlanFacts, _decoded, _device_facts, facts_of

PLANS = Path(plans.__path__[0])


@cache
def facts(name: str) -> PlanFacts:
    """Facts of one of our plans. The search for where joints end takes long, and has tests of its
    own: here it finds that each joint turns by a right angle to both sides."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bricktwin.plans.planned_robot.stops_deg", lambda design, port: (-90.0, 90.0))
        return facts_of(planned_robot(PLANS / f"{name}.ldr"))


def by_port(devices: Any) -> dict[str, DeviceFacts]:
    return {device.port: device for device in devices}


@pytest.mark.parametrize(
    ("name", "ports", "wheel_mm", "track_mm"),
    [("two_wheeler", ("E", "A"), 56.0, 130.0), ("ev3_driver", ("B", "C"), 56.0, 120.0)],
)
def test_motors_of_wheels_are_on_the_left_and_the_right(
    name: str, ports: tuple[str, str], wheel_mm: float, track_mm: float
) -> None:
    left, right = (by_port(facts(name).motors)[port] for port in ports)
    assert (left.label, right.label) == ("left", "right")
    for motor, side in ((left, 1.0), (right, -1.0)):
        assert (motor.role, motor.wheel_mm) == ("wheel", wheel_mm)
        assert 2000 * motor.wheel_left_m == pytest.approx(side * track_mm)
        # It has no gears, and turns its wheel as often as itself.
        assert (motor.gears, motor.ratio) == ((), 1.0)
        # Its axis goes through the axle, which is where the plan's origin is, to one side.
        assert motor.at_m[0] == motor.at_m[2] == pytest.approx(0.0)
        assert motor.at_m[1] * side > 0.02
        assert motor.axis == pytest.approx((0.0, 1.0 if motor.is_forward else -1.0, 0.0))
        assert motor.stops_deg == motor.way_deg == () and motor.turns_with == ""
    # The motors of the 2Wheeler are mirrored, those of the EV3 driver are not.
    assert right.is_forward and left.is_forward is (name == "ev3_driver")


def test_what_an_arm_moves_turns_by_its_gears_about_its_axis() -> None:
    motors = by_port(facts("robo_arm").motors)
    assert {port: motor.label for port, motor in motors.items()} == {
        "B": "rotation",
        "D": "low",
        "A": "high",
        "E": "grab",
    }
    expected = {
        # The gears, the turns of the output, its place in mm, and about which axis it goes up.
        "B": ((20, 60), 1 / 3, (0, 0, 0), (0, 0, 1)),
        "D": ((12, 36), 1 / 3, (0, 0, 96), (0, 1, 0)),
        "A": ((12, 24), -1 / 2, (0, 0, 208), (0, -1, 0)),
        "E": ((12, 24), -1 / 2, (104, -24, 208), (0, 0, -1)),
    }
    for port, (gears, ratio, place_mm, axis) in expected.items():
        motor = motors[port]
        assert motor.role == "joint" and motor.gears == gears
        assert motor.ratio == pytest.approx(ratio)
        assert [1000 * value for value in motor.at_m] == pytest.approx(place_mm, abs=1e-6)
        assert motor.axis == pytest.approx(axis)
        assert motor.wheel_mm == 0.0
    # Only what turns towards the left about its axis walks or rolls forwards.
    assert {port for port, motor in motors.items() if motor.is_forward} == {"D"}
    assert {motor.way_deg for motor in motors.values()} == {(-90.0, 90.0)}


@pytest.mark.parametrize(
    ("name", "sensors"),
    [
        ("two_wheeler", {"C": ("eyes", "ahead", (32, 0, 24))}),
        ("walker", {"E": ("eyes", "ahead", None)}),
        (
            "ev3_driver",
            {
                "1": ("touch", "ahead", (72, 32, 40)),
                "2": ("gyro", "up", (-64, -40, 80)),
                "3": ("light", "down", (48, 0, 16)),
                "4": ("eyes", "ahead", (56, 0, 40)),
            },
        ),
        ("robo_arm", {}),
    ],
)
def test_sensors_are_known_by_where_they_look(name: str, sensors: dict[str, Any]) -> None:
    found = by_port(facts(name).sensors)
    assert found.keys() == sensors.keys()
    for port, (label, looks, place_mm) in sensors.items():
        assert (found[port].label, found[port].looks) == (label, looks)
        assert (found[port].ratio, found[port].role, found[port].gears) == (0.0, "", ())
        if place_mm is not None:
            assert [1000 * value for value in found[port].at_m] == pytest.approx(place_mm)


@pytest.mark.parametrize(
    ("name", "sides", "place_mm"),
    [
        ("two_wheeler", ("up", "ahead"), (-16, 0, 20)),
        ("robo_arm", ("up", "back"), (-80, 0, 36)),
        ("ev3_driver", ("up", "ahead"), (-40, 0, 80)),
    ],
)
def test_a_hub_is_known_by_its_top_and_its_front(
    name: str, sides: tuple[str, str], place_mm: tuple[float, ...]
) -> None:
    made = facts(name)
    (hub,) = made.hubs
    assert made.hub_sides == hub.sides == sides
    assert [1000 * value for value in hub.at_m] == pytest.approx(place_mm)
    assert (hub.port, hub.label, hub.looks, hub.stops_deg) == ("", None, "", ())
    assert made.is_wired and made.lacks == []


def device(line: str) -> DeviceFacts:
    (placed,) = make_plan(ldraw_file.parse(line, "try.ldr")).parts
    return _device_facts(placed)


@pytest.mark.parametrize(
    ("sine", "is_level"), [(0.0, True), (0.044, True), (0.046, False), (-0.046, False)]
)
def test_a_hub_that_is_a_little_askew_still_has_its_sides(sine: float, is_level: bool) -> None:
    """Up to 2.6 degrees, of which the sine is 0.045."""
    cosine = (1 - sine**2) ** 0.5
    hub = device(f"1 15 0 0 0 {cosine} 0 {sine} 0 1 0 {-sine} 0 {cosine} 67718.dat")
    # It is turned about the vertical, so its top looks up in any case.
    assert hub.sides == (("up", "ahead") if is_level else ("up",))


@pytest.mark.parametrize(
    ("turn_deg_sine", "looks"),
    [(0.0, "back"), (0.59, "back"), (0.61, ""), (0.7072, ""), (0.79, ""), (0.81, "right")],
)
def test_a_sensor_looks_along_an_axis_or_askew(turn_deg_sine: float, looks: str) -> None:
    """Up to 37 degrees, of which the cosine is 0.8."""
    sine = turn_deg_sine
    cosine = (1 - sine**2) ** 0.5
    eyes = device(f"1 15 0 0 0 {cosine} 0 {-sine} 0 1 0 {sine} 0 {cosine} 37316.dat")
    assert eyes.looks == looks or (looks == "right" and eyes.looks == "left")


def test_a_motor_with_stops_keeps_those_and_its_name() -> None:
    lines = [
        "0 !BRICKSRL FIXED",
        "0 !BRICKSRL STOPS -30 45",
        "0 !BRICKSRL PORT A arm",
        "1 15 0 0 0 1 0 0 0 1 0 0 0 1 54696p02.dat",
        "1 15 0 200 0 1 0 0 0 1 0 0 0 1 67718.dat",
    ]
    plan = make_plan(ldraw_file.parse("\n".join(lines), "try.ldr"))
    motor = _device_facts(plan.parts[0])
    assert motor.stops_deg == (-30.0, 45.0) and (motor.port, motor.label) == ("A", "arm")
    assert (motor.line, motor.name) == (4, "spike-medium")
    assert motor.part == "Medium angular motor (54696p02)"


def test_facts_that_were_kept_are_those_that_were_made() -> None:
    for name in ("two_wheeler", "robo_arm"):
        made = facts(name)
        again = _decoded(json.dumps(made).encode())
        assert again == made
        assert all(type(device) is DeviceFacts for device in (*again.hubs, *again.motors))


def test_without_ports_the_motors_get_them_in_the_order_of_their_lines() -> None:
    text = (PLANS / "two_wheeler.ldr").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if "!BRICKSRL PORT" not in line]
    plan = make_plan(ldraw_file.parse("\n".join(lines), "try.ldr"))
    made = facts_of(planned_as_drawn(plan))
    assert not made.is_wired
    assert [motor.port for motor in made.motors] == ["A", "B"]
    assert [motor.label for motor in made.motors] == [None, None]
    assert sorted(motor.wheel_left_m for motor in made.motors) == pytest.approx([-0.065, 0.065])
