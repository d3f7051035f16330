"""Differentials, and several motors on one gear: their twins share turns as gears do."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from bricktwin.plans.mechanism.motor_role import Role
from bricktwin.plans.planned_robot import planned_robot
from bricktwin.robots.as_drawn import robot_as_drawn
from bricktwin.twin.models.linkage import Linkage
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.scene import OPEN_FLOOR

UPRIGHT = "0 -1 0 1 0 0 0 0 1"
FLAT = "1 0 0 0 0 1 0 -1 0"
ACROSS = "1 0 0 0 0 -1 0 1 0"
LEVEL = "0 1 0 -1 0 0 0 0 1"
QUIET = Physics(distance_noise_mm=0, distance_noise_ratio=0, tilt_noise_deg=0, backlash_deg=0)
FULL_MV = 9000


def motors(folder: Path, *lines: str) -> Path:
    """A plan of a hub and two motors in a row, each with an upright axle, and further parts."""
    parts = ["1 15 160 60 10 1 0 0 0 0 1 0 -1 0 67718.dat"]
    for port, x in (("A", 0), ("B", 60)):
        parts += [
            f"0 !BRICKSRL PORT {port}",
            f"1 15 {x} 0 0 1 0 0 0 1 0 0 0 1 54696p02.dat",
            f"1 0 {x} -80 0 {UPRIGHT} 3706.dat",
        ]
    parts += [f"1 0 {x} {y} 20 {ACROSS} 2780.dat" for x in (30, 90) for y in (20, -20)]
    path = folder / "geared.mpd"
    # The axles lie across, so that what they turn rolls.
    head = ["0 FILE main.ldr", f"1 16 0 0 0 {LEVEL} robot.ldr", "0 FILE robot.ldr"]
    path.write_text("\n".join([*head, *parts, *lines]) + "\n", encoding="utf-8")
    return path


def gears_of_24(folder: Path, *lines: str) -> Path:
    """Two motors whose gears mesh, and further parts."""
    gears = [f"1 7 {x} -80 0 {FLAT} 3648b.dat" for x in (0, 60)]
    return motors(folder, *gears, *lines)


def differential(folder: Path, *lines: str) -> Path:
    """Motor A turns the lower shaft of a differential, motor B its housing; nothing but these the
    upper one."""
    return motors(
        folder,
        f"1 7 60 -126 0 {FLAT} 18575.dat",
        f"1 7 0 -150 -36.3 {FLAT} 62821b.dat",
        "1 7 0 -133 0 1 0 0 0 0 -1 0 1 0 6589.dat",
        f"1 7 0 -167 0 {FLAT} 6589.dat",
        "1 7 17 -150 0 0 0 -1 0 1 0 1 0 0 6589.dat",
        f"1 0 0 -200 0 {UPRIGHT} 3705.dat",
        *lines,
    )


def body(path: Path) -> MujocoBody:
    """A twin without backlash and noise."""
    return MujocoBody(robot_as_drawn(path).robot, OPEN_FLOOR, QUIET, 0)


def wheel(y: int) -> str:
    """A wheel on the axis of motor A."""
    return f"1 0 0 {y} 0 {FLAT} 39367p02.dat"


def run(
    path: Path,
    voltages_mv: dict[str, int],
    seconds: int = 1,
) -> MujocoBody:
    """A twin without backlash and noise, after some time with these voltages."""
    one = MujocoBody(robot_as_drawn(path).robot, OPEN_FLOOR, QUIET, 0)
    for port, voltage_mv in voltages_mv.items():
        one.set_voltage(port, voltage_mv)
    one.advance_to(1000 * seconds)
    return one


def angle_deg(one: MujocoBody, joint: str) -> float:
    """Angle of a joint, whole turns too."""
    return math.degrees(one.data.joint(joint).qpos[0])


@pytest.mark.parametrize("voltages_mv", [{"A": 5000}, {"B": 5000}, {"A": 5000, "B": -5000}])
def test_differential_shares_turns(tmp_path: Path, voltages_mv: dict[str, int]) -> None:
    one = run(differential(tmp_path), voltages_mv)
    lower, drive = (angle_deg(one, f"motor_{port}") for port in "AB")
    # The housing is on the lower shaft, and the upper shaft is on the housing.
    housing = lower + angle_deg(one, "turn_3")
    upper = housing + angle_deg(one, "turn_5")
    assert max(abs(lower), abs(drive)) > 180
    assert housing == pytest.approx(-20 / 28 * drive, abs=1)
    assert lower + upper == pytest.approx(2 * housing, abs=1)


def test_one_motor_turns_another_on_its_gear(tmp_path: Path) -> None:
    one = run(gears_of_24(tmp_path), {"A": 5000})
    assert angle_deg(one, "motor_A") > 90
    assert angle_deg(one, "motor_B") == pytest.approx(-angle_deg(one, "motor_A"), abs=1)


def test_motors_on_one_gear_are_stronger_together(tmp_path: Path) -> None:
    plan = gears_of_24(tmp_path)
    alone, together, against = (
        angle_deg(run(plan, {"A": 5000, "B": other_mv}), "motor_A") for other_mv in (0, -5000, 5000)
    )
    assert together > 1.2 * alone
    assert against == pytest.approx(0, abs=1)


def test_open_gears_hold_at_full_speed(tmp_path: Path) -> None:
    one = run(differential(tmp_path), {"A": FULL_MV, "B": FULL_MV}, seconds=5)
    slips_rad = abs(one.data.ten_length - one.model.tendon_length0)
    assert max(slips_rad) < 0.01
    assert all(math.isfinite(value) and abs(value) < 1000 for value in one.data.qpos)


def test_motor_turns_the_wheel_behind_its_differential(tmp_path: Path) -> None:
    drawn = robot_as_drawn(differential(tmp_path, wheel(-225)))
    a, b = drawn.motors
    assert (a.facts.wheel_mm, b.facts.wheel_mm) == (56, 56)
    assert a.facts.is_forward != b.facts.is_forward
    assert len(drawn.motors_with(Role.WHEEL)) == 2


def test_motor_on_the_gear_of_another_turns_with_it(tmp_path: Path) -> None:
    drawn = robot_as_drawn(gears_of_24(tmp_path, wheel(-125)))
    assert [motor.name for motor in drawn.motors] == ["drive", "motor_b"]
    assert [motor.name for motor in drawn.motors_with(Role.WHEEL)] == ["drive"]
    assert drawn.motors[1].moves == "turns with port A"


def test_linkage_turns_open_gears(tmp_path: Path) -> None:
    path = gears_of_24(tmp_path)
    design = planned_robot(path)
    gear_a, gear_b = (part.index for part in design.plan.parts if part.part.number == "3648b")
    linkage = Linkage(design.articulation)
    linkage.turn({"motor_A": 0.5})
    turns = [linkage.motion(gear)[0] for gear in (gear_a, gear_b)]
    cosines = [(turn.trace() - 1) / 2 for turn in turns]
    assert cosines == pytest.approx([math.cos(0.5)] * 2, abs=1e-6)
    assert turns[0] == pytest.approx(turns[1].T, abs=1e-6)
