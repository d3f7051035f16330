"""Models from building plans."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import mujoco
import pytest
from described import SPINNING

from brickhub.errors import DescriptionError, TwinError
from brickhub.hub.interface import Pitch, Roll
from brickhub.hub.link.lockstep import HubLink
from brickhub.robot import DriveBase, Motor, PoweredUpSensor, Robot, SensorKind
from brickhub.virtual import VirtualHub
from brickhub.virtual.stimuli import Sense
from bricktwin.robots import ROBO_ARM, TWO_WHEELER, WALKER, plans
from bricktwin.robots.planned import robot_of_plan
from bricktwin.twin.engines.mujoco_engine import MujocoEngine
from bricktwin.twin.make_body import make_body
from bricktwin.twin.models.turning_parts import TurningParts
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.objects import Block, Field, Ramp
from bricktwin.twin.physics import Physics
from bricktwin.twin.scene import OPEN_FLOOR, Scene

ROOT = Path(__file__).parents[5]
PLANS = Path(plans.__path__[0])
QUIET = Physics(distance_noise_mm=0, distance_noise_ratio=0, tilt_noise_deg=0, backlash_deg=0)


def body(robot: Robot, scene: Scene = OPEN_FLOOR) -> MujocoBody:
    """A twin without backlash and noise."""
    return MujocoBody(robot, scene, QUIET, 0)


@cache
def car() -> Robot:
    """The car of the examples."""
    plan = ROOT / "examples" / "13_front_steered.ldr"
    return robot_of_plan(plan, "car", motors=(Motor("steering", range_deg=(-40, 40)),))


@pytest.mark.parametrize(
    ("left", "right"),
    [(-5000, 5000), (-5000, 3000), (5000, 5000)],
    ids=["straight", "curve", "turn"],
)
def test_two_wheeler_rolls_without_slip(left: int, right: int) -> None:
    one = body(TWO_WHEELER)
    one.set_voltage("E", left)
    one.set_voltage("A", right)
    one.advance_to(2000)
    base = TWO_WHEELER.drive_base
    assert base is not None
    travelled = [
        math.radians(angle / 1000) * base.wheel_diameter_mm / 2
        for angle in (-one.angle_mdeg("E"), one.angle_mdeg("A"))
    ]
    heading = (travelled[0] - travelled[1]) / base.axle_track_mm
    assert one.pose().heading_deg == pytest.approx(math.degrees(heading), abs=2.0)
    if left == -right:
        assert one.pose().x_m * 1000 == pytest.approx(sum(travelled) / 2, abs=5.0)


def test_planned_two_wheeler_sees_wall() -> None:
    one = body(TWO_WHEELER, Scene(wall_distance_mm=(250.0, 250.0)))
    assert one.distance_mm("C") == pytest.approx(250, abs=2)
    assert one.tilt_deg() == pytest.approx((0, 0), abs=0.3)


def test_planned_walker_stands_on_four_feet() -> None:
    one = body(WALKER)
    one.advance_to(1000)
    touching = {one.model.geom(geom).name for contact in one.data.contact for geom in contact.geom}
    assert {"floor", *(f"foot_{port}" for port in "ABCD")} <= touching
    assert one.tilt_deg() == pytest.approx((0, 0), abs=1.0)


def test_planned_arm_starts_mid_range_and_stands() -> None:
    one = body(ROBO_ARM)
    start = [one.angle_mdeg(motor.port) / 1000 for motor in ROBO_ARM.motors]
    assert start == pytest.approx([0, 40, -70, -96], abs=1)
    one.advance_to(5000)
    assert [one.angle_mdeg(motor.port) / 1000 for motor in ROBO_ARM.motors] == pytest.approx(
        start, abs=1
    )


def test_planned_arm_fingers_mirror() -> None:
    one = body(ROBO_ARM)
    one.set_voltage("E", 3000)
    one.advance_to(300)
    mirrored = next(
        number
        for number in range(one.model.njnt)
        if one.model.joint(number).name.startswith("turn_")
    )
    angles = [
        float(one.data.qpos[one.model.jnt_qposadr[joint]])
        for joint in (mirrored, one.model.joint("motor_E").id)
    ]
    moved = angles[1] - float(one.model.qpos0[one.model.joint("motor_E").qposadr[0]])
    assert abs(moved) > 0.1
    assert angles[0] == pytest.approx(-moved, abs=0.01)


def test_visual_shafts_turn() -> None:
    one = body(ROBO_ARM)
    one.set_voltage("B", 3000)
    one.advance_to(400)
    one.update_visuals()
    turned = math.radians(one.angle_mdeg("B") / 1000)
    name = next(
        one.model.body(number).name
        for number in range(one.model.nbody)
        if one.model.body(number).name.startswith("spin_B")
    )
    quaternion = one.model.body(name).quat
    # Clockwise from below, where the shaft points, is about the vertical.
    assert turned > 0.3
    expected = [math.cos(turned / 2), 0, 0, math.sin(turned / 2)]
    assert abs(float(quaternion @ expected)) == pytest.approx(1.0, abs=1e-3)
    assert TurningParts(MujocoEngine(mujoco.MjModel.from_xml_string("<mujoco/>"))) is not None


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
    # against the friction of both tyres, and not beyond its end stop
    assert 30 < one.angle_mdeg("A") / 1000 < 56


def test_ball_jointed_links_steer_both_front_wheels() -> None:
    plan = Path(__file__).parents[2] / "plans" / "link_steered.ldr"
    one = body(robot_of_plan(plan, motors=(Motor("steering", range_deg=(-30, 30)),)))
    links_m = one.data.ten_length.copy()
    one.set_voltage("B", 5000)
    one.advance_to(800)
    straight = one.pose()
    assert straight.x_m > 0.15
    assert abs(straight.y_m) < 0.001
    one.set_voltage("A", 4000)
    one.advance_to(2500)
    axes = [
        one.model.joint(number)
        for number in range(one.model.njnt)
        if abs(one.model.jnt_axis[number][2]) > 0.9
    ]
    knuckles = [
        float(one.data.qpos[axis.qposadr[0]]) for axis in axes if axis.name.startswith("turn_")
    ]
    assert len(knuckles) == 2
    steered = float(one.data.joint("motor_A").qpos[0] + one.data.joint("backlash_A").qpos[0])
    assert [abs(angle) for angle in knuckles] == pytest.approx([abs(steered)] * 2, abs=0.01)
    assert one.data.ten_length == pytest.approx(links_m, abs=0.0005)
    assert one.pose().heading_deg < -20  # to the left


def test_link_on_a_ball_swings_down(tmp_path: Path) -> None:
    plan = tmp_path / "hanging.ldr"
    lines = [
        "0 !BRICKSRL FIXED",
        "1 15 0 -50 0 1 0 0 0 1 0 0 0 1 67718.dat",
        "1 0 -70 -100 -80 1 0 0 0 0 -1 0 1 0 2780.dat",
        "1 0 -70 -60 -80 1 0 0 0 0 -1 0 1 0 2780.dat",
        "1 72 -80 -20 -80 0 1 0 0 0 1 1 0 0 32525.dat",
        "1 0 -90 40 -80 1 0 0 0 1 0 0 0 1 6628.dat",
        "0 !BRICKSRL FREE",
        "1 71 -100 40 -80 0 1 0 -1 0 0 0 0 1 32005.dat",
    ]
    plan.write_text("\n".join(lines))
    one = body(robot_of_plan(plan))
    (joint,) = [
        number
        for number in range(one.model.njnt)
        if one.model.jnt_type[number] == mujoco.mjtJoint.mjJNT_BALL
    ]
    link = int(one.model.jnt_bodyid[joint])
    ball, as_planned = one.data.xpos[link].copy(), mujoco.MjData(one.model)
    mujoco.mj_forward(one.model, as_planned)
    assert as_planned.xipos[link] - ball == pytest.approx([0.02, 0, 0], abs=1e-4)
    one.advance_to(8000)
    assert one.data.xipos[link] - ball == pytest.approx([0, 0, -0.02], abs=1e-3)
    one.data.qvel[one.model.jnt_dofadr[joint] : one.model.jnt_dofadr[joint] + 3] = (
        0.0,
        0.0,
        9.0,
    )  # sideways: about x, as it hangs
    one.advance_to(8020)
    assert abs(one.data.xipos[link] - ball)[1] > 0.0003


def test_planned_masses_equal_parts() -> None:
    for robot in (TWO_WHEELER, WALKER, car()):
        model = body(robot).model
        assert model.body_mass.sum() == pytest.approx(
            {"two-wheeler": 0.428, "walker": 0.560, "car": 0.422}[robot.name], abs=0.001
        )


@pytest.mark.parametrize(
    ("robot", "scene", "says"),
    [
        (ROBO_ARM, Scene(wall_distance_mm=(200.0, 300.0)), "stands still"),
        (WALKER, Scene(ball=True), "no gripper"),
        (car(), Scene(wall_distance_mm=(200.0, 300.0)), "no ultrasonic sensor"),
    ],
)
def test_unsupported_scene_raises(robot: Robot, scene: Scene, says: str) -> None:
    with pytest.raises(TwinError, match=says):
        make_body(robot, scene=scene)


def test_plan_of_other_robot_raises() -> None:
    with pytest.raises(DescriptionError, match="make both agree|add it with"):
        make_body(replace(TWO_WHEELER, model=str(PLANS / "walker.ldr")))


def test_plan_without_hub_raises(tmp_path: Path) -> None:
    lines = (PLANS / "two_wheeler.ldr").read_text(encoding="utf-8").splitlines()
    path = tmp_path / "headless.ldr"
    path.write_text("\n".join(line for line in lines if "67718.dat" not in line), encoding="utf-8")
    with pytest.raises(TwinError, match="has no hub that is connected to the robot; add one"):
        make_body(replace(TWO_WHEELER, model=str(path)))


def test_motor_that_lies_beside_the_robot_raises(tmp_path: Path) -> None:
    text = (PLANS / "two_wheeler.ldr").read_text(encoding="utf-8")
    path = tmp_path / "apart.ldr"
    lost = "0 !BRICKSRL PORT B lost\n1 15 900 0 0 1 0 0 0 1 0 0 0 1 54696p02.dat\n0 NOFILE"
    path.write_text(
        text.replace("0 NOFILE", lost, 1).replace("PARTS 36", "PARTS 37"), encoding="utf-8"
    )
    with pytest.raises(
        TwinError,
        match=r"Medium angular motor .* is not connected to the main body; add a pin or an axle",
    ):
        make_body(robot_of_plan(path))


def test_motor_that_hangs_on_an_unknown_part_names_it(tmp_path: Path) -> None:
    text = (ROOT / "examples" / "walkers" / "two_legs.ldr").read_text(encoding="utf-8")
    path = tmp_path / "unknown.ldr"
    path.write_text(text.replace(" 32278.dat", " 99999999.dat"), encoding="utf-8")
    with pytest.raises(
        TwinError, match=r"not connected .*; or replace 99999999 \(line 12\), which"
    ):
        make_body(robot_of_plan(path))


def test_hub_must_look_as_described(tmp_path: Path) -> None:
    text = (PLANS / "robo_arm.ldr").read_text(encoding="utf-8").replace("0 !BRICKSRL FIXED\n", "")
    path = tmp_path / "arm.ldr"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DescriptionError, match="top looks up and its front back"):
        make_body(replace(ROBO_ARM, needs_imu=True, model=str(path)))
    free = make_body(replace(ROBO_ARM, needs_imu=True, hub_sides=("up", "back"), model=str(path)))
    free.advance_to(2000)
    assert all(map(math.isfinite, free.tilt_deg()))  # it stands on no feet, and may fall


def test_hub_that_looks_backwards(tmp_path: Path) -> None:
    text = (PLANS / "two_wheeler.ldr").read_text(encoding="utf-8")
    hub = "1 15 0 -50 -40 1 0 0 0 1 0 0 0 1 67718.dat"
    assert hub in text
    path = tmp_path / "backwards.ldr"
    path.write_text(
        text.replace(hub, "1 15 0 -50 -40 -1 0 0 0 1 0 0 0 -1 67718.dat"), encoding="utf-8"
    )
    drive_base = DriveBase("left", "right")
    robot = robot_of_plan(path, "rover", drive_base=drive_base, needs_imu=True)
    assert robot.hub_sides == ("up", "back")
    sloping = replace(QUIET, slope_deg=5.0, gyro_noise_deg_s=0, acceleration_noise_mm_s2=0)
    turned, plain = (MujocoBody(one, OPEN_FLOOR, sloping, 0) for one in (robot, TWO_WHEELER))
    assert plain.tilt_deg() == pytest.approx((-5, 0), abs=0.3)
    assert turned.tilt_deg() == pytest.approx((5, 0), abs=0.3)  # in the frame of the hub
    assert turned.acceleration_mm_s2()[2] > 9000
    with pytest.raises(DescriptionError, match=r"hub_sides=\('up', 'back'\)"):
        make_body(replace(TWO_WHEELER, model=str(path)))
    # What the program on the hub reads is along the robot's axes.
    interface = replace(SPINNING, channels=(Pitch(), Roll()))
    for one, body_of_it in ((robot, turned), (TWO_WHEELER, plain)):
        with HubLink(VirtualHub(body_of_it), one, interface) as link:
            assert link.read().values == pytest.approx((-5, 0), abs=0.3)


def test_walker_is_stopped_by_block_and_climbs_ramp() -> None:
    # Contacts with objects of a scene are listed, as those with the floor.
    model = body(WALKER, Scene(objects=(Block((300, 0)), Ramp((200, 200))))).model
    assert {model.geom(geom).name for geom in model.pair_geom1} == {"floor", "object_0", "object_1"}
    assert body(WALKER, Scene(objects=(Block((300, 0), mass_g=50.0),))).model.npair == 0


def test_colour_sensor_of_plan_sees_floor(tmp_path: Path) -> None:
    text = (PLANS / "two_wheeler.ldr").read_text(encoding="utf-8").replace("PARTS 36", "PARTS 37")
    sensor = "0 !BRICKSRL PORT B light\n1 15 0 40 120 1 0 0 0 0 -1 0 1 0 26912.dat\n"
    path = tmp_path / "seer.ldr"
    path.write_text(
        text.replace("0 !BRICKSRL PORT A right", sensor + "0 !BRICKSRL PORT A right"),
        encoding="utf-8",
    )
    light = PoweredUpSensor("light", "B", SensorKind.COLOR_DISTANCE)
    robot = replace(TWO_WHEELER, sensors=(*TWO_WHEELER.sensors, light), model=str(path))
    hue, saturation, _ = body(robot, Scene(objects=(Field((60, 0), (60, 60), "red"),))).sensed(
        "B", Sense.SURFACE
    )  # type: ignore[misc]
    assert min(hue, 360 - hue) < 10
    assert saturation > 60
    hue, saturation, _ = body(robot).sensed("B", Sense.SURFACE)  # type: ignore[misc]
    assert saturation < 10
