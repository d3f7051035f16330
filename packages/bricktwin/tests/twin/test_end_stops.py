"""End stops: an arm that homes by stalling does so in a twin as on the bench."""

from __future__ import annotations

from pathlib import Path

import pytest

from brickhub.errors import DescriptionError, TwinError
from brickhub.robot import Direction, DriveBase, HubKind, Motor, Robot
from brickhub.robot.spec import with_end_stops
from brickhub.virtual.run import run_file
from bricktwin import robots
from bricktwin.robots.plan_facts import read_facts
from bricktwin.robots.planned import robot_of_plan
from bricktwin.twin.make_body import make_body
from bricktwin.twin.scene import Scene

HOMING = """from pybricks.pupdevices import Motor
from pybricks.parameters import Direction, Port
arm = Motor(Port.{port}{more})
print(arm.angle(), arm.run_until_stalled(-200, duty_limit=60), arm.run_until_stalled(200, duty_limit=60))
"""  # noqa: E501
WHEELS = (Motor("left", "A", direction=Direction.COUNTERCLOCKWISE), Motor("right", "B"))
BASE = DriveBase("left", "right", 56, 112)
HUB = "1 15 0 0 0 1 0 0 0 1 0 0 0 1 67718.dat"
MOTOR = "1 15 0 -100 0 1 0 0 0 1 0 0 0 1 54696p02.dat"


def homed(
    path: Path, capsysbinary, robot: Robot, port: str, more: str = "", **options: object
) -> list[int]:
    """Angles at the start and at both stops, as a program finds them by stalling."""
    path.write_text(HOMING.format(port=port, more=more))
    assert run_file(path, make_body(robot, **options), time_limit_s=20) == 0  # type: ignore[arg-type]
    return [int(word) for word in capsysbinary.readouterr().out.split()]


@pytest.mark.parametrize("base", [None, BASE])
@pytest.mark.parametrize(
    ("motor", "more", "stops"),
    [
        (Motor("arm", "D", end_stops_deg=(-40, 75)), "", (-40, 75)),
        (
            Motor("arm", "D", direction=Direction.COUNTERCLOCKWISE, end_stops_deg=(-75, 40)),
            "",
            (-40, 75),
        ),
        (Motor("arm", "D", gears=(12, 36), end_stops_deg=(-40, 75)), ", gears=[12, 36]", (-40, 75)),
    ],
)
def test_arm_homes_in_a_twin_as_on_the_bench(
    tmp_path, capsysbinary, base, motor, more, stops
) -> None:
    robot = Robot("arm", HubKind.PRIME, (*WHEELS, motor), drive_base=base)
    start, low, high = homed(tmp_path / "home.py", capsysbinary, robot, "D", more)
    assert start == 0
    assert (low, high) == pytest.approx(stops, abs=2)


def test_stops_of_scene_and_call_replace_those_of_the_description(tmp_path, capsysbinary) -> None:
    robot = Robot(
        "arm", HubKind.PRIME, (*WHEELS, Motor("arm", "D", end_stops_deg=(-40, 75))), drive_base=BASE
    )
    scene = Scene(end_stops={"arm": (-20.0, 30.0)})
    assert homed(tmp_path / "home.py", capsysbinary, robot, "D", scene=scene)[1:] == pytest.approx(
        [-20, 30], abs=2
    )
    stops = {"arm": (-5.0, 10.0)}
    assert homed(tmp_path / "home.py", capsysbinary, robot, "D", scene=scene, end_stops=stops)[
        1:
    ] == pytest.approx([-5, 10], abs=2)
    with pytest.raises(DescriptionError, match="has no motor 'leg'"):
        make_body(robot, end_stops={"leg": (0.0, 1.0)})


def test_robo_arm_homes_between_its_stops(tmp_path, capsysbinary) -> None:
    start, low, high = homed(tmp_path / "home.py", capsysbinary, robots.ROBO_ARM, "D")
    assert (start, low, high) == (40, pytest.approx(-5, abs=2), pytest.approx(85, abs=2))


def test_plan_says_where_a_motor_meets_something(tmp_path, capsysbinary) -> None:
    lines = (robots.__path__[0], "plans", "robo_arm.ldr")
    text = Path(*lines).read_text()
    line = next(line for line in text.splitlines() if line.startswith("0 !BRICKSRL PORT B"))
    plan = tmp_path / "arm.ldr"
    plan.write_text(text.replace(line, f"{line}\n0 !BRICKSRL STOPS -60 100"))
    assert [part.stops_deg for part in read_facts(plan).motors if part.port == "B"] == [
        (-60.0, 100.0)
    ]
    robot = robot_of_plan(plan)
    assert [motor.end_stops_deg is None for motor in robot.motors if motor.port == "B"] == [False]
    start, low, high = homed(tmp_path / "home.py", capsysbinary, robot, "B")
    assert (start, low, high) == (0, pytest.approx(-60, abs=3), pytest.approx(100, abs=3))


@pytest.mark.parametrize(("stops", "says"), [((20, 10), "leave no way"), ((5, 5), "leave no way")])
def test_stops_without_a_way_are_refused(stops, says) -> None:
    with pytest.raises(DescriptionError, match=says):
        Motor("arm", "D", end_stops_deg=stops)


def test_start_outside_of_the_stops_is_refused() -> None:
    arm = with_end_stops(robots.ROBO_ARM, {"low": (50.0, 60.0)})
    with pytest.raises(
        TwinError,
        match="motor 'low' of robot 'robo-arm' starts at 40 degrees, outside of its end stops",
    ):
        make_body(arm)
    with pytest.raises(TwinError, match="starts at 0 on the bench"):
        make_body(Robot("arm", HubKind.PRIME, (Motor("arm", "D", end_stops_deg=(10, 20)),)))
