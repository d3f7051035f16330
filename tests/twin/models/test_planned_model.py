"""Twins from plans against manual ones."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

from bricksrl.errors import DescriptionError, TwinError
from bricksrl.robots import ROBO_ARM, TWO_WHEELER, WALKER, HubKind, Motor, Robot
from bricksrl.twin.make_body import make_body
from bricksrl.twin.models.planned_looks import Spinners
from bricksrl.twin.mujoco_body import MujocoBody
from bricksrl.twin.physics import Physics
from bricksrl.twin.scene import OPEN_FLOOR, Scene

ROOT = Path(__file__).parents[3]
QUIET = Physics(distance_noise_mm=0, distance_noise_ratio=0, tilt_noise_deg=0, backlash_deg=0)


def from_plan(robot: Robot) -> Robot:
    """The robot with the model from its plan."""
    return replace(robot, model=str(ROOT / "plans" / f"{robot.name.replace('-', '_')}.ldr"))


def body(robot: Robot, scene: Scene = OPEN_FLOOR) -> MujocoBody:
    """A twin without backlash and noise."""
    return MujocoBody(robot, scene, QUIET, 0)


@cache
def car() -> Robot:
    """The car of the examples."""
    plan = str(ROOT / "examples" / "13_front_steered.ldr")
    return Robot("car", HubKind.PRIME, motors=(Motor("steering", range_deg=(-40, 40)),), needs_imu=True, plan=plan)


@pytest.mark.parametrize("voltages", [(-5000, 5000), (-5000, 3000), (5000, 5000)], ids=["straight", "curve", "turn"])
def test_planned_two_wheeler_drives_as_manual_model(voltages: tuple[int, int]) -> None:
    ways = []
    for robot in (TWO_WHEELER, from_plan(TWO_WHEELER)):
        one = body(robot)
        for port, voltage_mv in zip("EA", voltages, strict=True):
            one.set_voltage(port, voltage_mv)
        one.advance_to(2000)
        ways.append(one.pose())
    hand, plan = ways
    assert math.hypot(hand.x_m - plan.x_m, hand.y_m - plan.y_m) < 0.003
    assert plan.heading_deg == pytest.approx(hand.heading_deg, abs=1.0)


def test_planned_two_wheeler_sees_wall() -> None:
    one = body(from_plan(TWO_WHEELER), Scene(wall_distance_mm=(250.0, 250.0)))
    assert one.distance_mm("C") == pytest.approx(250, abs=2)
    assert one.tilt_deg() == pytest.approx((0, 0), abs=0.3)


def _foot_path(robot: Robot) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    one = body(robot)
    model, data = one.model, one.data
    model.opt.gravity[:] = 0.0
    data.qpos[2] = 1.0
    mujoco.mj_forward(model, data)
    crank = data.body("rotor_C").xpos[:2].copy()
    feet = [geom for geom in range(model.ngeom) if model.geom(geom).name.startswith("foot_")]
    foot = min(feet, key=lambda geom: float(np.linalg.norm(data.geom_xpos[geom][:2] - crank)))
    chassis, address, rows = model.body("chassis").id, int(model.joint("motor_C").qposadr[0]), []
    one.set_voltage("C", 3000)
    for step in range(1, 160):
        one.advance_to(20 * step)
        mujoco.mj_kinematics(model, data)
        place = (data.geom_xpos[foot] - data.xpos[chassis]) @ data.xmat[chassis].reshape(3, 3)
        rows.append([math.degrees(data.qpos[address]), *place])
    found = np.array(rows)
    assert found[-1, 0] > 370
    grid = np.arange(10.0, 370.0, 10.0)
    return np.stack([np.interp(grid, found[:, 0], found[:, axis]) for axis in (1, 3)], axis=1)


def test_planned_walker_feet_match_manual_model() -> None:
    apart = np.linalg.norm(_foot_path(WALKER) - _foot_path(from_plan(WALKER)), axis=1)
    assert apart.max() < 0.001


def test_planned_walker_stands_on_four_feet() -> None:
    one = body(from_plan(WALKER))
    one.advance_to(1000)
    touching = {one.model.geom(geom).name for contact in one.data.contact for geom in contact.geom}
    assert {"floor", *(f"foot_{number}" for number in range(4))} <= touching
    assert one.tilt_deg() == pytest.approx((0, 0), abs=1.0)


def test_planned_arm_starts_mid_range_and_stands() -> None:
    one = body(from_plan(ROBO_ARM))
    start = [one.angle_mdeg(motor.port) / 1000 for motor in ROBO_ARM.motors]
    assert start == pytest.approx([0, 40, -70, -96], abs=1)
    one.advance_to(5000)
    assert [one.angle_mdeg(motor.port) / 1000 for motor in ROBO_ARM.motors] == pytest.approx(start, abs=1)


def test_planned_arm_fingers_mirror() -> None:
    one = body(from_plan(ROBO_ARM))
    one.set_voltage("E", 3000)
    one.advance_to(300)
    mirrored = next(number for number in range(one.model.njnt) if one.model.joint(number).name.startswith("turn_"))
    angles = [float(one.data.qpos[one.model.jnt_qposadr[joint]]) for joint in (mirrored, one.model.joint("motor_E").id)]
    moved = angles[1] - float(one.model.qpos0[one.model.joint("motor_E").qposadr[0]])
    assert abs(moved) > 0.1
    assert angles[0] == pytest.approx(-moved, abs=0.01)


def test_visual_shafts_turn() -> None:
    one = body(from_plan(ROBO_ARM))
    one.set_voltage("B", 3000)
    one.advance_to(400)
    one.pose_looks()
    turned = math.radians(one.angle_mdeg("B") / 1000)
    name = next(
        one.model.body(number).name for number in range(one.model.nbody) if one.model.body(number).name.startswith("spin_B")
    )
    quaternion = one.model.body(name).quat
    # Clockwise from below, where the shaft points, is about the vertical.
    assert turned > 0.3
    expected = [math.cos(turned / 2), 0, 0, math.sin(turned / 2)]
    assert abs(float(quaternion @ expected)) == pytest.approx(1.0, abs=1e-3)
    assert Spinners(mujoco.MjModel.from_xml_string("<mujoco/>")) is not None


def test_steered_car_drives_circle() -> None:
    one = body(car())
    one.set_voltage("B", -5000)
    one.advance_to(800)
    straight = one.pose()
    assert straight.x_m > 0.15
    assert abs(straight.y_m) < 0.002
    one.set_voltage("A", 8000)
    one.advance_to(2500)
    assert one.pose().heading_deg < -20  # to the left
    assert 30 < one.angle_mdeg("A") / 1000 < 56  # against the friction of both tyres, and not beyond its end stop


def test_planned_masses_equal_parts() -> None:
    for robot in (from_plan(TWO_WHEELER), from_plan(WALKER), car()):
        model = body(robot).model
        assert model.body_mass.sum() == pytest.approx(
            {"two-wheeler": 0.428, "walker": 0.560, "car": 0.422}[robot.name], abs=0.001
        )


@pytest.mark.parametrize(
    ("robot", "scene", "says"),
    [
        (from_plan(ROBO_ARM), Scene(wall_distance_mm=(200.0, 300.0)), "stands still"),
        (from_plan(ROBO_ARM), Scene(ball=True), "holds no ball"),
        (car(), Scene(wall_distance_mm=(200.0, 300.0)), "no ultrasonic sensor"),
    ],
)
def test_unsupported_scene_raises(robot: Robot, scene: Scene, says: str) -> None:
    with pytest.raises(TwinError, match=says):
        make_body(robot, scene=scene)


def test_plan_of_other_robot_raises() -> None:
    with pytest.raises(DescriptionError, match="make both agree|add it with"):
        make_body(replace(TWO_WHEELER, model=str(ROOT / "plans" / "walker.ldr")))


def test_tilted_hub_has_no_imu(tmp_path: Path) -> None:
    text = (ROOT / "plans" / "robo_arm.ldr").read_text(encoding="utf-8").replace("0 !BRICKSRL FIXED\n", "")
    path = tmp_path / "arm.ldr"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(TwinError, match="does not lie flat"):
        make_body(replace(ROBO_ARM, needs_imu=True, model=str(path)))
