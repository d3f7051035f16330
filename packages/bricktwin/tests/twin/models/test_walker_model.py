from __future__ import annotations

import dataclasses
import math
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest

from brickhub.errors import TwinError
from brickhub.virtual.firmware.control import OnCompletion
from brickhub.virtual.machine import Machine
from bricktwin.robots import WALKER
from bricktwin.twin.make_body import make_body
from bricktwin.twin.models.load import load_model
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
LEGS = ("left_front", "right_front", "left_back", "right_back")
TROT, PACE, BOUND, PRONK = (0, 180, 180, 0), (0, 180, 0, 180), (0, 0, 180, 180), (0, 0, 0, 0)
Phases = tuple[int, int, int, int]


def quiet(**values: Any) -> Physics:
    return dataclasses.replace(QUIET, **values)


class Walking:
    """A Walker with firmware servos."""

    def __init__(
        self, physics: Physics | RandomPhysics = QUIET, scene: Scene = OPEN_FLOOR, seed: int = 0
    ) -> None:
        body = make_body(WALKER, scene=scene, physics=physics, seed=seed)
        assert isinstance(body, MujocoBody)
        self.body, self.machine = body, Machine(body)
        self.servos = [self.machine.servos[WALKER.motor(leg).port] for leg in LEGS]
        for leg, servo in zip(LEGS, self.servos, strict=True):
            servo.setup(WALKER.motor(leg).direction, 1000, True, 0)

    def angles(self) -> list[int]:
        return [servo.angle_deg() for servo in self.servos]

    def pose_legs(self, angles: tuple[int, ...]) -> None:
        for servo, angle in zip(self.servos, angles, strict=True):
            servo.run_target(600, angle, OnCompletion.HOLD)
        self.machine.advance(1200)

    def put_down(self) -> None:
        self.body.reset(np.random.default_rng(0))

    def walk(self, steps: int, angle: int = -100) -> float:
        """Steps as in ``Walker-v0``. Returns the largest tilt in degrees."""
        tilt = 0.0
        for _ in range(steps):
            for servo in self.servos:
                servo.run_angle(600, angle, OnCompletion.HOLD)
            self.machine.advance(250)
            tilt = max(tilt, *map(abs, self.body.tilt_deg()))
        return tilt

    def loop_error_mm(self) -> float:
        """Distance error of a rocker's pins; one step behind the joints."""
        sites = self.body.data.site
        apart = [
            np.linalg.norm(sites(f"rod_{port}_far").xpos - sites(f"rod_{port}_near").xpos)
            for port in "ABCD"
        ]
        return float(np.abs(np.array(apart) - 0.032).max()) * 1000


@pytest.mark.parametrize("legs", [(304, 86, 84, 138), (300, 79, 80, 136)])
def test_a_robot_is_put_down_where_it_stays(legs: tuple[int, ...]) -> None:
    """It could stand on the ends of two legs, too, at 38 degrees."""
    walker = Walking()
    walker.pose_legs(legs)
    walker.put_down()
    start, (pitch_deg, roll_deg) = walker.body.pose(), walker.body.tilt_deg()
    assert max(abs(pitch_deg), abs(roll_deg)) < 10
    walker.machine.advance(1000)
    end = walker.body.pose()
    assert 1000 * math.hypot(end.x_m - start.x_m, end.y_m - start.y_m) < 3
    assert walker.body.tilt_deg() == pytest.approx((pitch_deg, roll_deg), abs=2)


def speed_m_s(
    phases: Phases, physics: Physics = QUIET, angle: int = -100, steps: int = 12
) -> float:
    """Forward speed of a gait: equal cranks with these phases."""
    robot = Walking(physics)
    robot.pose_legs(tuple(-phase for phase in phases))
    robot.put_down()
    start = robot.body.pose().x_m
    assert robot.walk(steps, angle) < 15
    return (robot.body.pose().x_m - start) / (0.25 * steps)


@cache
def model() -> mujoco.MjModel:
    return load_model(WALKER, OPEN_FLOOR).compile()


class TestModel:
    def test_masses_and_dimensions_match_robot(self) -> None:
        assert model().body_mass.sum() == pytest.approx(0.560, abs=0.001)
        corners = {port: np.sign(model().body(f"rotor_{port}").pos[:2]).tolist() for port in "DCBA"}
        assert corners == {"D": [1, 1], "C": [1, -1], "B": [-1, 1], "A": [-1, -1]}

    def test_loops_are_closed_initially(self) -> None:
        data = mujoco.MjData(model())
        mujoco.mj_forward(model(), data)
        open_by = data.efc_pos[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]
        assert len(open_by) == 4
        assert np.abs(open_by).max() < 1e-9
        assert Walking().loop_error_mm() < 0.01  # under the weight of the standing robot

    def test_only_feet_and_frame_touch_floor(self) -> None:
        assert not (model().geom_contype.any() or model().geom_conaffinity.any())
        below, above = model().pair_geom1, model().pair_geom2
        assert {model().geom(index).name for index in below} == {"floor"}
        legs = {model().body(model().geom(f"foot_{port}").bodyid[0]).name for port in "ABCD"}
        bodies = {model().body(body).name for body in model().geom_bodyid[above]}
        assert bodies == {"chassis", *legs, *(f"driven_{port}" for port in "ABCD")}
        assert {f"foot_{port}" for port in "ABCD"} <= {model().geom(index).name for index in above}

    def test_contacts_follow_shapes(self) -> None:
        model = load_model(WALKER, Scene(wall_distance_mm=(100, 100))).compile()
        assert {model.geom(index).name for index in model.pair_geom1} == {"floor", "wall"}
        for above, friction, solref in zip(
            model.pair_geom2, model.pair_friction, model.pair_solref, strict=True
        ):
            shape = model.geom(above)
            assert friction.tolist() == shape.friction[[0, 0, 1, 2, 2]].tolist()
            assert solref.tolist() == shape.solref.tolist()

    def test_walker_cannot_hold_ball(self) -> None:
        with pytest.raises(TwinError, match="no gripper"):
            make_body(WALKER, scene=Scene(ball=True))


class TestAtRest:
    def test_walker_stands_level_while_coasting(self) -> None:
        robot = Walking()
        assert robot.angles() == [0, 0, 0, 0]
        start = robot.body.pose()
        robot.machine.advance(5000)
        end = robot.body.pose()
        assert (end.x_m, end.y_m) == pytest.approx((start.x_m, start.y_m), abs=1e-3)
        assert end.heading_deg == pytest.approx(0.0, abs=0.01)
        assert robot.body.tilt_deg() == pytest.approx((0, 0), abs=0.5)
        assert robot.body.acceleration_mm_s2() == pytest.approx((0, 0, 9810), abs=60)
        assert robot.angles() == pytest.approx([0, 0, 0, 0], abs=1)

    def test_held_legs_are_still(self) -> None:
        robot = Walking()
        robot.pose_legs((0, -180, -180, 0))
        robot.put_down()
        robot.machine.advance(500)
        start = robot.body.pose()
        robot.machine.advance(5000)
        assert robot.body.pose().x_m == pytest.approx(start.x_m, abs=1e-4)
        assert robot.body.pose().y_m == pytest.approx(start.y_m, abs=1e-4)

    def test_walker_sees_wall(self) -> None:
        robot = Walking(scene=Scene(wall_distance_mm=(300.0, 300.0)))
        assert robot.body.distance_mm("E") == pytest.approx(300, abs=2)


class TestLegs:
    def foot(self, robot: Walking, port: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """Foot position of a suspended robot in the chassis frame, m."""
        mujoco.mj_kinematics(robot.body.model, robot.body.data)
        chassis = robot.body.data.body("chassis")
        return (robot.body.data.geom(f"foot_{port}").xpos - chassis.xpos) @ chassis.xmat.reshape(
            3, 3
        )

    def hanging(self) -> Walking:
        robot = Walking()
        robot.body.model.opt.gravity[:] = 0
        robot.body.data.qpos[2] = 0.5
        return robot

    @pytest.mark.parametrize("leg", LEGS)
    def test_negative_turn_moves_foot_back_below(self, leg: str) -> None:
        robot, index, port = self.hanging(), LEGS.index(leg), WALKER.motor(leg).port
        places = []
        for quarter in range(4):
            robot.pose_legs(tuple(-90 * quarter if i == index else 0 for i in range(4)))
            places.append(self.foot(robot, port) - robot.body.model.body(f"rotor_{port}").pos)
        low, back, high, front = places
        assert low[2] == pytest.approx(-0.064, abs=0.002)
        assert high[2] - low[2] == pytest.approx(0.016, abs=0.003)
        assert back[0] < low[0] - 0.01 < low[0] + 0.01 < front[0]

    def test_foot_path_follows_linkage(self) -> None:
        robot, worst_mm = self.hanging(), 0.0
        robot.servos[0].run(-300)
        for _ in range(260):
            robot.machine.advance(5)
            foot = self.foot(robot, "D") - robot.body.model.body("rotor_D").pos
            data = robot.body.data
            turn = float(data.joint("motor_D").qpos[0] + data.joint("backlash_D").qpos[0])
            # About the crank's axis, x and z: the leg's upper end is 40 mm from the crank's pin and
            # 32 mm from the rocker's.
            crank, rocker = (
                -0.008 * np.array([math.sin(turn), math.cos(turn)]),
                np.array([-0.032, 0.040]),
            )
            distance, across = np.linalg.norm(rocker - crank), (rocker - crank)[::-1] * (1, -1)
            along = (distance**2 + 0.040**2 - 0.032**2) / (2 * distance)
            end = ((rocker - crank) * along + across * math.sqrt(0.040**2 - along**2)) / distance
            expected = crank - end * 56 / 40
            worst_mm = max(worst_mm, 1000 * float(np.linalg.norm(foot[[0, 2]] - expected)))
        assert robot.angles()[0] < -360
        assert worst_mm < 0.1

    def test_other_legs_stay(self) -> None:
        robot = self.hanging()
        before = [self.foot(robot, port) for port in "CBA"]
        robot.pose_legs((-120, 0, 0, 0))
        np.testing.assert_allclose([self.foot(robot, port) for port in "CBA"], before, atol=0.003)

    def test_loops_stay_closed_in_fast_turn(self) -> None:
        robot, worst = Walking(), 0.0
        for servo in robot.servos:
            servo.run(-900)
        for _ in range(200):
            robot.machine.advance(5)
            worst = max(worst, robot.loop_error_mm())
        assert robot.angles()[0] < -600
        assert worst < 1.5

    def test_command_is_reached_within_tolerance(self) -> None:
        # The firmware calls a target reached within 11 degrees of it, and under load leaves up to 8
        # of them.
        for robot, tolerance_deg in ((self.hanging(), 2), (Walking(), 11)):
            for servo, angle in zip(robot.servos, (-100, -37, 80, -250), strict=True):
                servo.run_angle(600, angle, OnCompletion.HOLD)
            robot.machine.advance(1000)
            assert all(servo.is_done() for servo in robot.servos)
            assert robot.angles() == pytest.approx([-100, -37, 80, -250], abs=tolerance_deg)


class TestGaits:
    def test_trot_goes_straight_forward(self) -> None:
        robot = Walking()
        robot.pose_legs(tuple(-phase for phase in TROT))
        robot.put_down()
        tilt = robot.walk(20)
        pose = robot.body.pose()
        assert 0.06 < pose.x_m / 5.0 < 0.11
        assert abs(pose.y_m) < 0.05
        assert abs(pose.heading_deg) < 15
        assert 3 < tilt < 15
        assert robot.loop_error_mm() < 1.0

    def test_bound_goes_backward_pronk_stays(self) -> None:
        assert -0.09 < speed_m_s(BOUND) < -0.02
        assert abs(speed_m_s(PRONK)) < 0.015

    def test_pace_is_slower_than_trot(self) -> None:
        assert 0.05 < speed_m_s(PACE) / speed_m_s(TROT) < 0.25

    def test_reversed_trot_goes_backward(self) -> None:
        assert speed_m_s(TROT, angle=100) < -0.04

    def test_random_policy_hardly_advances_and_never_falls(self) -> None:
        robot, rng = Walking(seed=3), np.random.default_rng(3)
        for _ in range(40):
            for servo in robot.servos:
                servo.run_angle(600, int(rng.uniform(-100, 0)), OnCompletion.HOLD)
            robot.machine.advance(250)
            assert max(map(abs, robot.body.tilt_deg())) < 20
        assert abs(robot.body.pose().x_m) < 0.4


class TestReset:
    def test_feet_touch_floor_at_all_angles(self) -> None:
        robot, rng = Walking(), np.random.default_rng(1)
        for _ in range(6):
            robot.pose_legs(tuple(rng.integers(-180, 180, 4).tolist()))
            before = robot.angles()
            robot.body.reset(rng)
            assert robot.angles() == before
            data = robot.body.data
            feet = [data.geom(f"foot_{port}") for port in "ABCD"]
            half, radius = robot.body.model.geom("foot_A").size[[1, 0]]
            lowest = sorted(foot.xpos[2] - half * abs(foot.xmat[8]) - radius for foot in feet)
            # A contact carries weight at a depth of some tenths of a millimetre.
            assert lowest[0] == pytest.approx(0.0, abs=5e-4)
            assert lowest[1] == pytest.approx(0.0, abs=5e-4)
            height_m = data.qpos[2]
            robot.machine.advance(300)
            assert data.ncon >= 2
            assert abs(data.qpos[2] - height_m) < 0.001

    def test_reset_from_any_place(self) -> None:
        robot = Walking()
        robot.walk(8)
        robot.body.data.qpos[:7] = (3.0, -1.0, 0.4, 0.0, 1.0, 0.0, 0.0)
        robot.put_down()
        pose = robot.body.pose()
        assert (pose.x_m, pose.y_m) == pytest.approx((0.0, 0.0), abs=1e-6)
        assert max(map(abs, robot.body.tilt_deg())) < 12
        assert robot.body.angular_velocity_deg_s() == (0, 0, 0)

    def test_random_physics_have_effect(self) -> None:
        robot, rng, seen = Walking(RandomPhysics()), np.random.default_rng(2), []
        for _ in range(3):
            robot.body.reset(rng)
            seen.append(robot.body.physics)
            kg = 0.5604 * robot.body.physics.mass_scale + robot.body.physics.side_load_g / 1000
            assert robot.body.model.body_mass.sum() == pytest.approx(kg, abs=0.001)
            assert robot.body.model.joint("backlash_A").range[1] == pytest.approx(
                math.radians(robot.body.physics.backlash_deg)
            )
        assert len(set(seen)) == 3


class TestPhysics:
    def test_slippery_floor_slides(self) -> None:
        def slide_m(friction_scale: float) -> float:
            robot = Walking(quiet(friction_scale=friction_scale))
            robot.machine.advance(500)
            start = robot.body.pose().x_m
            robot.body.data.qvel[0] = 0.5
            robot.machine.advance(2000)
            return robot.body.pose().x_m - start

        # From 0.5 m/s it takes v^2 / (2 mu g) to stop.
        assert slide_m(0.25) == pytest.approx(0.5**2 / (2 * 0.2 * 9.81), rel=0.2)
        assert slide_m(0.5) == pytest.approx(0.5**2 / (2 * 0.4 * 9.81), rel=0.2)

    def test_worn_motors_are_slow(self) -> None:
        def turned(motor_friction_scale: float) -> int:
            robot = Walking(quiet(motor_friction_scale=motor_friction_scale))
            for servo in robot.servos:
                servo.dc(-30)
            robot.machine.advance(1000)
            return -robot.angles()[0]

        assert turned(0.7) > 1.15 * turned(1.5) > 0

    def test_load_slows_legs(self) -> None:
        def turned(mass_scale: float) -> list[int]:
            robot = Walking(quiet(mass_scale=mass_scale))
            robot.pose_legs(tuple(-phase for phase in TROT))
            robot.put_down()
            before = robot.angles()
            for servo in robot.servos:
                servo.dc(-28)
            robot.machine.advance(2000)
            return [start - end for start, end in zip(before, robot.angles(), strict=True)]

        for heavy, light in zip(turned(3.0), turned(1.0), strict=True):
            assert 0 < heavy < 0.6 * light

    def test_low_battery_slows_legs(self) -> None:
        def turned(battery_v: float) -> int:
            robot = Walking(quiet(battery_v=battery_v))
            for servo in robot.servos:
                servo.dc(-100)
            robot.machine.advance(1000)
            return -robot.angles()[0]

        assert turned(8.3) > 1.2 * turned(6.0)

    def test_equal_seeds_are_bit_identical(self) -> None:
        def history(seed: int) -> list[Any]:
            robot, seen = Walking(RandomPhysics(), seed=seed), []
            for _ in range(4):
                robot.walk(2)
                seen += [
                    robot.angles(),
                    robot.body.tilt_deg(),
                    robot.body.pose(),
                    robot.body.distance_mm("E"),
                ]
                robot.put_down()
            return seen

        assert history(5) == history(5)
        assert history(5) != history(6)
