"""Bench twin: free motors, sensors with readings of the scene."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from brickhub.errors import DescriptionError, TwinError
from brickhub.hub.interface import Distance, Interface, MotorAngle, RunAngle, SensorReading, Wait
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.program.generate import generate
from brickhub.robot import (
    Direction,
    HubKind,
    Motor,
    PoweredUpSensor,
    Robot,
    SensorKind,
    UltrasonicSensor,
)
from brickhub.virtual.pybricks import pupsensors
from brickhub.virtual.pybricks.ev3 import ev3sensors
from brickhub.virtual.virtual_transport import VirtualHub
from bricktwin.robots import TWO_WHEELER, WALKER
from bricktwin.twin.make_body import make_body
from bricktwin.twin.physics import Physics, RandomPhysics
from bricktwin.twin.scene import Scene

ROBOT = Robot(
    "crank",
    HubKind.TECHNIC,
    motors=(
        Motor("crank", "A", direction=Direction.COUNTERCLOCKWISE, gears=(12, 36)),
        Motor("other", "C"),
    ),
    sensors=(PoweredUpSensor("light", "B", SensorKind.COLOR), UltrasonicSensor("eyes", "D")),
)
CHANNELS = (
    MotorAngle("crank", -1000, 1000),
    SensorReading("light", "reflection", 0, 100, "%"),
    Distance("eyes"),
)
INTERFACE = Interface((RunAngle("crank", -90, 90, 500),), CHANNELS, Wait(1200))
SCENE = Scene(
    readings={
        "light": lambda angles: 50 + angles["crank"] / 10,
        "eyes": lambda angles: 500 + angles["crank"],
    }
)


def readings(scene: Scene, command: float) -> list[float]:
    with HubLink(VirtualHub(make_body(ROBOT, scene=scene)), ROBOT, INTERFACE) as link:
        return list(link.act([command]).values)


@pytest.mark.parametrize("command", [80.0, -60.0])
def test_readings_follow_motor_angles(command: float) -> None:
    angle, light, distance = readings(SCENE, command)
    assert angle == pytest.approx(command, abs=2), "through direction and gears"
    assert light == pytest.approx(150 - math.sqrt(22_500 - 200 * (50 + angle / 10)), abs=1.1), (
        "raw light, not brightness"
    )
    assert distance == pytest.approx(500 + angle, abs=1.5)


def test_readings_are_clamped_and_default_to_nothing() -> None:
    assert readings(Scene(readings={"light": lambda angles: 7}), 10.0)[2] == 2000
    far = Scene(readings={"light": lambda angles: 7, "eyes": lambda angles: 1})
    assert readings(far, 10.0)[1:] == [4.0, 40.0]


def test_program_uses_sensor_class_and_method() -> None:
    source = generate(ROBOT, INTERFACE).source
    assert "sensor_light = ColorSensor(Port.B)" in source
    assert "sensor_light.reflection()" in source
    assert "from pybricks.pupdevices import ColorSensor, Motor, UltrasonicSensor" in source


def test_unknown_sensor_method_lists_known() -> None:
    interface = dataclasses.replace(
        INTERFACE, channels=(SensorReading("light", "reflexion", 0, 1),)
    )
    with pytest.raises(
        DescriptionError,
        match="no reading 'reflexion' .did you mean 'reflection'..; it has reflection, "
        "ambient, hsv",
    ):
        generate(ROBOT, interface)


def test_scene_error_is_not_a_program_error() -> None:
    scene = dataclasses.replace(SCENE, readings={"light": lambda angles: 1 / 0})
    link = HubLink(VirtualHub(make_body(ROBOT, scene=scene)), ROBOT, INTERFACE)
    with (
        pytest.raises(
            TwinError,
            match=r"the scene.s reading for port B .* ZeroDivisionError: .*test_bench_twin.py, "
            r"line \d+",
        ),
        link,
    ):
        link.read()


def test_readings_are_sensor_methods() -> None:
    modules = {"pupdevices": pupsensors, "ev3devices": ev3sensors}
    for kind in SensorKind:
        device = getattr(modules[kind.model.module], kind.model.class_name)
        assert all(callable(getattr(device, name)) for name in kind.model.readings), kind


@pytest.mark.parametrize(
    ("scene", "says"),
    [
        (Scene(), "sensor 'light' of robot"),
        (Scene(readings={"nose": lambda angles: 1}), "no sensor 'nose'"),
        (Scene(wall_distance_mm=(200.0, 300.0)), "without wall"),
    ],
)
def test_mismatched_scenes_raise(scene: Scene, says: str) -> None:
    with pytest.raises(TwinError, match=says):
        make_body(ROBOT, scene=scene)


def test_modelled_robot_takes_no_readings() -> None:
    with pytest.raises(TwinError, match="sensors of its own"):
        make_body(TWO_WHEELER, scene=Scene(readings={"eyes": lambda angles: 1}))
    touching = dataclasses.replace(
        WALKER, sensors=(*WALKER.sensors, PoweredUpSensor("bump", "F", SensorKind.FORCE))
    )
    with pytest.raises(TwinError, match="no place for 'bump'"):
        make_body(touching)


@pytest.mark.parametrize(
    ("channel", "says"),
    [
        (Distance("light"), "SensorReading"),
        (SensorReading("eyes", "distance", 0, 9), "use Distance"),
    ],
)
def test_channels_match_sensors(channel: Distance | SensorReading, says: str) -> None:
    with pytest.raises(DescriptionError, match=says):
        generate(ROBOT, dataclasses.replace(INTERFACE, channels=(channel,)))
    with pytest.raises(DescriptionError, match="no reading"):
        generate(
            ROBOT, dataclasses.replace(INTERFACE, channels=(SensorReading("light", "a b", 0, 9),))
        )


def test_bench_physics_can_be_given_and_drawn() -> None:
    assert make_body(ROBOT, scene=SCENE).battery_mv == 7200
    assert make_body(ROBOT, scene=SCENE, physics=Physics(battery_v=7.9)).battery_mv == 7900
    body = make_body(ROBOT, scene=SCENE, physics=RandomPhysics())
    drawn = set()
    for seed in range(3):
        body.reset(np.random.default_rng(seed))
        drawn.add(body.battery_mv)
    assert len(drawn) == 3
