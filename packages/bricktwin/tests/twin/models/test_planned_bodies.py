"""Bodies of models from plans against the plan's own geometry: places, axes, masses, shapes,
sensors and cameras."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

from brickhub.errors import TwinError
from brickhub.robot import Direction, Motor, PoweredUpSensor, Robot, SensorKind
from bricktwin.plans.geometry import M_PER_LDU, Floats
from bricktwin.plans.planned_robot import PlannedRobot, planned_robot
from bricktwin.robots import EV3_DRIVER, ROBO_ARM, TWO_WHEELER, WALKER, plans
from bricktwin.twin.models import planned_model
from bricktwin.twin.models.planned_model import from_plan
from bricktwin.twin.scene import OPEN_FLOOR, Scene

PLANS = Path(plans.__path__[0])
TO_TWIN = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Of the axes of a plan (right, down, front), those of a twin are the front, the left and up."""
CASES: dict[str, tuple[Robot, Path]] = {
    "two_wheeler": (TWO_WHEELER, PLANS / "two_wheeler.ldr"),
    "walker": (WALKER, PLANS / "walker.ldr"),
    "robo_arm": (ROBO_ARM, PLANS / "robo_arm.ldr"),
    "ev3_driver": (EV3_DRIVER, PLANS / "ev3_driver.ldr"),
}


@dataclass
class Made:
    """A model as its plan stands: the arm's joints too are at the angles of the plan."""

    spec: mujoco.MjSpec
    model: mujoco.MjModel
    data: mujoco.MjData
    planned: PlannedRobot

    @property
    def base(self) -> str:
        return "base" if self.planned.articulation.is_fixed else "chassis"

    def lowest_m(self) -> float:
        """Height of the lowest corner of all parts, in the plan."""
        corners = [placed.to_plan(placed.part.corners) for placed in self.planned.plan.parts]
        return -M_PER_LDU * float(np.concatenate(corners)[:, 1].max())

    def name_of(self, body: int) -> str:
        """Name of a body of the plan."""
        ports = {drive.joint.child: drive.port for drive in self.planned.articulation.drives}
        if body == 0:
            return self.base
        return f"driven_{ports[body]}" if body in ports else f"part_{body}"


def in_plan(spec: mujoco.MjSpec) -> None:
    """Turn all bodies as they are in the plan."""
    for body in spec.bodies:
        if not body.name.startswith(("spin_", "rod_")):
            body.quat = [1.0, 0.0, 0.0, 0.0]


@cache
def made(name: str) -> Made:
    robot, path = CASES[name]
    spec = from_plan(path, robot, Scene(ball=robot is ROBO_ARM))
    in_plan(spec)
    for joint in spec.joints:
        joint.ref = 0.0
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return Made(spec, model, data, planned_robot(path))


def in_twin(points: Floats) -> Floats:
    """Points [n, 3] of a plan in the twin's axes, m."""
    return np.asarray(points @ TO_TWIN.T * M_PER_LDU)


@pytest.mark.parametrize("name", CASES)
def test_each_joint_is_at_the_pin_or_axle_on_which_its_body_turns(name: str) -> None:
    one = made(name)
    # The whole model is moved along, so places are compared from one joint to the others.
    joints = one.planned.articulation.joints
    ports = {drive.joint.child: drive.port for drive in one.planned.articulation.drives}
    names = [
        f"motor_{ports[joint.child]}" if joint.child in ports else f"turn_{joint.child}"
        for joint in joints
    ]
    places = np.array([one.data.joint(at).xanchor for at in names])
    axes = np.array([one.data.joint(at).xaxis for at in names])
    expected = np.array([joint.point_m for joint in joints])
    assert places - places[0] == pytest.approx(expected - expected[0], abs=1e-6)
    assert axes == pytest.approx(np.array([joint.axis for joint in joints]), abs=1e-6)
    # The play of a motor turns about the same line as its shaft.
    for port in ports.values():
        shaft, play = (one.data.joint(f"{kind}_{port}") for kind in ("motor", "backlash"))
        assert play.xanchor == pytest.approx(shaft.xanchor)
        assert play.xaxis == pytest.approx(shaft.xaxis)


@pytest.mark.parametrize("name", CASES)
def test_bodies_have_the_mass_the_centre_and_the_inertia_of_their_parts(name: str) -> None:
    one = made(name)
    origin_m = one.data.body(one.base).xipos - one.planned.articulation.bodies[0].centre_m
    for number, link in enumerate(one.planned.articulation.bodies):
        body = one.model.body(one.name_of(number)).id
        assert one.model.body_mass[body] == pytest.approx(link.mass_kg)
        assert one.data.xipos[body] - origin_m == pytest.approx(link.centre_m, abs=1e-6)
        axes = one.data.ximat[body].reshape(3, 3)
        inertia = axes @ np.diag(one.model.body_inertia[body]) @ axes.T
        size = float(np.abs(link.inertia).max())
        assert inertia == pytest.approx(link.inertia, abs=1e-5 * size)
    # What is between a motor and its play weighs nothing beside them.
    rotors = [body.name for body in one.spec.bodies if body.name.startswith("rotor_")]
    assert len(rotors) == len(one.planned.articulation.drives)
    for rotor in rotors:
        assert 0.0 < one.model.body(rotor).mass[0] < 1e-3
        assert 0.0 < one.model.body(rotor).inertia.max() < 1e-7


@pytest.mark.parametrize(
    ("name", "height_mm"),
    [
        # Half of the diameter of its wheels of 56 mm, on whose axle its origin is.
        ("two_wheeler", 28.0),
        ("ev3_driver", 28.0),
    ],
)
def test_a_robot_on_wheels_has_its_origin_on_their_axle(name: str, height_mm: float) -> None:
    one = made(name)
    chassis = one.data.body("chassis").xpos
    assert chassis == pytest.approx([0.0, 0.0, height_mm / 1000], abs=1e-5)
    tyres = [geom for geom in one.spec.geoms if geom.name.startswith("tyre_")]
    assert len(tyres) == 2
    for geom in tyres:
        tyre = one.data.geom(geom.name)
        radius_m, _, half_width_m = geom.size.tolist()
        assert radius_m == geom.size[1] == pytest.approx(0.028)
        assert 0.005 < half_width_m < 0.015
        # It stands on the floor, and its axis, z, is across the robot.
        assert tyre.xpos[2] == pytest.approx(radius_m, abs=1e-5)
        assert tyre.xpos[0] == pytest.approx(0.0, abs=1e-5)
        assert np.abs(tyre.xmat.reshape(3, 3)[:, 2]) == pytest.approx([0.0, 1.0, 0.0], abs=1e-6)
    base = CASES[name][0].drive_base
    assert base is not None
    left, right = sorted(one.data.geom(geom.name).xpos[1] for geom in tyres)
    assert 1000 * (right - left) == pytest.approx(base.axle_track_mm, abs=0.01)
    # The ball of the caster is behind them in the middle, and no more than 3 mm above the floor.
    caster = one.data.geom("caster").xpos
    assert -1e-5 < caster[2] - one.model.geom("caster").size[0] < 0.0031
    assert caster[0] < -0.03 and caster[1] == pytest.approx(0.0, abs=1e-6)


def test_a_robot_on_legs_has_its_origin_below_its_hub_and_stands_on_its_feet() -> None:
    one = made("walker")
    hub = one.data.site("imu").xpos - one.data.body("chassis").xpos
    assert hub[:2] == pytest.approx([0.0, 0.0], abs=1e-6)
    soles_m = []
    for port in "ABCD":
        foot = one.model.geom(f"foot_{port}")
        assert foot.type[0] == mujoco.mjtGeom.mjGEOM_CAPSULE
        soles_m.append(one.data.geom(f"foot_{port}").xpos[2] - foot.size[0])
        # A capsule that lies across the robot, and ends with its leg, a beam of 7.2 mm.
        along = one.data.geom(f"foot_{port}").xmat.reshape(3, 3)[:, 2]
        assert np.abs(along) == pytest.approx([0.0, 1.0, 0.0], abs=1e-6)
        assert 2000 * foot.size[0] == pytest.approx(7.2, abs=0.5)
    assert soles_m == pytest.approx([0.0] * 4, abs=1e-4)


def test_an_arm_stands_on_the_table_at_the_place_of_its_plan() -> None:
    one = made("robo_arm")
    base = one.data.body("base").xpos
    assert base == pytest.approx([0.0, 0.0, -one.lowest_m()], abs=1e-6)
    # Joints have ranges within which nothing touches, so that there are no shapes.
    assert [geom.name for geom in one.spec.geoms if geom.contype or geom.conaffinity] == ["floor"]
    assert not [joint for joint in one.spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]


@pytest.mark.parametrize("name", ["two_wheeler", "walker", "ev3_driver"])
def test_hulls_reach_as_far_as_the_parts_of_their_bodies_without_wheels(name: str) -> None:
    one = made(name)
    articulation = one.planned.articulation
    origin_m = one.data.body(one.base).xipos - articulation.bodies[0].centre_m
    wheels = {wheel.part for wheel in articulation.wheels}
    hulls = [geom.name for geom in one.spec.geoms if geom.name.startswith("hull_")]
    assert "hull_0" in hulls
    for hull in hulls:
        number = int(hull.removeprefix("hull_"))
        corners = [
            one.planned.plan.parts[part].to_plan(one.planned.plan.parts[part].part.corners)
            for part in articulation.bodies[number].parts
            if part not in wheels
        ]
        points_m = in_twin(np.concatenate(corners)) + origin_m
        geom = one.model.geom(hull)
        mesh = geom.dataid[0]
        start, count = one.model.mesh_vertadr[mesh], one.model.mesh_vertnum[mesh]
        vertices = one.model.mesh_vert[start : start + count]
        placed = one.data.geom(hull)
        reached_m = vertices @ placed.xmat.reshape(3, 3).T + placed.xpos
        # Of points that are closer than 2 mm one is kept.
        assert reached_m.min(axis=0) == pytest.approx(points_m.min(axis=0), abs=0.002)
        assert reached_m.max(axis=0) == pytest.approx(points_m.max(axis=0), abs=0.002)
        assert count < len(points_m)
        assert geom.contype[0] and not geom.conaffinity[0]


def test_what_stands_on_the_floor_has_no_hull_beside_its_own_shape() -> None:
    hulls = {
        name: {geom.name for geom in made(name).spec.geoms if geom.name.startswith("hull_")}
        for name in ("two_wheeler", "walker")
    }
    assert hulls["two_wheeler"] == {"hull_0"}
    # The cranks of the walker, between its chassis and its four legs.
    cranks = {drive.joint.child for drive in made("walker").planned.articulation.drives}
    assert hulls["walker"] == {"hull_0", *(f"hull_{crank}" for crank in cranks)}


@pytest.mark.parametrize(
    ("name", "port", "ahead_mm", "up_mm"),
    [("two_wheeler", "C", 59.6, 52.0), ("walker", "E", 99.6, 99.6)],
)
def test_eyes_look_ahead_out_of_the_front_of_their_case(
    name: str, port: str, ahead_mm: float, up_mm: float
) -> None:
    one = made(name)
    sensor = one.planned.device(port)
    corners_m = in_twin(sensor.to_plan(sensor.part.corners))
    origin_m = one.data.body(one.base).xipos - one.planned.articulation.bodies[0].centre_m
    eye = one.data.site(f"ultrasonic_{port}")
    front_m = float(corners_m[:, 0].max()) + origin_m[0]
    assert eye.xpos[0] == pytest.approx(front_m, abs=1e-6)
    assert 1000 * eye.xpos == pytest.approx([ahead_mm, 0.0, up_mm], abs=0.1)
    assert eye.xmat.reshape(3, 3)[:, 0] == pytest.approx([1.0, 0.0, 0.0], abs=1e-6)


@pytest.mark.parametrize(
    ("looks", "columns"),
    [
        ((1.0, 0.0, 0.0), np.eye(3)),
        # Half a turn about the vertical, where no turn is the shortest.
        ((-1.0, 0.0, 0.0), np.diag([-1.0, -1.0, 1.0])),
        ((0.0, 1.0, 0.0), [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
        ((0.0, 0.0, -1.0), [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]),
        ((0.0, 0.6, 0.8), [[0.0, -0.6, -0.8], [0.6, 0.64, -0.48], [0.8, -0.48, 0.36]]),
    ],
)
def test_a_sensor_is_turned_the_shortest_way_to_where_it_looks(
    looks: tuple[float, float, float], columns: Floats
) -> None:
    quaternion = np.array(planned_model._facing(np.array(looks)))
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    assert matrix.reshape(3, 3) == pytest.approx(np.array(columns), abs=1e-6)


@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.6, 0.0, -0.8)])
def test_axes_of_a_rod_have_their_last_one_along_it(
    direction: tuple[float, float, float],
) -> None:
    axes = planned_model._axes_along(np.array(direction))
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-9)
    assert axes[2] == pytest.approx(direction, abs=1e-9)
    assert np.linalg.det(axes) == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["two_wheeler", "walker", "robo_arm"])
@pytest.mark.parametrize("camera", ["chase", "portrait"])
def test_cameras_show_the_whole_robot_and_not_much_more(name: str, camera: str) -> None:
    one = made(name)
    origin_m = one.data.body(one.base).xipos - one.planned.articulation.bodies[0].centre_m
    corners = [placed.to_plan(placed.part.corners) for placed in one.planned.plan.parts]
    points_m = in_twin(np.concatenate(corners)) + origin_m
    eye = one.data.camera(camera)
    right, up, backward = ((points_m - eye.xpos) @ eye.xmat.reshape(3, 3)).T
    upwards = up / -backward
    sideways = right / -backward
    edge = math.tan(math.radians(one.model.cam(camera).fovy[0] / 2))
    assert (backward < 0).all()
    # A picture is wider than high.
    assert np.abs(upwards).max() < edge and np.abs(sideways).max() < 4 / 3 * edge
    assert max(np.ptp(upwards), np.ptp(sideways)) > 0.5 * 2 * edge
    # The middle of what is seen is near the middle of the picture.
    assert abs(upwards.max() + upwards.min()) / 2 < 0.3 * edge
    assert abs(sideways.max() + sideways.min()) / 2 < 0.3 * edge


@pytest.mark.parametrize(
    ("motor", "shaft_deg"),
    [
        (Motor("arm", "A"), None),
        (Motor("arm", "A", range_deg=(10, 70)), (10.0, 70.0)),
        # Three turns of the shaft for one of the arm.
        (Motor("arm", "A", range_deg=(-30, 60), gears=(12, 36)), (-90.0, 180.0)),
        # A motor that counts the other way has its ends the other way around.
        (
            Motor("arm", "A", range_deg=(-30, 60), direction=Direction.COUNTERCLOCKWISE),
            (-60.0, 30.0),
        ),
    ],
)
def test_the_range_of_a_shaft_is_that_of_its_motor_in_order(
    motor: Motor, shaft_deg: tuple[float, float] | None
) -> None:
    assert planned_model._range_of_shaft(motor) == (
        None if shaft_deg is None else pytest.approx(shaft_deg)
    )


@pytest.mark.parametrize(
    ("port", "teeth"), [("B", (20, 60)), ("D", (12, 36)), ("A", (12, 24)), ("E", (12, 24))]
)
def test_a_joint_feels_the_friction_of_its_gears_and_a_bare_shaft_that_of_its_motor(
    port: str, teeth: tuple[int, int]
) -> None:
    arm = made("robo_arm").model.joint(f"motor_{port}")
    bare = made("walker").model.joint("motor_A")
    turns = teeth[1] / teeth[0]
    shaft_nm = float(arm.frictionloss[0]) / turns
    bare_nm = float(bare.frictionloss[0])
    # Of the gears alone, at the motor: as in all other trains.
    others = made("robo_arm").model.joint("motor_D")
    assert shaft_nm - bare_nm == pytest.approx(float(others.frictionloss[0]) / 3.0 - bare_nm)
    assert shaft_nm > 2 * bare_nm > 0.0


def test_what_is_heavy_is_damped_so_that_it_does_not_swing_on_its_play() -> None:
    arm = made("robo_arm").model
    heavy = {port: float(arm.joint(f"motor_{port}").damping[0]) for port in "ABDE"}
    # The fingers, of some grams, are on the last one.
    assert heavy["E"] == 0.0 and heavy["A"] == heavy["B"] == heavy["D"] > 0.0
    plays = {port: float(arm.joint(f"backlash_{port}").damping[0]) for port in "ABDE"}
    assert plays["A"] == plays["B"] == plays["D"] > plays["E"] > 0.0
    wheels = made("two_wheeler").model
    assert [float(wheels.joint(f"motor_{port}").damping[0]) for port in "AE"] == [0.0, 0.0]


def test_a_held_ball_is_where_the_plan_says() -> None:
    arm = made("robo_arm")
    (holder,) = (placed for placed in arm.planned.plan.parts if placed.ball is not None)
    assert holder.ball is not None
    (expected,) = in_twin(np.array([holder.point(holder.ball)]))
    body = arm.planned.articulation.body_of(holder.index)
    assert body is not None
    link_m = arm.data.body(arm.name_of(body)).xipos
    centre_m = arm.planned.articulation.bodies[body].centre_m
    assert arm.data.geom("ball").xpos - link_m == pytest.approx(expected - centre_m, abs=1e-6)


@pytest.mark.parametrize(
    "scene", [Scene(wall_distance_mm=(200.0, 300.0)), Scene(heading_deg=(-10.0, 10.0))]
)
def test_a_robot_that_stands_still_has_neither_wall_nor_heading(scene: Scene) -> None:
    robot, path = CASES["robo_arm"]
    with pytest.raises(TwinError, match="'robo-arm' stands still and sees no wall; omit"):
        from_plan(path, robot, scene)


def test_a_sensor_that_is_not_in_the_plan_needs_a_place(tmp_path: Path) -> None:
    light = PoweredUpSensor("light", "F", SensorKind.COLOR)
    walker, path = CASES["walker"]
    with_light = replace(walker, sensors=(*walker.sensors, light))
    with pytest.raises(TwinError, match=r"there is no place for 'light' in .*walker\.ldr; add it"):
        from_plan(path, with_light, OPEN_FLOOR)
    # On a car it is there.
    car, plan = CASES["two_wheeler"]
    spec = from_plan(plan, replace(car, sensors=(*car.sensors, light)), OPEN_FLOOR)
    assert spec.site("sensor_F") is not None and spec.site("ultrasonic_C") is not None


def test_legs_are_solved_as_sparse_matrices_and_nothing_is_searched_for_islands() -> None:
    for name, is_sparse in (("walker", True), ("two_wheeler", False)):
        spec = made(name).spec
        assert (spec.option.jacobian == mujoco.mjtJacobian.mjJAC_SPARSE) is is_sparse
        assert spec.option.disableflags & mujoco.mjtDisableBit.mjDSBL_ISLAND
