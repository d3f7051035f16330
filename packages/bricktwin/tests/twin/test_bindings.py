"""Bindings of a robot to a model: what is found by which name, alone and in an arena."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import pytest

from brickhub.errors import TwinError
from brickhub.robot import (
    DriveBase,
    HubKind,
    Motor,
    MotorKind,
    PoweredUpSensor,
    Robot,
    SensorKind,
    UltrasonicSensor,
)
from bricktwin.twin.bindings import _cone, bind_motors, bind_root, bind_sensors
from bricktwin.twin.engines.mujoco_engine import MujocoEngine
from bricktwin.twin.models.motors import motor_constants
from bricktwin.twin.objects import Block
from bricktwin.twin.scene import OPEN_FLOOR, Scene

CAR = Robot(
    "car",
    HubKind.PRIME,
    motors=(Motor("left", "A"), Motor("right", "B", MotorKind.SPIKE_LARGE)),
    drive_base=DriveBase("left", "right", wheel_diameter_mm=56, axle_track_mm=112),
)
BARE = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 0.1"/>
    {others}
    <body name="{p}chassis" pos="0 0 0.1">
      {root}
      <geom name="{p}hull" size="0.02" mass="0.4"/>
      {feet}
      {sites}
      <body name="{p}one">
        <joint name="{p}motor_A" axis="0 1 0"/>
        <geom name="{p}{left}" size="0.01" mass="0.1"/>
        <body name="{p}inner">
          <joint name="{p}backlash_A" axis="0 1 0"/>
          <geom size="0.01" mass="0.1"/>
        </body>
      </body>
      <body name="{p}two">
        <joint name="{p}{joint}" axis="0 1 0"/>
        <geom name="{p}{right}" size="0.01" mass="0.1"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="{p}motor_A" joint="{p}motor_A" gear="-3" group="2"/>
    <motor name="{p}{actuator}" joint="{p}{joint}" gear="1" group="4"/>
  </actuator>
</mujoco>
"""


def engine(**changes: str) -> MujocoEngine:
    """A model of two motors."""
    values = {
        "p": "",
        "root": "<freejoint/>",
        "feet": "",
        "sites": "",
        "others": "",
        "joint": "motor_B",
        "actuator": "motor_B",
        "left": "tyre_A",
        "right": "tyre_B",
        **changes,
    }
    return MujocoEngine(mujoco.MjModel.from_xml_string(BARE.format(**values)))


def feet(count: int) -> str:
    return "".join(
        f'<geom name="foot_{one}" size="0.01" pos="0.0{one} 0 -0.1"/>' for one in range(count)
    )


@pytest.mark.parametrize(("count", "has_feet"), [(0, False), (1, False), (2, True), (3, True)])
def test_nothing_stands_on_one_foot(count: int, has_feet: bool) -> None:
    root = bind_root(engine(feet=feet(count)), "")
    assert (root.feet is not None) is has_feet
    assert root.is_free and (root.body, root.address, root.dof) == (1, 0, 0)


def test_a_fixed_robot_is_bound_by_its_first_motor() -> None:
    root = bind_root(engine(root=""), "")
    assert not root.is_free and (root.address, root.dof) == (0, 0)


def test_in_an_arena_a_robot_is_found_by_its_prefix_and_keeps_its_stance() -> None:
    other = '<body name="b/chassis"><freejoint/><geom size="0.01" mass="0.1"/></body>'
    root = bind_root(engine(p="a/", others=other, feet=feet(3)), "a/")
    # After the seven positions and six velocities of the other one.
    assert root.is_free and (root.address, root.dof) == (7, 6)
    assert root.feet is None and root.body == 2


def test_motors_are_found_with_their_gears_and_circuits() -> None:
    found = bind_motors(engine(), CAR, "")
    assert found.terminals == {"A": (0, 1 << 2), "B": (1, 1 << 4)}
    # After the seven positions of the chassis; the play of the first is between both.
    assert {port: address for port, (address, _) in found.shafts.items()} == {"A": 7, "B": 9}
    assert found.joints == {"A": 1, "B": 3} and found.dofs == [6, 8]
    turn = math.radians(1.0)
    # A degree at a joint with a gear of -3 is three backwards at the shaft.
    assert found.shafts["A"][1] * turn == pytest.approx(-3000.0)
    assert found.shafts["B"][1] * turn == pytest.approx(1000.0)
    amperes = [motor_constants(motor.kind).torque_nm_a for motor in CAR.motors]
    assert [index for index, _ in found.amperes] == [0, 1]
    for (_, per_torque), torque in zip(found.amperes, amperes, strict=True):
        assert per_torque * torque == pytest.approx(1.0)
    # A model of the user may have no play.
    assert found.plays == [(2, motor_constants(MotorKind.SPIKE_MEDIUM).play_share)]
    assert found.tyres == [engine().index("geom", "tyre_A"), engine().index("geom", "tyre_B")]


@pytest.mark.parametrize("changes", [{"actuator": "other"}, {"joint": "other"}])
def test_a_motor_needs_both_a_joint_and_an_actuator(changes: dict[str, str]) -> None:
    says = r"'car' has no motor 'right' \(a joint and an actuator 'motor_B'\); give it both"
    with pytest.raises(TwinError, match=says):
        bind_motors(engine(**changes), CAR, "")


@pytest.mark.parametrize("changes", [{"left": "wheel"}, {"right": "wheel"}])
def test_tyres_are_both_or_none(changes: dict[str, str]) -> None:
    assert bind_motors(engine(**changes), CAR, "").tyres == []


def test_a_tyre_may_be_the_first_geometry_of_all() -> None:
    text = """
    <mujoco>
      <worldbody>
        <body>
          <joint name="motor_A"/><geom name="tyre_A" size="0.01"/><geom name="tyre_B" size="0.01"/>
        </body>
        <body><joint name="motor_B"/><geom size="0.01"/></body>
      </worldbody>
      <actuator>
        <motor name="motor_A" joint="motor_A"/><motor name="motor_B" joint="motor_B"/>
      </actuator>
    </mujoco>
    """
    found = bind_motors(MujocoEngine(mujoco.MjModel.from_xml_string(text)), CAR, "")
    assert found.tyres == [0, 1]
    assert (found.joints["A"], found.terminals["A"][0]) == (0, 0)
    still = Robot("arm", HubKind.PRIME, motors=CAR.motors)
    again = MujocoEngine(mujoco.MjModel.from_xml_string(text))
    assert bind_motors(again, still, "").tyres == []


ANGLES_DEG = (-1.0, -0.5, 0.0, 0.5, 1.0)


@pytest.mark.parametrize(
    ("kind", "aside_deg", "upright_deg"),
    [
        (SensorKind.ULTRASONIC, 12.0, 0.0),
        (SensorKind.EV3_ULTRASONIC, 15.0, 15.0),
        (SensorKind.EV3_INFRARED, 15.0, 0.0),
        (SensorKind.COLOR, 0.0, 0.0),
    ],
)
def test_rays_of_a_sensor_fan_out_in_a_cross_or_to_its_sides(
    kind: SensorKind, aside_deg: float, upright_deg: float
) -> None:
    rays = _cone(kind)
    assert all(math.hypot(*ray) == pytest.approx(1.0) for ray in rays)
    level = [math.degrees(math.asin(y)) for _, y, z in rays if not z]
    upright = [math.degrees(math.asin(z)) for _, _, z in rays if z]
    expected = [aside_deg * share for share in ANGLES_DEG] if aside_deg else [0.0]
    assert level == pytest.approx(expected)
    # What is straight ahead is asked once.
    shares = [share for share in ANGLES_DEG if share] if upright_deg else []
    assert upright == pytest.approx([upright_deg * share for share in shares])


EYES = '<site name="{p}ultrasonic_C" pos="0.07 0.01 0.02" quat="0.7071 0 0 0.7071"/>'
SEEING = Robot("seer", HubKind.PRIME, motors=CAR.motors, sensors=(UltrasonicSensor("eyes", "C"),))


def sensors_of(
    model: MujocoEngine, robot: Robot, scene: Scene = OPEN_FLOOR, prefix: str = ""
) -> Any:
    return bind_sensors(model, robot, scene, bind_root(model, prefix), prefix)


def test_a_sensor_looks_along_the_x_axis_of_its_site() -> None:
    found = sensors_of(engine(sites=EYES.format(p="")), SEEING)
    position, ahead = found.gazes["C"]
    assert position == pytest.approx((0.07, 0.01, 0.02))
    # A quarter of a turn to the left.
    assert ahead == pytest.approx((0.0, 1.0, 0.0), abs=1e-4)
    assert found.lefts["C"] == pytest.approx((-1.0, 0.0, 0.0), abs=1e-4)
    assert len(found.rays["C"]) == 5
    sides = [-math.degrees(math.asin(x)) for x, _, _ in found.rays["C"]]
    assert sides == pytest.approx([-12.0, -6.0, 0.0, 6.0, 12.0], abs=0.01)
    assert found.ranges_mm == {"C": SensorKind.ULTRASONIC.model.range_mm}
    assert found.forces == {} and set(found.kinds) == {"C"}


def test_sound_comes_back_from_robots_in_an_arena_but_not_from_ones_own() -> None:
    alone = sensors_of(engine(sites=EYES.format(p="")), SEEING)
    assert alone.echoing_groups == (0,) and alone.silent_body == -1
    model = engine(p="a/", sites=EYES.format(p="a/"))
    shared = sensors_of(model, SEEING, prefix="a/")
    assert shared.echoing_groups == (0, 3)
    assert shared.silent_body == model.index("body", "a/chassis")


def test_only_soft_things_swallow_sound() -> None:
    names = "".join(f'<geom name="object_{one}" size="0.01"/>' for one in range(3))
    soft = Block((900.0, 0.0), soft=True)
    scene = Scene(objects=(Block((300.0, 0.0)), soft, Block((600.0, 0.0))))
    model = engine(others=names, sites=EYES.format(p=""))
    found = sensors_of(model, SEEING, scene)
    assert found.soft_geoms == {model.index("geom", "object_1")}


def test_a_sensor_needs_a_site_of_its_name() -> None:
    with pytest.raises(
        TwinError, match=r"'seer' has no place for 'eyes' \(a site 'ultrasonic_C'\)"
    ):
        sensors_of(engine(), SEEING)
    light = PoweredUpSensor("light", "D", SensorKind.COLOR)
    both = Robot("seer", HubKind.PRIME, motors=CAR.motors, sensors=(*SEEING.sensors, light))
    with pytest.raises(TwinError, match=r"no place for 'light' \(a site 'sensor_D'\); give it one"):
        sensors_of(engine(sites=EYES.format(p="")), both)
