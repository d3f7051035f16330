"""Robots as they are drawn: names, directions, drive base, pairs, ports and facing of plans."""

from __future__ import annotations

from pathlib import Path

import pytest

from brickhub.errors import PlanError
from brickhub.robot import Direction, Sense
from bricktwin.plans.mechanism.motor_role import Role
from bricktwin.robots import EV3_DRIVER, TWO_WHEELER, plans
from bricktwin.robots.as_drawn import robot_as_drawn
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.scene import OPEN_FLOOR

PLANS = Path(plans.__path__[0])
EXAMPLES = Path(__file__).parents[4] / "examples"
TURNS = {
    "as ours": "1 0 0 0 1 0 0 0 1",
    "to the right": "0 0 1 0 1 0 -1 0 0",
    "to the left": "0 0 -1 0 1 0 1 0 0",
    "towards the viewer": "-1 0 0 0 1 0 0 0 -1",
}
"""Rotations of a drawing about its upright axis, as LDraw writes them."""


def as_strangers_draw(folder: Path, name: str, turn: str = "as ours") -> Path:
    """One of our plans without any mark of ours, turned."""
    lines = (PLANS / f"{name}.ldr").read_text(encoding="utf-8").splitlines()
    own = [line for line in lines if "!BRICKSRL" not in line]
    first = own[0].removeprefix("0 FILE ")
    path = folder / "drawing.mpd"
    head = ["0 FILE main.ldr", f"1 16 0 0 0 {TURNS[turn]} {first}"]
    path.write_text("\n".join([*head, *own]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("name", "ours"), [("two_wheeler", TWO_WHEELER), ("ev3_driver", EV3_DRIVER)]
)
def test_our_driving_robots_are_understood_from_their_plans(name, ours):
    drawn = robot_as_drawn(PLANS / f"{name}.ldr")
    assert drawn.is_wired
    assert drawn.robot.drive_base == ours.drive_base
    assert drawn.robot.needs_imu == ours.needs_imu
    assert set(drawn.robot.mirrored) >= set(ours.mirrored)
    ports = {sensor.name: sensor.port for sensor in drawn.robot.sensors}
    assert ports == {sensor.name: sensor.port for sensor in ours.sensors}
    for motor in ours.motors:
        assert drawn.robot.motor(motor.name) == motor


def test_roles_follow_from_what_moves():
    roles = {}
    for path in (PLANS / "robo_arm.ldr", EXAMPLES / "13_front_steered.ldr"):
        for motor in robot_as_drawn(path).motors:
            roles[motor.name] = motor.role
    assert roles == {
        "low": Role.JOINT,
        "rotation": Role.JOINT,
        "high": Role.JOINT,
        "grab": Role.JOINT,
        "steering": Role.STEERING,
        "drive": Role.WHEEL,
    }


def test_joint_keeps_within_its_way():
    arm = robot_as_drawn(PLANS / "robo_arm.ldr").robot
    assert arm.motor("low").range_deg is not None
    assert arm.motor("rotation").range_deg is None


def test_six_legs_are_named_and_paired_by_their_places():
    drawn = robot_as_drawn(EXAMPLES / "15_six_legs.ldr")
    rows = ("front", "middle", "back")
    assert {motor.name for motor in drawn.motors_with(Role.LEG)} == {
        f"{side}_{row}" for side in ("left", "right") for row in rows
    }
    assert set(drawn.robot.mirrored) == {(f"left_{row}", f"right_{row}") for row in rows}
    # The shafts of both sides look outwards, so they walk forwards in opposite directions.
    sides = {motor.name.partition("_")[0]: motor.direction for motor in drawn.robot.motors}
    assert sides == {"left": Direction.CLOCKWISE, "right": Direction.COUNTERCLOCKWISE}


@pytest.mark.parametrize("turn", TURNS)
def test_drawing_without_marks_is_wired_and_faces_what_its_sensor_sees(tmp_path, turn):
    path = as_strangers_draw(tmp_path, "ev3_driver", turn)
    drawn = robot_as_drawn(path)
    assert not drawn.is_wired
    assert sorted(motor.port for motor in drawn.robot.motors) == ["A", "B"]
    assert sorted(sensor.port for sensor in drawn.robot.sensors) == ["1", "2", "3", "4"]
    # The one on the left is on the left, however the drawing is turned.
    assert drawn.robot.drive_base is not None
    assert drawn.robot.drive_base.left == "left"
    assert drawn.sensor_looking(Sense.DISTANCE, "ahead") == "eyes"
    body = MujocoBody(drawn.robot, OPEN_FLOOR, Physics(), 0)
    ahead_mm, _, above_mm = body.sensor_place_mm("light")
    assert ahead_mm == pytest.approx(64, abs=1)
    assert 5 < above_mm < 24


def test_hub_without_enough_ports_is_refused_with_the_line(tmp_path):
    text = as_strangers_draw(tmp_path, "ev3_driver").read_text(encoding="utf-8")
    motor = next(line for line in text.splitlines() if line.endswith(" 95658.dat"))
    path = tmp_path / "many.mpd"
    # They are added to the main model, before the first line of the next one.
    lines = text.splitlines()
    path.write_text("\n".join([*lines[:2], *[motor] * 3, *lines[2:]]) + "\n", encoding="utf-8")
    with pytest.raises(
        PlanError, match=r"line \d+: no port of the EV3 brick .* is left for EV3 large motor"
    ):
        robot_as_drawn(path)


def test_what_has_no_twin_is_named(tmp_path):
    path = as_strangers_draw(tmp_path, "two_wheeler")
    lines = path.read_text(encoding="utf-8").splitlines()
    gears = [f"1 7 {x} -200 0 1 0 0 0 1 0 0 0 1 3648b.dat" for x in (0, 64)]
    chain = ["0 SYNTH BEGIN TECHNIC_CHAIN_LINK 0", "0 SYNTH END"]
    unknown_part = "1 7 0 -300 0 1 0 0 0 1 0 0 0 1 54321.dat"
    tread = "1 0 0 -400 0 1 0 0 0 1 0 0 0 1 3873.dat"
    lines[2:2] = [*gears, unknown_part, *chain, tread]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    unknown, undrawn, treads, gears_apart = robot_as_drawn(path).lacks
    assert undrawn.startswith("line 6: LSynth has not drawn the parts of this technic_chain_link")
    assert treads.startswith("line 8: Chain link with a tread (3873) turns gears, but drives no")
    assert "part 54321 is not in the catalogue" in unknown
    assert "as they are 1.6 mm too far apart; move one" in gears_apart
