"""Descriptions completed by plans."""

from __future__ import annotations

from pathlib import Path

import pytest

from brickhub.errors import DescriptionError, PlanError
from brickhub.robot import Direction, DriveBase, HubKind, Motor, MotorKind, Robot, UltrasonicSensor
from brickhub.target import whole_interface
from bricktwin.robots import ROBO_ARM, TWO_WHEELER, WALKER, plans
from bricktwin.robots.planned import check_description, completed, plan_file, robot_of_plan
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
