"""Bodies with EV3's motors and sensors: play, current, cones, ranges, a gyroscope that drifts."""

from __future__ import annotations

import dataclasses
import io
import math
from pathlib import Path

import numpy as np
import pytest

from brickhub.hub.link.profiles import PROFILES
from brickhub.robot import (
    DriveBase,
    HubKind,
    Motor,
    MotorKind,
    PoweredUpSensor,
    Robot,
    Sense,
    SensorKind,
)
from brickhub.virtual.run import run_file
from bricktwin.twin.engines.conventions import BACKLASH
from bricktwin.twin.make_body import make_body
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.objects import Beacon, Block, Object
from bricktwin.twin.physics import DRAWN_CABLES, Physics, RandomPhysics
from bricktwin.twin.scene import Scene

CART = Robot(
    "cart",
    HubKind.EV3,
    motors=(
        Motor("left", "B", MotorKind.EV3_LARGE),
        Motor("right", "C", MotorKind.EV3_LARGE),
        Motor("tool", "A", MotorKind.EV3_MEDIUM),
    ),
    sensors=(
        PoweredUpSensor("eyes", "4", SensorKind.EV3_ULTRASONIC),
        PoweredUpSensor("gyro", "2", SensorKind.EV3_GYRO),
    ),
    drive_base=DriveBase("left", "right", wheel_diameter_mm=56, axle_track_mm=120),
)
SEER = dataclasses.replace(
    CART, sensors=(PoweredUpSensor("infrared", "4", SensorKind.EV3_INFRARED),)
)
QUIET = Physics(distance_noise_mm=0, distance_noise_ratio=0, gyro_noise_deg_s=0)


def body(robot: Robot = CART, *objects: Object, **values: float) -> MujocoBody:
    physics = dataclasses.replace(QUIET, **values)
    return MujocoBody(robot, Scene(objects=objects), physics, 0)


def test_its_link_is_a_cable() -> None:
    assert make_body(CART).link == PROFILES["usb"]
    drawn = make_body(CART, physics=RandomPhysics())
    drawn.reset(np.random.default_rng(0))
    assert drawn.link in DRAWN_CABLES


def test_play_of_the_gears() -> None:
    cart = body()
    ranges = cart.engine.parameters("jnt_range")
    plays_deg = {}
    for joint, name in enumerate(cart.engine.names("joint")):
        if BACKLASH in name:
            plays_deg[name[-1]] = math.degrees(ranges[2 * joint + 1])
    assert plays_deg == pytest.approx({"B": 1.5, "C": 1.5}), "3 degrees at the hub in all"


def test_a_reversed_motor_gets_the_current_of_an_ev3() -> None:
    cart = body(battery_v=9.0)
    cart.model.opt.gravity[:], cart.data.qpos[2] = 0.0, 1.0
    cart.set_voltage("B", 9000)
    cart.advance_to(1000)
    cart.set_voltage("B", -9000)
    cart.advance_to(1005)
    torque_nm = cart.data.actuator_force[cart.actuator("B")]
    assert torque_nm == pytest.approx(-1.63 * 0.2746, rel=1e-3)


def test_range_and_cone_of_the_ultrasonic_sensor() -> None:
    assert body().distance_mm("4") == 2550, "nothing in sight"
    assert body(CART, Block((2300, 0), (100, 100, 100))).distance_mm("4") == pytest.approx(2190, 2)
    # Its eye is 60 mm ahead of the axle.
    aside = Block((460, 400 * math.tan(math.radians(15)), 0)[:2], (10, 10, 100), round=True)
    assert body(CART, aside).distance_mm("4") == pytest.approx(409, abs=8), "15 degrees aside"


def test_infrared_sees_obstacles_and_the_beacon() -> None:
    ahead = Block((445, 0), (70, 70, 100))
    assert body(SEER, ahead).sensed("4", Sense.DISTANCE) == pytest.approx(50, abs=0.1)
    assert body(SEER).sensed("4", Sense.DISTANCE) == 100.0
    assert body(SEER).sensed("4", Sense.BEACON) == ()
    right = Beacon((560, -500, 40))
    distance_pct, direction_deg = body(SEER, right).sensed("4", Sense.BEACON)
    assert distance_pct == pytest.approx(100 * math.hypot(500, 500) / 2000, abs=0.1)
    assert direction_deg == pytest.approx(45, abs=0.2)
    assert body(SEER, right, Block((310, -250))).sensed("4", Sense.BEACON) == (), "hidden"
    assert body(SEER, Beacon((-200, 0, 40))).sensed("4", Sense.BEACON) == (), "behind"


PROGRAM = """
from pybricks.ev3devices import GyroSensor, Motor
from pybricks.parameters import Port
from pybricks.tools import wait
gyro = GyroSensor(Port.S2)
wait(10000)
print(gyro.angle(), end=" ")
gyro.calibrate()
wait(10000)
print(gyro.angle(), end=" ")
left, right = Motor(Port.B), Motor(Port.C)
gyro.reset_angle(0)
left.run(200)
right.run(-200)
wait(1500)
print(gyro.speed(), end=" ")
gyro.calibrate()
print(gyro.speed(), end=" ")
left.stop()
right.stop()
wait(1000)
print(gyro.speed())
"""


def test_a_gyroscope_drifts_until_it_is_calibrated_at_rest(tmp_path: Path) -> None:
    (tmp_path / "main.py").write_text(PROGRAM)
    out = io.BytesIO()
    assert run_file(tmp_path / "main.py", body(gyro_drift_deg_min=3.0), stdout=out) == 0
    drifted, calibrated, turning, rest, after = map(int, out.getvalue().split())
    # Ten times 3 degrees a minute, 10 s long; calibrated at rest, it drifts no more.
    assert (drifted, calibrated) == (5, 0)
    # Wheels of 56 mm at 200 deg/s, 120 mm apart; what turns meanwhile is rest to it.
    assert turning == pytest.approx(93, abs=4)
    assert rest == pytest.approx(0, abs=4)
    assert after == pytest.approx(-93, abs=4)
