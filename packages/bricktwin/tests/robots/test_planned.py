"""Descriptions completed by plans."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from brickhub.errors import DescriptionError, PlanError
from brickhub.robot import Direction, DriveBase, HubKind, Motor, MotorKind, Robot, UltrasonicSensor
from brickhub.target import whole_interface
from bricktwin.robots import ROBO_ARM, TWO_WHEELER, WALKER, plans
from bricktwin.robots.plan_facts import DeviceFacts, PlanFacts
from bricktwin.robots.planned import (
    _name_of,
    _with_stops,
    check_description,
    completed,
    disagreements,
    plan_file,
    robot_of_plan,
)
from bricktwin.target import find
from bricktwin.twin.make_body import make_body

PLANS = Path(plans.__path__[0])
TWO_WHEELER_PLAN = str(PLANS / "two_wheeler.ldr")


def robot(**said: object) -> Robot:
    """A 2Wheeler with given fields only."""
    return robot_of_plan(TWO_WHEELER_PLAN, "mine", HubKind.PRIME, **said)  # type: ignore[arg-type]


def test_omitted_fields_follow_from_plan():
    made = robot(drive_base=DriveBase("left", "right"))
    assert {motor.name: (motor.port, motor.direction) for motor in made.motors} == {
        "left": ("E", Direction.COUNTERCLOCKWISE),
        "right": ("A", Direction.CLOCKWISE),
    }
    assert made.sensors == (UltrasonicSensor("eyes", "C"),)
    assert made.drive_base == DriveBase("left", "right", 56.0, 130.0)


def test_given_fields_are_kept_port_follows_from_plan():
    made = robot(motors=(Motor("right", range_deg=(0, 90)),))
    assert made.motors[0] == Motor("right", "A", range_deg=(0, 90))
    assert [motor.name for motor in made.motors] == ["right", "left"]


def test_gears_follow_from_plan_unless_given():
    arm = robot_of_plan(PLANS / "robo_arm.ldr", motors=[Motor("low", gears=(1, 1))])
    assert {motor.name: motor.gears for motor in arm.motors} == {
        "low": (1, 1),
        "rotation": (20, 60),
        "high": (12, 24),
        "grab": (12, 24),
    }


@pytest.mark.parametrize(
    ("said", "says"),
    [
        (
            {"motors": (Motor("left", "A"),)},
            "line 19: port A has .* 'right' in the plan, but .* calls it 'left'; make both agree",
        ),
        ({"motors": (Motor("nose"),)}, r"'nose' has no port, and .* \(it has: right, left\)"),
        (
            {"motors": (Motor("right", "A", gears=(12, 36)),)},
            r"has gears \(12, 36\), but the plan has no gears",
        ),
        (
            {"motors": (Motor("right", "A", kind=MotorKind.SPIKE_LARGE),)},
            "has 'right' there, a spike-large; make both agree",
        ),
        (
            {"drive_base": DriveBase("left", "right", 62.0)},
            "should turn a wheel of 62 mm, .* turns one of 56 mm",
        ),
        (
            {"drive_base": DriveBase("left", "right", 0.0, 112.0)},
            "130.0 mm apart, but mine says 112",
        ),
        ({"sensors": (UltrasonicSensor("ears", "C"),)}, "'eyes' in the plan, but .* 'ears'"),
    ],
)
def test_contradictions_to_plan_raise(said, says):
    with pytest.raises(DescriptionError, match=says) as caught:
        robot(**said)
    assert "\n" not in str(caught.value)


def test_other_hub_or_missing_plan_raises():
    with pytest.raises(DescriptionError, match="is not a technic hub"):
        robot_of_plan(TWO_WHEELER_PLAN, hub=HubKind.TECHNIC)
    with pytest.raises(PlanError, match="name an LDraw file"):
        robot_of_plan("nowhere.ldr")


def test_description_is_what_it_was_given_until_its_plan_completes_it():
    given = Robot("mine", HubKind.PRIME, motors=(Motor("left"),), plan=str(TWO_WHEELER_PLAN))
    assert given.motors == (Motor("left"),) and given.sensors == ()
    whole = completed(given)
    assert whole == robot(motors=(Motor("left"),), needs_imu=False)
    assert whole.plan is None and whole.motor("left").port and completed(whole) is whole
    for use in (make_body, whole_interface):
        with pytest.raises(DescriptionError, match=r"was not read; write completed\(Robot"):
            use(given)


def test_robot_in_a_file_is_completed_by_the_command(tmp_path):
    file = tmp_path / "my_robot.py"
    file.write_text(
        "from brickhub.robot import HubKind, Robot\n"
        f"ROBOT = Robot('mine', HubKind.PRIME, plan={str(TWO_WHEELER_PLAN)!r})\n"
    )
    assert {motor.name for motor in find(str(file)).robot.motors} >= {"left", "right"}


def test_fields_are_required_without_plan():
    with pytest.raises(DescriptionError, match="'left' has no port; say it, or name a plan"):
        Robot("mine", HubKind.PRIME, motors=(Motor("left"),))
    motors = (Motor("left", "A"), Motor("right", "B"))
    with pytest.raises(DescriptionError, match="no wheel diameter or no axle track"):
        Robot("mine", HubKind.PRIME, motors=motors, drive_base=DriveBase("left", "right", 56))


@pytest.mark.parametrize("one", [TWO_WHEELER, WALKER, ROBO_ARM], ids=lambda one: one.name)
def test_descriptions_match_plans(one):
    check_description(one, PLANS / f"{one.name.replace('-', '_')}.ldr")


@pytest.mark.parametrize(
    "turn", ["1 0 0 0 .8 -.6 0 .6 .8", ".8 0 .6 0 1 0 -.6 0 .8"], ids=["tilted", "turned"]
)
def test_hub_at_an_angle_has_no_imu(tmp_path, turn):
    plan, hub = tmp_path / "car.ldr", "1 15 0 -50 -40 {} 67718.dat"
    plan.write_text(
        Path(TWO_WHEELER_PLAN)
        .read_text()
        .replace(hub.format("1 0 0 0 1 0 0 0 1"), hub.format(turn))
    )
    for said in ({}, {"hub_sides": ("up", "ahead")}):
        with pytest.raises(
            DescriptionError, match="the hub is at an angle, so its IMU cannot be read"
        ):
            robot_of_plan(plan, needs_imu=True, **said)
    made = robot_of_plan(plan)
    assert made.motors and not made.needs_imu


def test_motor_that_does_not_fit_the_hub_raises(tmp_path):
    plan = tmp_path / "ev3.ldr"
    plan.write_text("0 !BRICKSRL PORT A arm\n1 4 0 0 0 1 0 0 0 1 0 0 0 1 99455.dat\n")
    with pytest.raises(
        DescriptionError, match="'arm' is an ev3-medium, whose plug fits no port of a prime hub"
    ):
        robot_of_plan(plan, hub=HubKind.PRIME)


def test_model_in_unknown_package_raises() -> None:
    with pytest.raises(
        DescriptionError, match="no package 'no.such.package' with the plan car.ldr"
    ):
        plan_file("no.such.package:car.ldr")
    assert plan_file("C:/car.ldr") == Path("C:/car.ldr") and plan_file("car.xml") is None


def part(port: str, name: str = "spike-medium", line: int = 7, **facts: Any) -> DeviceFacts:
    """A device of a plan."""
    made = {"name": name, "part": "Part", "line": line, "port": port, "label": None}
    made |= {"sides": (), "stops_deg": (), "gears": (), "ratio": 0.0}
    return DeviceFacts(**{**made, **facts})


HUB = part("", "prime", 1, sides=("up", "ahead"))
WHEELS = (
    part("A", wheel_mm=56.0, wheel_left_m=0.065, role="wheel"),
    part("B", line=8, wheel_mm=56.0, wheel_left_m=-0.065, role="wheel"),
)
BASED = Robot(
    "mine",
    HubKind.PRIME,
    (Motor("left", "A"), Motor("right", "B")),
    drive_base=DriveBase("left", "right", 56.0, 130.0),
)


def mistakes(robot: Robot, *motors: DeviceFacts, **facts: Any) -> list[tuple[int, str, str]]:
    design = PlanFacts(
        **{"hubs": (HUB,), "motors": motors, "sensors": (), "is_wired": True, **facts}
    )
    return list(disagreements(robot, design))


@pytest.mark.parametrize(
    ("wheel_mm", "track_mm", "line", "says"),
    [
        (56.0, 130.0, 0, ""),
        (56.4, 131.9, 0, ""),
        (55.6, 128.1, 0, ""),
        (
            56.6,
            130.0,
            7,
            "'left' should turn a wheel of 56.6 mm, as mine says, but turns one of 56",
        ),
        (55.4, 130.0, 7, "'left' should turn a wheel of 55.4 mm"),
        (56.0, 132.1, 7, "the wheels are 130.0 mm apart, but mine says 132.1; make both agree"),
        (56.0, 127.9, 7, "the wheels are 130.0 mm apart, but mine says 127.9"),
        # Of wheels that are not meant, the track says nothing.
        (62.0, 100.0, 7, "should turn a wheel of 62 mm"),
    ],
)
def test_wheels_of_a_plan_are_those_of_the_description_but_for_rounding(
    wheel_mm: float, track_mm: float, line: int, says: str
) -> None:
    robot = replace(BASED, drive_base=DriveBase("left", "right", wheel_mm, track_mm))
    found = mistakes(robot, *WHEELS)
    assert [one[:2] for one in found] == ([(line, "wheels")] if says else [])
    assert all(says in text for _, _, text in found)


def test_a_motor_of_a_drive_base_that_turns_no_wheel_is_named() -> None:
    ((line, kind, text),) = mistakes(BASED, WHEELS[0], part("B", line=9))
    assert (line, kind) == (9, "wheels") and "'right' should turn a wheel" in text
    assert "but turns none; use the wheel that is meant" in text
    other = part("B", line=8, wheel_mm=62.0, wheel_left_m=-0.065)
    ((line, _, text),) = mistakes(BASED, WHEELS[0], other)
    assert line == 8 and "turns one of 62 mm" in text


@pytest.mark.parametrize(
    ("gears", "ratio", "agrees"),
    [
        ((12, 36), 1 / 3, True),
        ((12, 36), -1 / 3, True),
        ((12, 36), 1.009 / 3, True),
        ((12, 36), 1.011 / 3, False),
        ((12, 36), 0.989 / 3, False),
        ((12, 20, 36), 1 / 3, True),
        ((36, 12), 1 / 3, False),
        # Gears of no ratio are a belief of their own, and a motor that drives nothing has none.
        ((20, 20), 1 / 3, True),
        ((), 1 / 3, True),
        ((12, 36), 0.0, True),
    ],
)
def test_gears_of_a_plan_have_the_ratio_of_the_description(
    gears: tuple[int, ...], ratio: float, agrees: bool
) -> None:
    robot = Robot("mine", HubKind.PRIME, (Motor("arm", "C", gears=gears),))
    found = mistakes(robot, part("C", ratio=ratio, gears=(8, 24)))
    assert [one[:2] for one in found] == ([] if agrees else [(7, "gears")])
    assert all("but the plan has 8 to 24; correct one" in text for _, _, text in found)


def test_what_only_one_of_both_has_is_said() -> None:
    robot = Robot("mine", HubKind.PRIME, (Motor("arm", "C"),))
    ((line, _, text),) = mistakes(robot)
    assert line == 0 and "has 'arm' on port C, but the plan has nothing there" in text
    (_, (line, _, text)) = mistakes(robot, part("D", line=12, label="tail"))
    assert line == 12 and text.startswith("port D has Part 'tail' in the plan, but the robot mine")
    # A second hub of another kind is a mistake; one of the same is not.
    assert mistakes(robot, part("C"), hubs=(HUB, HUB)) == []
    ((line, _, text),) = mistakes(robot, part("C"), hubs=(HUB, part("", "technic", 3)))
    assert line == 3 and "Part is not a prime hub, as the robot mine has" in text


@pytest.mark.parametrize(
    ("planned", "said", "says"),
    [
        (("up", "ahead"), ("up", "ahead"), ""),
        (("up", "back"), ("up", "ahead"), "looks up and its front back in the plan, but the robot"),
        (("up",), ("up", "ahead"), "the hub is at an angle, so its IMU cannot be read"),
    ],
)
def test_an_imu_is_mounted_as_the_plan_shows(
    planned: tuple[str, ...], said: tuple[str, ...], says: str
) -> None:
    robot = Robot("mine", HubKind.PRIME, needs_imu=True, hub_sides=said)
    found = mistakes(robot, hubs=(part("", "prime", 1, sides=planned),))
    assert len(found) == bool(says) and all(says in text for _, _, text in found)
    # Without the IMU it does not matter.
    assert mistakes(Robot("mine", HubKind.PRIME), hubs=(part("", "prime", 1, sides=planned),)) == []


@pytest.mark.parametrize(
    ("motor", "stops_deg", "wanted"),
    [
        (Motor("arm", "A"), (-30.0, 60.0), (-30.0, 60.0)),
        # A plan counts the shaft, and a description its output, perhaps the other way round.
        (Motor("arm", "A", gears=(12, 36)), (-30.0, 60.0), (-10.0, 20.0)),
        (Motor("arm", "A", direction=Direction.COUNTERCLOCKWISE), (-30.0, 60.0), (-60.0, 30.0)),
        (Motor("arm", "A", end_stops_deg=(-5.0, 5.0)), (-30.0, 60.0), (-5.0, 5.0)),
        (Motor("arm", "A"), None, None),
    ],
)
def test_end_stops_of_a_plan_are_angles_of_the_output(
    motor: Motor, stops_deg: tuple[float, float] | None, wanted: tuple[float, float] | None
) -> None:
    found = _with_stops(motor, stops_deg).end_stops_deg
    assert found == (None if wanted is None else pytest.approx(wanted))


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("walker.ldr", "walker"),
        ("my robot-2.mpd", "my_robot_2"),
        ("3_wheels.ldr", "robot_3_wheels"),
    ],
)
def test_a_robot_is_named_after_its_file(file: str, name: str) -> None:
    assert _name_of(Path(file)) == name
