from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from brickhub.errors import TwinError
from brickhub.hub.link.profiles import DEFAULT_LINK, PROFILES
from brickhub.robot import BENCH, HubKind, MotorKind, Robot
from brickhub.virtual.bench_body import BenchBody
from bricktwin.robots import SCOUT, TWO_WHEELER
from bricktwin.twin.engines.conventions import (
    FLOOR_GROUP,
    LOOKS_GROUP,
    OBSTACLE_GROUP,
    SHAPE_GROUP,
)
from bricktwin.twin.make_body import make_body
from bricktwin.twin.models.motors import motor_constants
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics, RandomPhysics
from bricktwin.twin.scene import OPEN_FLOOR, Scene

QUIET = Physics(
    distance_noise_mm=0,
    distance_noise_ratio=0,
    tilt_noise_deg=0,
    gyro_noise_deg_s=0,
    acceleration_noise_mm_s2=0,
)
LEFT, RIGHT, EYES = "E", "A", "C"
MEDIUM = motor_constants(MotorKind.SPIKE_MEDIUM)


def body(
    scene: Scene = OPEN_FLOOR, physics: Physics | RandomPhysics = QUIET, seed: int = 0
) -> MujocoBody:
    return MujocoBody(TWO_WHEELER, scene, physics, seed)


def quiet(**values: Any) -> Physics:
    return dataclasses.replace(QUIET, **values)


def before_wall(mm: float, heading_deg: float = 0.0) -> Scene:
    return Scene(wall_distance_mm=(mm, mm), heading_deg=(heading_deg, heading_deg))


def drive(
    robot: MujocoBody, left_mv: int | None, right_mv: int | None, *, start_ms: int = 0, for_ms: int
) -> int:
    """Apply clockwise voltages for a time. Returns the end time."""
    robot.set_voltage(LEFT, left_mv)
    robot.set_voltage(RIGHT, right_mv)
    robot.advance_to(start_ms + for_ms)
    return start_ms + for_ms


def test_names_in_a_model_are_those_of_its_ports() -> None:
    """A user's program finds joints, motors and eyes by these."""
    model = MujocoBody(SCOUT, OPEN_FLOOR, QUIET, 0).model
    for port in "EA":
        assert model.joint(f"motor_{port}").id >= 0
        assert model.actuator(f"motor_{port}").id >= 0
    assert model.site("ultrasonic_C").id != model.site("sensor_B").id


def test_what_is_only_drawn_is_no_obstacle_and_no_floor() -> None:
    groups = (OBSTACLE_GROUP, FLOOR_GROUP, LOOKS_GROUP, SHAPE_GROUP)
    assert len(set(groups)) == 4
    # MuJoCo draws the first three groups where nobody chooses.
    assert SHAPE_GROUP > 2 >= max(groups[:3])


def off_the_ground(robot: MujocoBody) -> MujocoBody:
    robot.model.opt.gravity[:] = 0.0
    robot.data.qpos[2] = 1.0
    return robot


def shaft_speed_deg_s(robot: MujocoBody, port: str, now_ms: int) -> float:
    before = robot.angle_mdeg(port)
    robot.advance_to(now_ms + 1000)
    return (robot.angle_mdeg(port) - before) / 1000


class TestAtRest:
    def test_body_stands_level(self) -> None:
        robot = body()
        pose = robot.pose()
        drive(robot, None, None, for_ms=5000)
        assert robot.pose().x_m == pytest.approx(pose.x_m, abs=1e-5)
        assert robot.pose().y_m == pytest.approx(pose.y_m, abs=1e-5)
        assert robot.heading_deg() == pytest.approx(0.0, abs=1e-3)
        assert robot.tilt_deg() == pytest.approx((0.0, 0.0), abs=0.2)
        assert robot.angular_velocity_deg_s() == pytest.approx((0, 0, 0), abs=0.01)
        assert robot.acceleration_mm_s2() == pytest.approx((0, 0, 9810), abs=40)
        assert (robot.angle_mdeg(LEFT), robot.angle_mdeg(RIGHT)) == (0, 0)

    def test_wheels_carry_body(self) -> None:
        assert body().data.qpos[2] == pytest.approx(0.028, abs=1e-4)

    def test_body_names_devices(self) -> None:
        robot = body()
        assert robot.robot is TWO_WHEELER
        assert robot.battery_mv == 8000


class TestMotors:
    @pytest.mark.parametrize("volts", [3.0, 7.2, -5.0])
    @pytest.mark.parametrize("port", [LEFT, RIGHT])
    def test_free_wheel_follows_motor_curve(self, volts: float, port: str) -> None:
        robot = off_the_ground(body())
        robot.set_voltage(port, round(volts * 1000))
        robot.advance_to(1000)
        no_load = (
            math.copysign(MEDIUM.torque_nm_v * abs(volts) - MEDIUM.friction_nm, volts)
            / MEDIUM.drag_nm_s
        )
        assert shaft_speed_deg_s(robot, port, 1000) == pytest.approx(
            math.degrees(no_load), rel=0.01
        )

    def test_low_voltage_does_not_overcome_friction(self) -> None:
        robot = off_the_ground(body())
        drive(robot, -800, 800, for_ms=1000)
        assert (robot.angle_mdeg(LEFT), robot.angle_mdeg(RIGHT)) == (0, 0)

    def test_left_counterclockwise_and_right_clockwise_drive_forward(self) -> None:
        robot = body()
        drive(robot, -3000, 3000, for_ms=1000)
        pose = robot.pose()
        assert pose.x_m > 0.1
        assert abs(pose.y_m) < 0.01
        assert abs(pose.heading_deg) < 2.0
        assert robot.angle_mdeg(LEFT) < 0 < robot.angle_mdeg(RIGHT)

    def test_the_wheels_roll(self) -> None:
        robot = body(physics=quiet(backlash_deg=0))
        drive(robot, -2000, 2000, for_ms=2000)
        turn = math.radians((robot.angle_mdeg(RIGHT) - robot.angle_mdeg(LEFT)) / 2000)
        assert robot.pose().x_m == pytest.approx(turn * 0.028, rel=0.02)

    def test_both_clockwise_turn_left(self) -> None:
        robot = body()
        now_ms = drive(robot, 3000, 3000, for_ms=2000)
        pose, before = robot.pose(), robot.heading_deg()
        assert math.hypot(pose.x_m, pose.y_m) < 0.03
        assert robot.angular_velocity_deg_s()[2] > 50
        drive(robot, 3000, 3000, start_ms=now_ms, for_ms=1000)
        assert robot.heading_deg() - before == pytest.approx(
            -robot.angular_velocity_deg_s()[2], rel=0.05
        )

    def test_heading_is_not_wrapped(self) -> None:
        robot = body()
        drive(robot, -5000, -5000, for_ms=6000)
        assert robot.heading_deg() > 720
        assert robot.rotation_deg() == pytest.approx((0.0, 0.0, -robot.heading_deg()), abs=10.0)

    def test_coasting_runs_on_and_braking_stops(self) -> None:
        ways = []
        for voltage in (None, 0):
            robot = body()
            now_ms = drive(robot, -6000, 6000, for_ms=1000)
            start = robot.pose().x_m
            drive(robot, voltage, voltage, start_ms=now_ms, for_ms=1000)
            ways.append(robot.pose().x_m - start)
        assert ways[0] > 2 * ways[1] > 0

    def test_motor_drives_after_coasting(self) -> None:
        robot = body()
        now_ms = drive(robot, None, None, for_ms=100)
        drive(robot, -3000, 3000, start_ms=now_ms, for_ms=500)
        assert robot.pose().x_m > 0.03


class TestSensors:
    @pytest.mark.parametrize("mm", [60.0, 250.0, 1500.0])
    def test_distance_reads_the_wall(self, mm: float) -> None:
        assert body(before_wall(mm)).distance_mm(EYES) == pytest.approx(mm, abs=1)

    def test_distance_is_limited_to_40_and_2000(self) -> None:
        assert body(before_wall(25)).distance_mm(EYES) == 40
        assert body(before_wall(2500)).distance_mm(EYES) == 2000
        assert body().distance_mm(EYES) == 2000

    def test_distance_is_nearest_point_in_cone(self) -> None:
        straight, turned = (
            body(before_wall(500, heading_deg)).distance_mm(EYES) for heading_deg in (0, 12)
        )
        assert turned == pytest.approx(straight, abs=2)
        assert body(before_wall(500, 30)).distance_mm(EYES) > 510

    def test_distance_grows_when_reversing(self) -> None:
        robot = body(before_wall(250))
        start = robot.pose().x_m
        drive(robot, 3000, -3000, for_ms=1000)
        assert robot.distance_mm(EYES) - 250 == pytest.approx(
            (start - robot.pose().x_m) * 1000, abs=2
        )

    def test_wall_stops_robot(self) -> None:
        robot = body(before_wall(100))
        start = robot.pose().x_m
        drive(robot, -4000, 4000, for_ms=2000)
        assert 0.05 < robot.pose().x_m - start < 0.12

    @pytest.mark.parametrize(
        ("axis", "pitch_deg", "roll_deg"),
        [((0, 1, 0), 20, 0), ((0, -1, 0), -20, 0), ((1, 0, 0), 0, 20), ((-1, 0, 0), 0, -20)],
    )
    def test_nose_down_and_right_side_down_are_positive(
        self, axis: tuple[int, int, int], pitch_deg: float, roll_deg: float
    ) -> None:
        # About +y the nose (x) goes down; about +x the right side (-y) goes down.
        robot = off_the_ground(body())
        half = math.radians(10)
        robot.data.qpos[3:7] = (math.cos(half), *(math.sin(half) * np.array(axis)))
        assert robot.tilt_deg() == pytest.approx((pitch_deg, roll_deg), abs=1e-6)

    def test_tilt_follows_from_the_accelerometer_at_rest(self) -> None:
        robot = body()
        robot.advance_to(1000)
        x, y, z = robot.acceleration_mm_s2()
        expected = math.degrees(math.atan2(-x, math.hypot(y, z))), math.degrees(math.atan2(y, z))
        assert robot.tilt_deg() == pytest.approx(expected, abs=0.05)

    def test_accelerometer_measures_start(self) -> None:
        robot = body()
        drive(robot, -2500, 2500, for_ms=40)
        assert robot.acceleration_mm_s2()[0] > 300


def free_speed(physics: Physics) -> float:
    robot = off_the_ground(body(physics=physics))
    drive(robot, 0, 9000, for_ms=1000)
    return shaft_speed_deg_s(robot, RIGHT, 1000)


def way_mm(physics: Physics, voltage_mv: int, for_ms: int) -> float:
    robot = body(physics=physics)
    drive(robot, -voltage_mv, voltage_mv, for_ms=for_ms)
    return robot.pose().x_m * 1000


def spread(
    physics: Physics, read: Callable[[MujocoBody], float], scene: Scene = OPEN_FLOOR
) -> float:
    robot = body(scene, physics)
    return float(np.std([read(robot) for _ in range(500)]))


class TestPhysics:
    def test_battery_v_limits_the_speed(self) -> None:
        faster = math.degrees((8.3 - 7.2) * MEDIUM.torque_nm_v / MEDIUM.drag_nm_s)
        assert free_speed(quiet(battery_v=8.3)) - free_speed(quiet(battery_v=7.2)) == pytest.approx(
            faster, abs=5
        )

    def test_battery_ohm_lets_the_voltage_sag_under_the_motors_load(self) -> None:
        """Two blocked motors draw voltage by resistance each; the firmware's average follows in 0.6
        s."""
        robot = body(physics=quiet(battery_ohm=0.4))
        robot.model.dof_armature[robot.motors.dofs] = 1e6
        now_ms = drive(robot, -9000, 9000, for_ms=20)
        assert robot.battery_mv > 7950
        drive(robot, -9000, 9000, start_ms=now_ms, for_ms=4000)
        assert robot.battery_mv == pytest.approx(8000 / (1 + 2 * 0.4 / MEDIUM.ohm), abs=10)
        drive(robot, 0, 0, start_ms=now_ms + 4000, for_ms=4000)
        assert robot.battery_mv == pytest.approx(8000, abs=10)

    def test_a_voltage_that_the_battery_has_is_given_in_spite_of_the_sag(self) -> None:
        stiff, soft = (body(physics=quiet(battery_ohm=ohm)) for ohm in (0.0, 0.5))
        ways = []
        for robot in (stiff, soft):
            drive(robot, -4000, 4000, for_ms=3000)
            before_m = robot.pose().x_m
            drive(robot, -4000, 4000, start_ms=3000, for_ms=1000)
            ways.append(robot.pose().x_m - before_m)
        assert ways[1] == pytest.approx(ways[0], rel=0.01)

    def test_friction_scale_limits_the_grip(self) -> None:
        assert way_mm(quiet(friction_scale=0.1), 8000, 200) < 0.6 * way_mm(
            quiet(friction_scale=1.0), 8000, 200
        )

    def test_mass_scale_slows(self) -> None:
        assert way_mm(quiet(mass_scale=3.0), 3000, 100) < 0.8 * way_mm(
            quiet(mass_scale=1.0), 3000, 100
        )

    def test_motor_friction_scale_sticks(self) -> None:
        assert way_mm(quiet(motor_friction_scale=1.0), 2000, 500) > 20
        assert way_mm(quiet(motor_friction_scale=5.0), 2000, 500) < 1

    def test_backlash_between_shaft_and_wheel(self) -> None:
        lost = []
        for backlash_deg in (0.0, 5.0):
            robot = body(physics=quiet(backlash_deg=backlash_deg))
            drive(robot, -1500, 1500, for_ms=1000)
            lost.append(robot.angle_mdeg(RIGHT) / 1000 - math.degrees(robot.pose().x_m / 0.028))
        assert lost[1] - lost[0] == pytest.approx(5.0, abs=1.0)

    def test_encoder_resolution_deg_is_the_step_of_the_angle(self) -> None:
        robot = off_the_ground(body(physics=quiet(encoder_resolution_deg=5.0)))
        now_ms = 0
        for _ in range(50):
            now_ms = drive(robot, -4000, 4000, start_ms=now_ms, for_ms=5)
            assert robot.angle_mdeg(RIGHT) % 5000 == 0
        assert robot.angle_mdeg(RIGHT) != 0

    def test_distance_noise_grows_with_the_distance(self) -> None:
        physics = quiet(distance_noise_mm=2.0, distance_noise_ratio=0.01)
        assert spread(
            physics, lambda robot: robot.distance_mm(EYES), before_wall(200)
        ) == pytest.approx(4.0, rel=0.15)
        assert spread(
            physics, lambda robot: robot.distance_mm(EYES), before_wall(1000)
        ) == pytest.approx(12.0, rel=0.15)

    @pytest.mark.parametrize("index", [0, 1])
    def test_tilt_noise_deg(self, index: int) -> None:
        assert spread(
            quiet(tilt_noise_deg=2.0), lambda robot: robot.tilt_deg()[index]
        ) == pytest.approx(2.0, rel=0.15)

    @pytest.mark.parametrize("index", [0, 1, 2])
    def test_gyro_and_acceleration_noise(self, index: int) -> None:
        physics = quiet(gyro_noise_deg_s=3.0, acceleration_noise_mm_s2=100.0)
        assert spread(
            physics, lambda robot: robot.angular_velocity_deg_s()[index]
        ) == pytest.approx(3.0, rel=0.15)
        assert spread(physics, lambda robot: robot.acceleration_mm_s2()[index]) == pytest.approx(
            100.0, rel=0.15
        )

    def test_physics_sets_the_link(self) -> None:
        assert make_body(
            TWO_WHEELER, physics=quiet(link_interval_ms=40.0)
        ).link == dataclasses.replace(PROFILES[DEFAULT_LINK], interval_ms=40.0)


class TestReset:
    SCENE = Scene(wall_distance_mm=(200.0, 300.0), heading_deg=(-5.0, 5.0))

    def test_starts_are_drawn_from_the_scene(self) -> None:
        robot, rng = body(self.SCENE), np.random.default_rng(1)
        readings, headings = [], []
        for _ in range(60):
            robot.reset(rng)
            readings.append(robot.distance_mm(EYES))
            headings.append(robot.pose().heading_deg)
        assert 199 <= min(readings) < 215
        assert 285 < max(readings) <= 301
        assert -5 <= min(headings) < -4
        assert 4 < max(headings) <= 5

    def test_reset_keeps_motors_and_stops_wheels(self) -> None:
        robot = body(self.SCENE)
        now_ms = drive(robot, 3000, -3000, for_ms=700)
        angles = robot.angle_mdeg(LEFT), robot.angle_mdeg(RIGHT)
        robot.reset(np.random.default_rng(2))
        assert (robot.angle_mdeg(LEFT), robot.angle_mdeg(RIGHT)) == angles
        assert robot.angular_velocity_deg_s() == pytest.approx((0, 0, 0))
        start = robot.pose()
        drive(robot, None, None, start_ms=now_ms, for_ms=1000)
        assert robot.pose().x_m == pytest.approx(start.x_m, abs=1e-3)
        assert robot.tilt_deg() == pytest.approx((0, 0), abs=0.2)

    def test_random_physics_are_redrawn(self) -> None:
        robot, rng = body(physics=RandomPhysics()), np.random.default_rng(3)
        seen = []
        for _ in range(3):
            robot.reset(rng)
            seen.append(robot.physics)
            assert robot.battery_mv == round(robot.physics.battery_v * 1000)
            load_kg = robot.physics.side_load_g / 1000
            assert robot.model.body_mass.sum() == pytest.approx(
                0.4283 * robot.physics.mass_scale + load_kg, abs=0.001
            )
        assert len(set(seen)) == 3

    def test_given_physics_are_constant(self) -> None:
        robot = body()
        robot.reset(np.random.default_rng(4))
        assert robot.physics == QUIET


def history(seed: int) -> list[object]:
    robot = MujocoBody(TWO_WHEELER, TestReset.SCENE, RandomPhysics(), seed)
    rng, now_ms, seen = np.random.default_rng(7), 0, []
    for left_mv, right_mv in ((-3000, 3000), (5000, -4000), (None, 0), (2000, 2000)):
        for _ in range(40):
            now_ms = drive(robot, left_mv, right_mv, start_ms=now_ms, for_ms=5)
            seen += [
                robot.distance_mm(EYES),
                robot.tilt_deg(),
                robot.angular_velocity_deg_s(),
                robot.acceleration_mm_s2(),
            ]
            seen += [robot.angle_mdeg(LEFT), robot.heading_deg(), robot.pose()]
        robot.reset(rng)
    return seen


class TestTime:
    def test_equal_seeds_are_bit_identical(self) -> None:
        assert history(5) == history(5)
        assert history(5) != history(6)

    def test_advance_is_independent_of_step_size(self) -> None:
        poses = []
        for grain_ms in (1, 5, 1000):
            robot = body()
            robot.set_voltage(LEFT, -3000)
            robot.set_voltage(RIGHT, 2000)
            for now_ms in range(0, 1001, grain_ms):
                robot.advance_to(now_ms)
            poses.append(robot.pose())
        assert all(
            a == pytest.approx(b, abs=1e-12)
            for a, b in itertools.pairwise(map(dataclasses.astuple, poses))
        )

    def test_two_steps_are_taken_for_each_control_loop(self) -> None:
        robot = body()
        before = robot.data.time
        robot.advance_to(5)
        robot.advance_to(5)
        robot.advance_to(3)
        assert robot.data.time - before == pytest.approx(0.005)


class TestMakeBody:
    def test_make_body_for_two_wheeler_and_bench(self) -> None:
        assert isinstance(make_body(TWO_WHEELER), MujocoBody)
        assert isinstance(make_body(BENCH), BenchBody)

    def test_bench_refuses_wall(self) -> None:
        with pytest.raises(TwinError, match="bench"):
            make_body(BENCH, scene=before_wall(200))

    def test_robot_without_model_is_on_bench(self) -> None:
        assert isinstance(make_body(Robot(name="robo_ant", hub=HubKind.PRIME)), BenchBody)


def test_bodies_of_same_robot_are_independent() -> None:
    first = body()
    nominal = first.model.body_mass.copy()
    heavy = body(physics=quiet(mass_scale=1.2))
    assert np.allclose(heavy.model.body_mass, 1.2 * nominal)
    assert np.array_equal(first.model.body_mass, nominal)
    assert np.array_equal(body().model.body_mass, nominal)
