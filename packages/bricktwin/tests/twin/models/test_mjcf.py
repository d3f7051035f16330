"""Elements that all models share: motors, tyres, walls, cameras, contacts, drawings."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from brickhub.robot import Motor, MotorKind
from bricktwin.plans.drawing.pieces import Piece
from bricktwin.plans.drawing.shapes import Shape
from bricktwin.twin.models import mjcf
from bricktwin.twin.models.motors import motor_constants
from bricktwin.twin.objects import Ball, Block, Field, Lamp, Line, Ramp, Wall
from bricktwin.twin.scene import OPEN_FLOOR, Scene


def test_the_floor_has_squares_of_ten_centimetres_with_fine_lines() -> None:
    tile = mjcf._floor_tile()
    spec = mjcf.new_spec("floor", OPEN_FLOOR)
    # The tile is repeated every 20 cm.
    assert spec.material("floor").texrepeat == pytest.approx([5.0, 5.0])
    assert tile.shape == (256, 256, 3)
    green = tile[..., 1].astype(int)
    squares = [[green[row + 64, column + 64] for column in (0, 128)] for row in (0, 128)]
    assert squares[0][0] == squares[1][1] > squares[0][1] == squares[1][0] > 180
    for row in (0, 128):
        for column in (0, 128):
            # All of a square has its tone, but the line at its edge.
            inside = green[row + 1 : row + 128, column + 1 : column + 128]
            assert (inside == squares[row // 128][column // 128]).all()
            assert (green[row, column : column + 128] < green[row + 1, column + 1]).all()
            assert (green[row : row + 128, column] < green[row + 1, column + 1]).all()
    # Blue on top of grey.
    assert (tile[..., 2] > tile[..., 1]).all() and (tile[..., 1] > tile[..., 0]).all()


def test_a_wall_has_bricks_in_staggered_courses() -> None:
    tile = mjcf._brick_tile().astype(int)
    assert tile.shape == (64, 128, 3)
    # A point of it is a millimetre.
    material = mjcf.new_spec("bricks", OPEN_FLOOR).material("bricks")
    assert material.texrepeat == pytest.approx([1 / 0.128, 1 / 0.064])
    # The second course is the first one, moved by half a brick.
    assert (tile[32:] == np.roll(tile[:32], 32, axis=1)).all()
    assert not (tile[32:] == tile[:32]).all()
    course = tile[:32, :, 0]
    mortar = course < course[16, 16]
    # A joint of two points below, and one at the end of each brick of 64.
    assert mortar[:2].all()
    assert (np.flatnonzero(mortar[16]) == [0, 1, 64, 65]).all()
    raised = course > course[16, 16]
    assert (np.flatnonzero(raised[:, 16]) == [30, 31]).all() and not (raised & mortar).any()


def shaft_with(kind: MotorKind, gear: float, friction_nm: float = 0.0) -> mujoco.MjModel:
    """A heavy wheel on the shaft of a motor."""
    spec = mujoco.MjSpec()
    mjcf.set_options(spec)
    frame = spec.worldbody.add_body(name="frame")
    motor = Motor("m", "C", kind)
    rotor = mjcf.add_rotor(
        spec, frame, motor, (0.1, 0.2, 0.3), gear=gear, train_friction_nm=friction_nm
    )
    mjcf.add_box(rotor, (10.0, 0.0, -20.0), (100.0, 80.0, 60.0), 1.0, collides=False)
    return spec.compile()


@pytest.mark.parametrize("kind", [MotorKind.SPIKE_MEDIUM, MotorKind.SPIKE_LARGE])
@pytest.mark.parametrize("gear", [1.0, -3.0])
def test_a_motor_turns_by_its_voltage_less_its_drag_and_no_more_than_its_current(
    kind: MotorKind, gear: float
) -> None:
    model = shaft_with(kind, gear, 0.004)
    motor = motor_constants(kind)
    data = mujoco.MjData(model)

    def torque_nm(volt: float, joint_rad_s: float) -> float:
        data.ctrl[0], data.qvel[0] = volt, joint_rad_s
        mujoco.mj_forward(model, data)
        return float(data.qfrc_actuator[0])

    assert torque_nm(1.0, 0.0) == pytest.approx(gear * motor.torque_nm_v)
    assert torque_nm(0.0, 2.0) == pytest.approx(-(gear**2) * 2.0 * motor.drag_nm_s)
    most_nm = motor.limit_a * motor.torque_nm_a
    assert torque_nm(100.0, 0.0) == pytest.approx(gear * most_nm)
    assert torque_nm(-100.0, 0.0) == pytest.approx(-gear * most_nm)
    # The joint feels the shaft's inertia and friction through the gears, and those of the train.
    assert model.dof_armature[0] == pytest.approx(motor.inertia_kg_m2 * gear**2)
    assert model.dof_frictionloss[0] == pytest.approx(motor.friction_nm * abs(gear) + 0.004)
    assert model.body("rotor_C").pos.tolist() == [0.1, 0.2, 0.3]
    assert model.joint("motor_C").axis.tolist() == [0.0, 1.0, 0.0]
    # The box has half of its sizes on each side; the rotor itself is next to nothing.
    assert model.geom_size[0].tolist() == [0.05, 0.04, 0.03]
    assert model.geom_pos[0].tolist() == [0.01, 0.0, -0.02]
    assert model.body("rotor_C").mass[0] < 0.01


def test_each_motor_has_a_circuit_of_its_own() -> None:
    spec = mujoco.MjSpec()
    for port in "ABC":
        mjcf.add_rotor(spec, spec.worldbody, Motor("m", port), (0.0, 0.0, 0.0))
    assert [actuator.group for actuator in spec.actuators] == [0, 1, 2]


@pytest.mark.parametrize(
    ("axis", "is_heavy", "has_friction"),
    [
        ((0.0, 0.0, 1.0), True, True),
        ((0.0, 0.0, -1.0), True, True),
        ((0.0, 0.0, 1.0), False, False),
        ((0.0, 1.0, 0.0), True, False),
    ],
)
def test_only_a_turntable_below_something_heavy_has_friction(
    axis: tuple[float, float, float], is_heavy: bool, has_friction: bool
) -> None:
    spec = mujoco.MjSpec()
    light, heavy = (
        mjcf.add_driven(spec.worldbody, f"part_{heavy}", str(heavy), axis, is_heavy=heavy).joints[0]
        for heavy in (False, True)
    )
    joint = heavy if is_heavy else light
    assert (joint.frictionloss > 0) is has_friction
    # What is heavy is caught softer, and damped more.
    assert heavy.damping[0] > light.damping[0] > 0
    assert heavy.solref_limit[0] > light.solref_limit[0] > 0
    assert joint.limited and joint.range[0] == -joint.range[1] < 0


SPOT = ((0.0, 0.0), (0.0, 0.0))


@pytest.mark.parametrize(
    ("item", "middle_m", "diagonal_m"),
    [
        # With the robot's start at the origin.
        (Line(((-1000.0, 0.0), (3000.0, 3000.0))), (1.0, 1.5), 5.0),
        (Wall((0.0, 0.0), (6000.0, 8000.0)), (3.0, 4.0), 10.0),
        (Lamp((600.0, -800.0, 500.0)), (0.3, -0.4), 1.0),
        (Field((0.0, 0.0), (600.0, 300.0)), (0.0, 0.0), 0.6 * math.sqrt(2)),
        (Block((-3000.0, 0.0), (100.0, 200.0, 900.0)), (-1.5 - 0.05, 0.0), math.hypot(3.1, 0.2)),
        (Ball((3000.0, 0.0), 200.0), (1.55, 0.0), math.hypot(3.1, 0.2)),
        (Ramp((0.0, 2000.0), 500.0, 300.0), (0.0, 1.25), math.hypot(1.0, 2.5)),
    ],
)
def test_the_overview_shows_all_that_is_on_the_floor(
    item: object, middle_m: tuple[float, float], diagonal_m: float
) -> None:
    scene = Scene(objects=(item,), start_mm=SPOT)  # type: ignore[arg-type]
    target, distance_m = mjcf.overview_of(scene)
    assert target == pytest.approx((*middle_m, 0.0))
    # A quarter more than the diagonal, but no nearer than a robot needs.
    assert distance_m == pytest.approx(max(1.1, 1.25 * diagonal_m))


def test_the_overview_shows_all_starts() -> None:
    ball = Ball((0.0, 0.0), 200.0)
    scene = Scene(objects=(ball,), start_mm=((-2000.0, 1000.0), (-500.0, 300.0)))
    target, distance_m = mjcf.overview_of(scene)
    assert target == pytest.approx((-0.5, -0.1, 0.0))
    assert distance_m == pytest.approx(1.25 * math.hypot(3.0, 0.8))


def test_the_wall_faces_the_robot_and_stands_on_the_floor() -> None:
    model = mjcf.new_spec("wall", Scene(wall_distance_mm=(500.0, 500.0))).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    wall = data.geom("wall")
    size = model.geom("wall").size
    assert wall.xpos[0] - size[0] == pytest.approx(mjcf.WALL_X_M)
    assert wall.xpos[2] - size[2] == pytest.approx(0.0) and wall.xpos[1] == 0.0
    # Somebody at the page can move it.
    assert model.body("wall").mocapid[0] == 0
    # Its bricks lie half a millimetre before it, upright, as wide and as high.
    (bricks,) = [geom for geom in range(model.ngeom) if not model.geom(geom).name]
    assert data.geom_xpos[bricks][0] == pytest.approx(mjcf.WALL_X_M - 0.0005)
    turn = data.geom_xmat[bricks].reshape(3, 3)
    assert turn[:, 2] == pytest.approx([-1.0, 0.0, 0.0]) and abs(turn[2, 1]) == pytest.approx(1.0)
    assert model.geom_size[bricks][:2] == pytest.approx(size[1:])
    assert not model.geom_contype[bricks] and not model.geom_conaffinity[bricks]
    assert model.geom("wall").conaffinity[0] and not model.geom("wall").contype[0]


@pytest.mark.parametrize(
    ("scene", "point_m"),
    [
        (OPEN_FLOOR, (0.0, 0.0, 0.0)),
        (Scene(wall_distance_mm=(500.0, 500.0)), (-0.62, 0.1, 0.0)),
        (Scene(objects=(Lamp((600.0, -800.0, 500.0)),), start_mm=SPOT), (0.3, -0.4, 0.0)),
    ],
)
def test_a_camera_looks_at_its_target_with_a_level_horizon(
    scene: Scene, point_m: tuple[float, float, float]
) -> None:
    model = mjcf.new_spec("overview", scene).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = data.camera("overview")
    right, up, backward = camera.xmat.reshape(3, 3).T
    from_target = camera.xpos - np.array(point_m)
    assert backward == pytest.approx(from_target / np.linalg.norm(from_target), abs=1e-6)
    assert right[2] == pytest.approx(0.0, abs=1e-9) and up[2] > 0
    # From the robot's right, and above.
    assert from_target[1] < 0 and from_target[2] > 0


def test_the_webcam_sees_the_front_below_and_the_left_on_the_right() -> None:
    spec = mujoco.MjSpec()
    mjcf.add_webcam(spec.worldbody)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = data.camera("webcam")
    right, up, backward = camera.xmat.reshape(3, 3).T
    assert camera.xpos.tolist() == [0.0, 0.0, mjcf.WEBCAM_HEIGHT_M]
    assert right == pytest.approx([0.0, 1.0, 0.0]) and up == pytest.approx([-1.0, 0.0, 0.0])
    assert backward == pytest.approx([0.0, 0.0, 1.0])


def test_each_shape_of_a_robot_touches_each_obstacle_by_the_rule_of_the_engine() -> None:
    spec = mujoco.MjSpec()
    world = spec.worldbody
    world.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.1], contype=0)
    world.add_geom(name="sticky", size=[0.1, 0, 0], condim=6, contype=0, priority=1)
    body = world.add_body(pos=[0.0, 0.0, 1.0])
    body.add_freejoint()
    mjcf.add_caster(body, "caster", (0.0, 0.0, 0.0), 0.01, 0.1)
    mjcf.add_tyre(body, "tyre", (0.02, 0.01, 0.02))
    mjcf.add_box(body, (0.0, 0.0, 0.0), (10.0, 10.0, 10.0), 0.1)
    mjcf.add_box(body, (0.0, 0.0, 0.0), (10.0, 10.0, 10.0), 0.1, collides=False)
    mjcf.pair_contacts(spec)
    pairs = {(pair.geomname2, pair.geomname1): pair.condim for pair in spec.pairs}
    assert pairs == {
        # The ball of a caster has priority, and slides.
        ("caster", "floor"): 1,
        ("tyre", "floor"): 3,
        ("shape_2", "floor"): 3,
        ("caster", "sticky"): 6,
        ("tyre", "sticky"): 6,
        ("shape_2", "sticky"): 6,
    }
    assert not any(geom.contype or geom.conaffinity for geom in spec.geoms)
    model = spec.compile()
    # What a pair leaves open is that of its shapes: here, the tyre's friction.
    pair = [pair.geomname2 for pair in spec.pairs].index("tyre")
    assert model.pair_friction[pair][0] == mjcf.TYRE_FRICTION
    assert model.pair_solref[pair].tolist() == mjcf.STIFF


def test_robots_touch_floor_and_walls_but_what_only_looks_touches_nothing() -> None:
    floor = mjcf.new_spec("floor", OPEN_FLOOR).geom("floor")
    around = [{"contype": floor.contype, "conaffinity": floor.conaffinity}, mjcf.OBSTACLE]

    def touch(one: dict[str, int], other: dict[str, int]) -> bool:
        bits = one["contype"] & other["conaffinity"] | other["contype"] & one["conaffinity"]
        return bool(bits)

    assert all(touch(mjcf.COLLIDING, other) for other in around)
    assert not any(touch(mjcf.LOOKS, other) for other in (*around, mjcf.COLLIDING))
    assert not touch(*around) and not touch(mjcf.COLLIDING, mjcf.COLLIDING)


def test_what_is_added_without_a_place_lies_upright_in_the_middle_of_its_body() -> None:
    spec = mujoco.MjSpec()
    frame = spec.worldbody.add_body(name="frame")
    mjcf.add_tyre(frame, "tyre", (0.03, 0.01, 0.03))
    mjcf.add_box(frame, (0.0, 0.0, 0.0), (10.0, 20.0, 30.0), 0.25)
    for geom in frame.geoms:
        assert geom.pos.tolist() == [0.0, 0.0, 0.0] and geom.quat.tolist() == [1.0, 0.0, 0.0, 0.0]
    tyre, box = frame.geoms
    assert tyre.size.tolist() == [0.03, 0.01, 0.03] and tyre.mass == 0.0 and box.mass == 0.25
    turned = mjcf.quaternion((0.0, 0.0, 1.0), 0.5)
    mjcf.add_tyre(frame, "other", (0.03, 0.01, 0.03), 0.01, (0.1, 0.2, 0.3), turned)
    mjcf.add_box(frame, (0.0, 0.0, 0.0), (10.0, 20.0, 30.0), 0.1, turn=turned)
    assert [geom.quat.tolist() for geom in frame.geoms[2:]] == [turned, turned]
    assert frame.geoms[2].pos.tolist() == [0.1, 0.2, 0.3]
    # A motor turns once for each turn of its joint, about the axis to the left.
    mjcf.add_rotor(spec, frame, Motor("m", "A"), (0.0, 0.0, 0.0))
    assert spec.joint("motor_A").axis.tolist() == [0.0, 1.0, 0.0]
    assert spec.actuator("motor_A").gear[0] == 1.0


def test_the_sun_shines_from_above_onto_what_it_follows() -> None:
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="robot")
    mjcf.add_light(body)
    (sun,) = spec.lights
    assert sun.dir[2] < 0 and sun.castshadow
    assert sun.mode == mujoco.mjtCamLight.mjCAMLIGHT_TRACK
    # The robot is in the middle of its beam.
    assert np.cross(sun.pos, sun.dir) == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert sun.pos[2] > 0.5


@pytest.mark.parametrize("angle", [0.0, 0.3, math.pi / 2, -2.0])
def test_a_quaternion_turns_about_its_axis(angle: float) -> None:
    axis = np.array([0.6, 0.0, 0.8])
    turned, expected = np.empty(9), np.empty(4)
    mujoco.mju_axisAngle2Quat(expected, axis, angle)
    assert mjcf.quaternion(axis, angle) == pytest.approx(expected.tolist())
    mujoco.mju_quat2Mat(turned, np.array(mjcf.quaternion(axis, angle)))
    assert turned.reshape(3, 3) @ axis == pytest.approx(axis)


def test_a_held_ball_is_of_its_size_and_touches_nothing() -> None:
    spec = mujoco.MjSpec()
    mjcf.add_colours(spec)
    mjcf.add_ball(spec.worldbody, (0.1, 0.2, 0.3))
    (ball,) = spec.geoms
    assert ball.pos.tolist() == [0.1, 0.2, 0.3] and ball.size[0] == mjcf.BALL_RADIUS_M
    assert not ball.contype and not ball.conaffinity
    assert ball.material == "red" and 0.0 < ball.mass < 0.02


def test_drawn_pieces_are_one_mesh_for_each_colour_in_metres() -> None:
    def triangle(shift_mm: float) -> Shape:
        points = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 20.0, 0.0]])
        normals = np.tile([0.0, 0.0, 1.0], (3, 1))
        return Shape(points + np.array([0.0, 0.0, shift_mm]), normals, np.array([[0, 1, 2]]))

    spec = mujoco.MjSpec()
    mjcf.add_colours(spec)
    body = spec.worldbody.add_body(name="arm")
    pieces = [
        Piece((("red", triangle(0.0)), ("#ff008040", triangle(5.0)))),
        Piece((("red", triangle(30.0)),)),
    ]
    mjcf.draw(spec, body, pieces)
    assert [mesh.name for mesh in spec.meshes] == ["arm_red", "arm_#ff008040"]
    assert len(spec.meshes[0].uservert) == 18 and len(spec.meshes[1].uservert) == 9
    assert max(spec.meshes[0].uservert) == pytest.approx(0.03)
    assert [geom.material for geom in body.geoms] == ["red", "#ff008040"]
    assert spec.material("#ff008040").rgba.tolist() == pytest.approx(
        [1.0, 0.0, 128 / 255, 64 / 255]
    )
    assert not any(geom.contype or geom.conaffinity or geom.mass for geom in body.geoms)
    mjcf.draw(spec, body, pieces[1:], "again")
    assert spec.meshes[-1].name == "again_red"
