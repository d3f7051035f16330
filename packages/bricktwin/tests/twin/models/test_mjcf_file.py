"""Users' robots with MJCF models."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import pytest

from brickhub.errors import TwinError
from brickhub.robot import (
    Direction,
    HubKind,
    Motor,
    PoweredUpSensor,
    Robot,
    SensorKind,
    UltrasonicSensor,
)
from brickhub.virtual import run_file
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.make_body import make_body
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.scene import Scene

ROVER_XML = """
<mujoco>
  <worldbody>
    <body name="rover" pos="0 0 0.028">
      <freejoint/>
      <geom type="box" size="0.06 0.04 0.012" pos="0.01 0 0.02" mass="0.4"/>
      <geom type="sphere" size="0.01" pos="-0.06 0 -0.018" condim="1" priority="1" mass="0.01"/>
      <geom type="sphere" size="0.01" pos="0.06 0 -0.018" condim="1" priority="1" mass="0.01"/>
      <site name="eyes" pos="0.07 0 0.02"/>
      <body name="left_wheel" pos="0 0.056 0">
        <joint name="left" axis="0 1 0"/>
        <geom type="ellipsoid" size="0.028 0.007 0.028" mass="0.02" friction="1 0.005 0.0001" priority="1"/>
      </body>
      <body name="right_wheel" pos="0 -0.056 0">
        <joint name="right" axis="0 1 0"/>
        <geom type="ellipsoid" size="0.028 0.007 0.028" mass="0.02" friction="1 0.005 0.0001" priority="1"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""  # noqa: E501
PROGRAM = """
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import Motor, UltrasonicSensor
from pybricks.robotics import DriveBase
base = DriveBase(Motor(Port.A, Direction.COUNTERCLOCKWISE), Motor(Port.B), wheel_diameter=56, axle_track=112)
eyes = UltrasonicSensor(Port.C)
before = eyes.distance()
base.straight(150)
print(base.distance(), before - eyes.distance())
"""  # noqa: E501


@pytest.fixture
def rover(tmp_path: Path) -> Robot:
    path = tmp_path / "rover.xml"
    path.write_text(ROVER_XML)
    motors = (Motor("left", "A", direction=Direction.COUNTERCLOCKWISE), Motor("right", "B"))
    return Robot(
        "rover",
        HubKind.PRIME,
        motors=motors,
        sensors=(UltrasonicSensor("eyes", "C"),),
        model=str(path),
    )


def test_model_file_that_was_changed_is_read_again(rover: Robot) -> None:
    """A page lives as long as its user draws."""
    before = make_body(rover)
    Path(str(rover.model)).write_text(ROVER_XML.replace('mass="0.4"', 'mass="0.9"'))
    after = make_body(rover)
    assert isinstance(before, MujocoBody)
    assert isinstance(after, MujocoBody)
    gained_kg = after.model.body_mass.sum() - before.model.body_mass.sum()
    assert gained_kg == pytest.approx(0.5)


def test_user_mjcf_robot_drives_to_wall(rover: Robot, tmp_path: Path) -> None:
    (tmp_path / "main.py").write_text(PROGRAM)
    body = make_body(rover, scene=Scene(wall_distance_mm=(600.0, 600.0)))
    said = io.BytesIO()
    assert isinstance(body, MujocoBody)
    assert run_file(tmp_path / "main.py", body, stdout=said) == 0
    driven_mm, nearer_mm = map(int, said.getvalue().split())
    assert driven_mm == pytest.approx(150, abs=3) and nearer_mm == pytest.approx(150, abs=8)


def test_mjcf_gears_and_direction_follow_description(rover: Robot) -> None:
    geared = replace(
        rover,
        motors=(replace(rover.motors[0], gears=(12, 36)), replace(rover.motors[1], gears=(12, 36))),
    )
    body = make_body(geared)
    assert isinstance(body, MujocoBody)
    assert [body.model.actuator(f"motor_{port}").gear[0] for port in "AB"] == [-3.0, 3.0]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            {"motors": (Motor("nose", "A"),)},
            "has no hinge 'nose' of robot 'rover' .it has: left, right.",
        ),
        ({"sensors": (UltrasonicSensor("ears", "C"),)}, "has no site 'ears'"),
        ({"sensors": (PoweredUpSensor("bump", "C", SensorKind.FORCE),)}, "has no site 'bump'"),
        ({"model": "nowhere.xml"}, "no model nowhere.xml"),
        ({"model": "bricktwin.robots:ROBOTS"}, "gives dict; let it be a function"),
        ({"model": "bricktwin.robots:nothing"}, "cannot be loaded"),
        ({"model": "not a module"}, "cannot be loaded"),
    ],
)
def test_mismatched_model_raises(rover: Robot, change: dict[str, object], says: str) -> None:
    with pytest.raises(TwinError, match=says):
        make_body(replace(rover, **change))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("<mujoco", "is not an MJCF file"),
        ("<mujoco/>", "has no body"),
        (ROVER_XML.replace('0.028">', '0.028 3 4">'), "not an MJCF|compile"),
        (
            ROVER_XML.replace('<joint name="left"', '<joint name="left" type="slide"'),
            "has no hinge 'left' .* .it has: right.",
        ),
        (
            ROVER_XML.replace(
                "<worldbody>", '<worldbody><geom name="floor" type="plane" size="1 1 1"/>'
            ),
            "'floor' in geom; take it out",
        ),
        (
            ROVER_XML.replace('<joint name="left"', '<site name="imu"/><joint name="left"'),
            "'imu' on 'left_wheel'; put it on the first",
        ),
        (
            ROVER_XML.replace('<site name="eyes" pos="0.07 0 0.02"/>', "").replace(
                "<joint", '<site name="eyes"/><joint', 1
            ),
            "'eyes' on",
        ),
        (
            ROVER_XML.replace("<freejoint/>", '<freejoint/><camera name="chase"/>'),
            "'chase' in camera; take it out",
        ),
    ],
)
def test_invalid_mjcf_raises(rover: Robot, text: str, says: str) -> None:
    Path(str(rover.model)).write_text(text)
    with pytest.raises(TwinError, match=says) as caught:
        make_body(rover)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["rod_left", "spin_left"])
def test_body_may_have_a_name_that_begins_as_ours_do(rover: Robot, name: str) -> None:
    Path(str(rover.model)).write_text(ROVER_XML.replace("left_wheel", name))
    body = make_body(rover)
    assert isinstance(body, MujocoBody)
    body.update_visuals()


def test_robot_with_one_foot_settles_on_the_floor(rover: Robot) -> None:
    Path(str(rover.model)).write_text(
        ROVER_XML.replace('<geom type="sphere"', '<geom name="foot_back" type="sphere"', 1)
    )
    body = make_body(rover)
    assert isinstance(body, MujocoBody)
    assert body.data.qpos[2] == pytest.approx(0.028, abs=0.001)


FEET = {
    "boxes": ('type="box" size="0.01 0.008 0.005"', 0.005),
    "cylinders": ('type="cylinder" size="0.01 0.005"', 0.005),
    "balls": ('type="sphere" size="0.01"', 0.01),
    "capsules": ('type="capsule" size="0.006 0.01" euler="0 90 0"', 0.006),
}


@pytest.mark.parametrize("kind", FEET)
def test_robot_stands_on_feet_of_any_shape(kind: str, tmp_path: Path) -> None:
    shape, below_m = FEET[kind]
    places = [(x, y) for x in (0.05, -0.05) for y in (0.04, -0.04)]
    feet = "".join(
        f'<geom name="foot_{i}" {shape} pos="{x} {y} -0.03" mass="0.01"/>'
        for i, (x, y) in enumerate(places)
    )
    path = tmp_path / "table.xml"
    path.write_text(
        f"""<mujoco><worldbody><body name="table" pos="0 0 0.1"><freejoint/>{feet}
        <geom type="box" size="0.06 0.05 0.01" mass="0.3"/>
        <body name="arm" pos="0 0 0.02"><joint name="arm" axis="0 0 1"/><geom size="0.01" mass="0.02"/></body>
        </body></worldbody></mujoco>"""  # noqa: E501
    )
    body = make_body(Robot("table", HubKind.PRIME, motors=(Motor("arm", "A"),), model=str(path)))
    assert isinstance(body, MujocoBody)
    height_m = body.data.qpos[2]
    # a contact carries weight at some depth
    assert height_m == pytest.approx(0.03 + below_m, abs=0.0002)
    body.advance_to(1000)
    assert body.data.qpos[2] == pytest.approx(height_m, abs=0.0005)


def test_wall_needs_ultrasonic_sensor(rover: Robot) -> None:
    built = replace(TWO_WHEELER, model="bricktwin.twin.models.driving_robot:driving_robot")
    for robot in (rover, built):
        with pytest.raises(TwinError, match="no ultrasonic sensor"):
            make_body(replace(robot, sensors=()), scene=Scene(wall_distance_mm=(600.0, 600.0)))
