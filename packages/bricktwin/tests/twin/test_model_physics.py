"""Physics applied to models: each parameter changes what the robot does, by the amount that
mechanics says."""

from __future__ import annotations

import dataclasses
import math

import mujoco
import numpy as np
import pytest

from brickhub.errors import TwinError
from brickhub.robot import Robot
from bricktwin.robots import ROBO_ARM, TWO_WHEELER, WALKER
from bricktwin.twin.arena import Arena, Contestant, Place
from bricktwin.twin.model_physics import SIDE_LOAD_OFFSET_M
from bricktwin.twin.models.load import load_model
from bricktwin.twin.models.motors import motor_constants
from bricktwin.twin.mujoco_arena import ArenaWorld
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics, RandomPhysics
from bricktwin.twin.scene import OPEN_FLOOR, Scene

QUIET = Physics(tilt_noise_deg=0, gyro_noise_deg_s=0, acceleration_noise_mm_s2=0)
LEFT, RIGHT = (motor.port for motor in TWO_WHEELER.motors)


def body(robot: Robot = TWO_WHEELER, scene: Scene = OPEN_FLOOR, **values: float) -> MujocoBody:
    return MujocoBody(robot, scene, dataclasses.replace(QUIET, **values), 0)


@pytest.mark.parametrize("slope_deg", [5.0, -8.0])
def test_a_braked_robot_stands_on_a_slope_and_measures_it(slope_deg: float) -> None:
    robot = body(slope_deg=slope_deg)
    robot.set_voltage(LEFT, 0)
    robot.set_voltage(RIGHT, 0)
    robot.advance_to(1000)
    pitch_deg, roll_deg = robot.tilt_deg()
    assert pitch_deg == pytest.approx(-slope_deg, abs=0.5)
    assert roll_deg == pytest.approx(0.0, abs=0.1)
    slope = math.radians(slope_deg)
    assert robot.acceleration_mm_s2() == pytest.approx(
        (9810 * math.sin(slope), 0, 9810 * math.cos(slope)), abs=100
    )


def test_a_robot_across_a_slope_measures_it_as_roll() -> None:
    robot = body(scene=Scene(heading_deg=(90.0, 90.0)), slope_deg=6.0)
    pitch_deg, roll_deg = robot.tilt_deg()
    assert pitch_deg == pytest.approx(0.0, abs=0.1)
    assert abs(roll_deg) == pytest.approx(6.0, abs=0.1)


def test_a_coasting_robot_rolls_down_a_steep_slope() -> None:
    robot = body(slope_deg=25.0)
    start_m = robot.pose().x_m
    robot.advance_to(2000)
    assert robot.pose().x_m < start_m - 0.1


@pytest.mark.parametrize("robot", [TWO_WHEELER, WALKER])
def test_a_side_load_is_a_point_mass(robot: Robot) -> None:
    """The oracle is a model with one more body, compiled by MuJoCo."""
    nominal = load_model(robot, OPEN_FLOOR).compile()
    spec = load_model(robot, OPEN_FLOOR)
    chassis = int(nominal.jnt_bodyid[0])
    place = nominal.body_ipos[chassis] + np.array(SIDE_LOAD_OFFSET_M)
    load = spec.body(nominal.body(chassis).name).add_body(pos=place.tolist())
    load.mass, load.ipos, load.inertia, load.explicitinertial = 0.1, [0.0] * 3, [1e-12] * 3, True
    with_load = spec.compile()
    found = body(robot, side_load_g=100.0).model
    assert found.body_mass.sum() == pytest.approx(with_load.body_mass.sum())
    matrices = []
    for model in (with_load, found):
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        matrices.append(full[:6, :6])
    np.testing.assert_allclose(matrices[1], matrices[0], rtol=1e-5, atol=1e-9)


def test_a_side_load_needs_a_robot_that_moves() -> None:
    with pytest.raises(TwinError, match="side_load_g"):
        body(ROBO_ARM, side_load_g=100.0)


@pytest.mark.parametrize("scale", [0.7, 1.15])
def test_each_motor_has_its_own_speed(scale: float) -> None:
    robot = body(motor_1_scale=scale)
    robot.model.opt.gravity[:] = 0.0
    robot.data.qpos[2] = 1.0
    for port in (LEFT, RIGHT):
        robot.set_voltage(port, 5000)
    robot.advance_to(1000)
    before = {port: robot.angle_mdeg(port) for port in (LEFT, RIGHT)}
    robot.advance_to(2000)
    motor = motor_constants(TWO_WHEELER.motors[0].kind)
    for port, factor in ((LEFT, scale), (RIGHT, 1.0)):
        no_load_rad_s = factor * (motor.torque_nm_v * 5.0 - motor.friction_nm) / motor.drag_nm_s
        speed_deg_s = (robot.angle_mdeg(port) - before[port]) / 1000
        assert speed_deg_s == pytest.approx(math.degrees(no_load_rad_s), rel=0.01)


@pytest.mark.parametrize(
    ("voltage_mv", "is_tilted"), [(2000, False), (2300, False), (5000, True), (8000, True)]
)
def test_a_robot_tilts_when_it_accelerates_as_its_masses_say(
    voltage_mv: int, is_tilted: bool
) -> None:
    """Driving backwards it lifts its caster as soon as the acceleration times the height of its
    centre of mass exceeds gravity times that centre's distance behind the axle: the moments about
    the wheels' contact."""
    robot = body(backlash_deg=0.0)
    behind_m, _, height_m = np.abs(
        robot.data.subtree_com[robot.chassis] - [*robot.data.xpos[robot.chassis][:2], 0.0]
    )
    robot.set_voltage(LEFT, voltage_mv)
    robot.set_voltage(RIGHT, -voltage_mv)
    robot.advance_to(30)
    assert bool(-robot.data.qvel[0] / 0.03 > 9.81 * behind_m / height_m) is is_tilted
    robot.advance_to(60)
    assert (robot.tilt_deg()[0] > 1.0) is is_tilted


def test_a_fixed_robot_draws_no_side_load() -> None:
    robot, rng = MujocoBody(ROBO_ARM, OPEN_FLOOR, RandomPhysics(), 0), np.random.default_rng(5)
    robot.reset(rng)
    assert robot.physics.side_load_g == 0.0
    assert robot.physics.motor_1_scale != 1.0


def test_random_physics_starts_from_the_nominal_model_each_time() -> None:
    robot, rng = MujocoBody(WALKER, OPEN_FLOOR, RandomPhysics(), 0), np.random.default_rng(5)
    nominal = load_model(WALKER, OPEN_FLOOR).compile()
    for _ in range(3):
        robot.reset(rng)
        load_kg = robot.physics.side_load_g / 1000
        assert robot.model.body_mass.sum() == pytest.approx(
            nominal.body_mass.sum() * robot.physics.mass_scale + load_kg
        )
        shift_m = np.linalg.norm(robot.model.body_ipos - nominal.body_ipos, axis=-1)
        assert (
            shift_m.sum()
            == shift_m[robot.chassis]
            < 0.048 * load_kg / robot.model.body_mass[robot.chassis] + 1e-9
        )


def test_all_robots_of_an_arena_get_the_physics() -> None:
    arena = Arena(
        tuple(Contestant(name, TWO_WHEELER, Place(x_m=(x_m, x_m))) for x_m, name in enumerate("ab"))
    )
    nominal = ArenaWorld(arena).engine.model
    changed = ArenaWorld(
        arena, Physics(slope_deg=5.0, side_load_g=50.0, motor_1_scale=0.7, motor_friction_scale=2.0)
    ).engine.model
    assert changed.body_mass.sum() == pytest.approx(nominal.body_mass.sum() + 0.1)
    assert changed.opt.gravity[0] == pytest.approx(-9.81 * math.sin(math.radians(5.0)))
    for name in ("a", "b"):
        weak, strong = (changed.actuator(f"{name}/motor_{port}").id for port in (LEFT, RIGHT))
        assert 0.7 * changed.actuator_biasprm[weak, 2] == pytest.approx(
            changed.actuator_biasprm[strong, 2]
        )
        dof = changed.joint(f"{name}/motor_{LEFT}").dofadr[0]
        assert changed.dof_frictionloss[dof] > nominal.dof_frictionloss[dof]
