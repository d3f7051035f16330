from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any

import mujoco
import numpy as np
import pytest

from brickhub.errors import TwinError
from brickhub.virtual.firmware.control import OnCompletion
from brickhub.virtual.machine import Machine
from bricktwin.robots import ROBO_ARM
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
START = {"rotation": 0, "low": 40, "high": -70, "grab": -96}
WITH_BALL = Scene(ball=True)


class Arm:
    """A RoboArm with firmware servos."""

    def __init__(
        self, physics: Physics | RandomPhysics = QUIET, scene: Scene = OPEN_FLOOR, seed: int = 0
    ) -> None:
        body = make_body(ROBO_ARM, scene=scene, physics=physics, seed=seed)
        assert isinstance(body, MujocoBody)
        self.body, self.machine = body, Machine(body)
        self.servos = {motor.name: self.machine.servos[motor.port] for motor in ROBO_ARM.motors}
        for motor in ROBO_ARM.motors:
            ratio = round(1000 * motor.gears[1] / motor.gears[0]) if motor.gears else 1000
            self.servos[motor.name].setup(motor.direction, ratio, True, 0)

    def angles(self) -> dict[str, int]:
        return {name: servo.angle_deg() for name, servo in self.servos.items()}

    def go(self, **targets: int) -> None:
        for name, angle in targets.items():
            self.servos[name].run_target(250, angle, OnCompletion.HOLD)
        self.machine.advance(2000)

    def place(self, name: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """Position of a body in the world, m."""
        mujoco.mj_kinematics(self.body.model, self.body.data)
        return np.array(self.body.data.body(name).xpos)

    def place_of_ball(self) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        mujoco.mj_kinematics(self.body.model, self.body.data)
        return np.array(self.body.data.geom("ball").xpos)

    def ball_to_m(self, name: str) -> float:
        """Distance of the ball's centre from what is drawn of a body."""
        model, data, ball = self.body.model, self.body.data, self.place_of_ball()
        distances = []
        for geom in np.flatnonzero(model.geom_bodyid == model.body(name).id):
            if (mesh := model.geom_dataid[geom]) >= 0:
                start = model.mesh_vertadr[mesh]
                points = model.mesh_vert[start : start + model.mesh_vertnum[mesh]]
                apart = points @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom] - ball
                distances.append(np.linalg.norm(apart, axis=1).min())
        return float(min(distances))

    def fingertips_apart_mm(self) -> float:
        mujoco.mj_kinematics(self.body.model, self.body.data)
        tips = []
        for name in ("driven_E", "part_4"):
            finger = self.body.data.body(name)
            tips.append(finger.xpos + 0.052 * finger.xmat.reshape(3, 3)[:, 0])
        return float(np.linalg.norm(tips[0] - tips[1])) * 1000


def quiet(**values: Any) -> Physics:
    return dataclasses.replace(QUIET, **values)


class TestModel:
    def test_wall_raises(self) -> None:
        with pytest.raises(TwinError, match="wall"):
            load_model(ROBO_ARM, Scene(wall_distance_mm=(200.0, 300.0)))
        with pytest.raises(TwinError, match="heading_deg"):
            load_model(ROBO_ARM, Scene(heading_deg=(-5.0, 5.0)))

    def test_model_has_cameras(self) -> None:
        model = load_model(ROBO_ARM, OPEN_FLOOR).compile()
        assert {model.camera(index).name for index in range(model.ncam)} == {
            "overview",
            "webcam",
            "chase",
            "portrait",
        }
        np.testing.assert_allclose(model.camera("webcam").pos, [0, 0, 0.68])

    def test_ball_only_in_scene_with_ball(self) -> None:
        assert load_model(ROBO_ARM, WITH_BALL).compile().geom("ball").size[0] == pytest.approx(
            0.024
        )
        with pytest.raises(KeyError):
            load_model(ROBO_ARM, OPEN_FLOOR).compile().geom("ball")

    def test_no_self_contact_at_range_ends(self) -> None:
        # Nothing is made to collide, so the ranges must keep the ball off the floor and off all but
        # the gripper.
        arm = Arm(scene=WITH_BALL)
        for low, high in itertools.product((10, 70), (-150, 10)):
            arm.go(low=low, high=high, grab=-96)
            assert arm.place_of_ball()[2] > 0.024 + 0.01
            for name in ("base", "driven_B", "driven_D", "spin_D_0", "spin_B_1", "spin_A_2"):
                assert arm.ball_to_m(name) > 0.024 + 0.01, name
            assert arm.body.data.ncon == 0


class TestAtRest:
    def test_hub_reads_start_angles(self) -> None:
        assert Arm().angles() == START

    @pytest.mark.parametrize("scene", [OPEN_FLOOR, WITH_BALL], ids=["empty", "ball"])
    def test_arm_stands_while_coasting(self, scene: Scene) -> None:
        arm = Arm(scene=scene)
        arm.machine.advance(10_000)
        assert arm.angles() == pytest.approx(START, abs=1)

    def test_heavy_arm_with_low_friction_stands(self) -> None:
        arm = Arm(quiet(mass_scale=1.15, motor_friction_scale=0.7))
        arm.machine.advance(10_000)
        assert arm.angles() == pytest.approx(START, abs=1)

    def test_arm_without_friction_sinks(self) -> None:
        arm = Arm(quiet(mass_scale=3.0, motor_friction_scale=0.0))
        arm.machine.advance(3000)
        assert arm.angles()["low"] > 70
        assert arm.angles()["high"] < -100

    def test_hub_is_flat(self) -> None:
        arm = Arm()
        arm.machine.advance(1000)
        assert arm.body.tilt_deg() == pytest.approx((0, 0), abs=0.01)
        assert arm.body.acceleration_mm_s2() == pytest.approx((0, 0, 9810), abs=10)
        assert arm.body.angular_velocity_deg_s() == pytest.approx((0, 0, 0), abs=0.1)
        assert dataclasses.astuple(arm.body.pose()) == (0, 0, pytest.approx(0, abs=0.1))


class TestJoints:
    @pytest.mark.parametrize(
        ("joint", "angle"),
        [
            ("rotation", -90),
            ("rotation", 100),
            ("low", 10),
            ("low", 70),
            ("high", -150),
            ("high", 10),
            ("grab", -148),
            ("grab", -45),
        ],
    )
    def test_joint_reaches_and_holds_target(self, joint: str, angle: int) -> None:
        arm = Arm(scene=WITH_BALL if joint != "grab" else OPEN_FLOOR)
        arm.go(**{joint: angle})
        assert arm.servos[joint].is_done()
        held = arm.angles()
        assert held[joint] == pytest.approx(angle, abs=6)
        arm.machine.advance(3000)
        assert arm.angles() == pytest.approx(held, abs=1)
        assert {name: angle for name, angle in held.items() if name != joint} == pytest.approx(
            {name: angle for name, angle in START.items() if name != joint}, abs=2
        )

    def test_joints_move_together(self) -> None:
        arm = Arm()
        for name, angle in (("rotation", 50), ("low", -20), ("high", -40), ("grab", 25)):
            arm.servos[name].run_angle(250, angle, OnCompletion.HOLD)
        arm.machine.advance(1500)
        assert arm.angles() == pytest.approx(
            {"rotation": 50, "low": 20, "high": -110, "grab": -70}, abs=6
        )

    def test_end_stops_are_near_range(self) -> None:
        arm = Arm()
        for name in ("low", "high", "grab"):
            arm.servos[name].dc(60)
        arm.machine.advance(2000)
        highest = arm.angles()
        for name in ("low", "high", "grab"):
            arm.servos[name].dc(-60)
        arm.machine.advance(2000)
        for name, (low, high) in {
            m.name: m.range_deg for m in ROBO_ARM.motors if m.range_deg
        }.items():
            assert high + 5 < highest[name] < high + 20
            assert low - 20 < arm.angles()[name] < low - 5

    def test_turntable_is_unlimited_with_ratio_3(self) -> None:
        arm = Arm()
        arm.servos["rotation"].run_angle(250, 800, OnCompletion.HOLD)
        arm.machine.advance(5000)
        assert arm.angles()["rotation"] == pytest.approx(800, abs=4)
        assert arm.body.angle_mdeg("B") / 1000 == pytest.approx(2400, abs=12)
        # Counter-clockwise from above, which headings count negative.
        assert arm.body.pose().heading_deg == pytest.approx(-800, abs=5)
        assert arm.body.heading_deg() == pytest.approx(-800, abs=5)

    def test_gyroscope_measures_turntable(self) -> None:
        arm = Arm()
        arm.servos["rotation"].run(100)
        arm.machine.advance(1500)
        assert arm.body.angular_velocity_deg_s() == pytest.approx((0, 0, 100), abs=15)

    def test_low_leans_and_high_lifts(self) -> None:
        arm = Arm()
        elbow, wrist = arm.place("driven_A"), arm.place("part_4")
        arm.go(low=70)
        assert arm.place("driven_A")[0] > elbow[0] + 0.01
        arm.go(low=40, high=10)
        assert arm.place("part_4")[2] > wrist[2] + 0.03

    def test_gripper_closes_until_contact(self) -> None:
        arm = Arm()
        arm.go(grab=-148)
        assert arm.fingertips_apart_mm() < 14
        arm.go(grab=-45)
        assert arm.fingertips_apart_mm() > 80

    def test_fingers_mirror(self) -> None:
        arm, worst = Arm(quiet(backlash_deg=0.0)), 0.0
        arm.servos["grab"].run_target(600, -140, OnCompletion.HOLD)
        for _ in range(200):
            arm.machine.advance(5)
            data = arm.body.data
            moved = data.joint("motor_E").qpos[0] - arm.body.model.joint("motor_E").qpos0[0]
            worst = max(worst, abs(data.joint("turn_4").qpos[0] + moved))
        turned_deg = arm.angles()["grab"] - START["grab"]
        assert turned_deg == pytest.approx(-44, abs=6)
        assert math.degrees(moved) == pytest.approx(-0.5 * turned_deg, abs=1.0)  # gears halve it
        assert math.degrees(worst) < 1.0


class TestWebcam:
    def pixel(self, arm: Arm) -> tuple[float, float]:
        """Pixel of the ball's centre in an image of 640 x 480."""
        model, data = arm.body.model, arm.body.data
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        camera = data.camera("webcam")
        x, y, z = camera.xmat.reshape(3, 3).T @ (data.geom("ball").xpos - camera.xpos)
        focal = 240 / math.tan(math.radians(model.camera("webcam").fovy[0]) / 2)
        return 320 - focal * x / z, 240 + focal * y / z

    def test_webcam_view_of_arm(self) -> None:
        arm = Arm(scene=WITH_BALL)
        x, y = self.pixel(arm)
        assert x == pytest.approx(320, abs=1)
        assert 350 < y < 460
        arm.go(rotation=90)
        x, y = self.pixel(arm)
        assert 430 < x < 540
        assert y == pytest.approx(240, abs=15)

    def test_goal_circle_is_reachable(self) -> None:
        arm = Arm(scene=WITH_BALL)
        arm.go(low=10, high=-150)
        assert math.dist(self.pixel(arm), (320, 240)) < 150
        arm.go(low=70, high=10)
        assert math.dist(self.pixel(arm), (320, 240)) > 215


class TestReset:
    def test_reset_keeps_motor_angles(self) -> None:
        arm = Arm()
        arm.go(rotation=30, low=20, high=-120, grab=-60)
        held = arm.angles()
        arm.body.reset(np.random.default_rng(0))
        assert arm.angles() == held
        arm.machine.advance(1000)
        assert arm.angles() == pytest.approx(held, abs=2)

    def test_random_physics_have_effect(self) -> None:
        arm, rng, seen = Arm(RandomPhysics()), np.random.default_rng(1), []
        for _ in range(3):
            arm.body.reset(rng)
            physics, model = arm.body.physics, arm.body.model
            seen.append(physics)
            assert model.body_mass.sum() == pytest.approx(0.595 * physics.mass_scale, abs=0.002)
            assert model.joint("backlash_D").range[1] == pytest.approx(
                math.radians(physics.backlash_deg)
            )
            assert model.joint("motor_D").frictionloss[0] == pytest.approx(
                3 * 0.033 + 3 * 0.021413 * physics.motor_friction_scale
            )
        assert len(set(seen)) == 3

    def test_equal_seeds_are_bit_identical(self) -> None:
        def history(seed: int) -> list[Any]:
            arm, seen = Arm(RandomPhysics(), seed=seed), []
            for turn in (20, -30):
                for servo in arm.servos.values():
                    servo.run_angle(250, turn, OnCompletion.HOLD)
                for _ in range(50):
                    arm.machine.advance(5)
                    seen.append(
                        (
                            arm.angles(),
                            arm.body.tilt_deg(),
                            arm.body.acceleration_mm_s2(),
                            arm.body.heading_deg(),
                        )
                    )
                arm.body.reset(np.random.default_rng(4))
            return seen

        assert history(5) == history(5)
        assert history(5) != history(6)

    def test_backlash_between_motor_and_turntable(self) -> None:
        def turned(backlash_deg: float) -> float:
            arm = Arm(quiet(backlash_deg=backlash_deg))
            arm.go(rotation=90)
            return abs(arm.body.pose().heading_deg)

        assert abs(turned(5.0) - 90) < 6
        assert abs(turned(0.0) - 90) < 2
