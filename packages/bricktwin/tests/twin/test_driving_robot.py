"""Twins of driving robots from their numbers: all hubs, motors, sensors."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from brickhub.errors import DescriptionError, TwinError
from brickhub.robot import (
    Chassis,
    Direction,
    DriveBase,
    HubKind,
    Motor,
    MotorKind,
    Mount,
    PoweredUpSensor,
    Robot,
    SensorKind,
    UltrasonicSensor,
)
from brickhub.virtual.firmware.control import OnCompletion
from brickhub.virtual.machine import Machine
from brickhub.virtual.stimuli import Sense
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.make_body import make_body
from bricktwin.twin.models.motors import motor_constants
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.objects import COLORS, Block, Field, Lamp, Line, Ramp, Wall, oval
from bricktwin.twin.physics import Physics
from bricktwin.twin.scene import OPEN_FLOOR, Scene

QUIET = Physics(
    color_noise_pct=0.0, distance_noise_mm=0.0, distance_noise_ratio=0.0, tilt_noise_deg=0.0
)
ROVER = Robot(
    "rover",
    HubKind.TECHNIC,
    motors=(
        Motor("left", "A", MotorKind.TECHNIC_L_ANGULAR, Direction.COUNTERCLOCKWISE),
        Motor("right", "B", MotorKind.TECHNIC_L_ANGULAR),
    ),
    sensors=(PoweredUpSensor("light", "C", SensorKind.COLOR, Mount((60, 0, 12), "down")),),
    drive_base=DriveBase("left", "right", 62.4, 128),
    needs_imu=True,
)


def covered(mark: Line | Field, *points: tuple[float, float]) -> list[bool]:
    return [mark.beyond_mm(x, y) <= 0.0 for x, y in points]


def placed(scene: Scene = OPEN_FLOOR, robot: Robot = ROVER, **physics: float) -> MujocoBody:
    body = make_body(robot, scene=scene, physics=replace(QUIET, **physics))
    assert isinstance(body, MujocoBody)
    return body


def driven(robot: Robot, body: MujocoBody) -> Any:
    """A machine with its drive base."""
    base, machine = robot.drive_base, Machine(body)
    assert base is not None
    servos = []
    for name in (base.left, base.right):
        motor = robot.motor(name)
        ratio = motor.gears[-1] * 1000 // motor.gears[0] if motor.gears else 1000
        servos.append(machine.servos[motor.port])
        servos[-1].setup(motor.direction, ratio, True, 0)
    drive = machine.new_drive_base(
        *servos, round(base.wheel_diameter_mm * 1000), round(base.axle_track_mm * 1000)
    )
    return machine, drive


def straight(machine: Machine, drive: Any, distance_mm: int, limit_ms: int = 8000) -> None:
    drive.straight(distance_mm, OnCompletion.HOLD)
    while not drive.is_done() and machine.time_ms < limit_ms:
        machine.advance(5)


@pytest.mark.parametrize("kind", MotorKind)
def test_no_load_speed_follows_motor_curve(kind: MotorKind) -> None:
    constants = motor_constants(kind)
    stall_mnm = 1000 * (7.2 * constants.torque_nm_v - constants.friction_nm)
    free_deg_s = math.degrees(stall_mnm / 1000 / constants.drag_nm_s)
    # At 7.2 V: LEGO's sheets (medium, large), Pybricks' curves. The firmware allows 66 % (small) to
    # 93 % of these speeds.
    expected = {
        MotorKind.SPIKE_SMALL: (66, 941),
        MotorKind.TECHNIC_L: (184, 1470),
        MotorKind.TECHNIC_XL: (174, 1561),
        MotorKind.INTERACTIVE: (97, 1196),
        MotorKind.MOVE_HUB: (128, 1617),
        MotorKind.SPIKE_MEDIUM: (172, 1061),
        MotorKind.TECHNIC_M_ANGULAR: (172, 1061),
        MotorKind.SPIKE_LARGE: (263, 1104),
        MotorKind.TECHNIC_L_ANGULAR: (263, 1104),
        MotorKind.MEDIUM_LINEAR: (184, 1470),
        MotorKind.TRAIN: (184, 1470),
        MotorKind.EV3_LARGE: (343, 832),
        MotorKind.EV3_MEDIUM: (140, 1206),
        MotorKind.NXT: (424, 808),
    }[kind]
    assert (stall_mnm, free_deg_s) == pytest.approx(expected, rel=0.01)
    rover = ROVER
    # An EV3 takes only its own motors.
    if kind.model.module == HubKind.EV3.model.devices:
        wheels = tuple(replace(motor, kind=kind) for motor in ROVER.motors)
        rover = replace(ROVER, hub=HubKind.EV3, motors=wheels, sensors=(), needs_imu=False)
    robot = replace(rover, motors=(*rover.motors, Motor("arm", "D", kind)))
    body = placed(robot=robot, battery_v=7.2, battery_ohm=0.0)
    body.set_voltage("D", 7200)
    body.advance_to(1000)
    before = body.angle_mdeg("D")
    body.advance_to(2000)
    assert (body.angle_mdeg("D") - before) / 1000 == pytest.approx(free_deg_s, rel=0.02)


@pytest.mark.parametrize("hub", [HubKind.PRIME, HubKind.ESSENTIAL, HubKind.TECHNIC, HubKind.CITY])
@pytest.mark.parametrize(
    ("kind", "gears", "wheel_mm"),
    [
        (MotorKind.SPIKE_SMALL, (), 56),
        (MotorKind.SPIKE_LARGE, (), 88),
        (MotorKind.TECHNIC_XL, (12, 20), 43.2),
    ],
)
def test_distance_and_turn_follow_description(
    hub: HubKind, kind: MotorKind, gears: tuple[int, ...], wheel_mm: float
) -> None:
    motors = (
        Motor("left", "A", kind, Direction.COUNTERCLOCKWISE, gears),
        Motor("right", "B", kind, gears=gears),
    )
    robot = Robot("any", hub, motors, drive_base=DriveBase("left", "right", wheel_mm, 130))
    body = placed(robot=robot)
    machine, drive = driven(robot, body)
    straight(machine, drive, 250)
    machine.advance(300)
    pose = body.pose()
    assert (
        pose.x_m == pytest.approx(0.250, abs=0.012)
        and abs(pose.y_m) < 0.01
        and abs(pose.heading_deg) < 3
    )
    drive.turn(90, OnCompletion.HOLD)
    machine.advance(2500)
    assert body.pose().heading_deg - pose.heading_deg == pytest.approx(90, abs=5)
    assert max(map(abs, body.tilt_deg())) < 6, "it stands on its caster"


def test_odometry_equals_drive_base() -> None:
    body = placed()
    machine, drive = driven(ROVER, body)
    straight(machine, drive, 400)
    machine.advance(300)
    assert drive.state()[0] == pytest.approx(1000 * body.pose().x_m, abs=5)
    drive.curve(150, 180, OnCompletion.HOLD)
    machine.advance(6000)
    distance_mm, _, turned_deg, _ = drive.state()
    assert distance_mm == pytest.approx(400 + math.pi * 150, abs=8) and turned_deg == pytest.approx(
        180, abs=4
    )
    pose = body.pose()
    assert (pose.x_m, pose.y_m) == pytest.approx(
        (0.4, -0.3), abs=0.02
    ) and pose.heading_deg == pytest.approx(180, abs=6)


def test_custom_part_positions() -> None:
    ahead = replace(
        ROVER,
        chassis=Chassis(hub_mm=(10.0, 0.0), caster_mm=(60.0, 0.0), ballast_g=200.0),
        sensors=(),
    )
    light, heavy = (
        placed(robot=robot).model.body_mass.sum() for robot in (replace(ROVER, sensors=()), ahead)
    )
    assert heavy == pytest.approx(light + 0.2)
    machine, drive = driven(ahead, placed(robot=ahead))
    straight(machine, drive, 100)
    assert machine.body.pose().x_m == pytest.approx(0.1, abs=0.01)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("description", "says"),
    [
        (lambda: Mount((0, 0, 0)), "above the floor"),
        (lambda: Mount((0, 0, 10), "inside"), "cannot look 'inside'"),
        (lambda: Chassis(caster_mm=(5.0, 0.0)), "20 mm or more"),
        (lambda: Chassis(ballast_g=-1.0), "0 g or more"),
    ],
)
def test_invalid_descriptions(description: Any, says: str) -> None:
    with pytest.raises(DescriptionError, match=says):
        description()


def test_invalid_bodies() -> None:
    with pytest.raises(TwinError, match="no room"):
        make_body(replace(ROVER, drive_base=DriveBase("left", "right", 62.4, 30)))
    with pytest.raises(TwinError, match="no ultrasonic sensor"):
        make_body(ROVER, scene=Scene(wall_distance_mm=(200, 300)))
    bench = replace(ROVER, drive_base=None, sensors=())
    with pytest.raises(TwinError, match="lies on the bench"):
        make_body(bench, scene=Scene(objects=(Block((500, 0)),)))
    told = make_body(ROVER, scene=Scene(readings={"light": lambda angles: 40}))
    assert not isinstance(told, MujocoBody), "what the scene says holds on the bench"


# ---------------------------------------------------------------- the scene


@pytest.mark.parametrize("color", COLORS)
def test_colour_is_sensed(color: str) -> None:
    hue, saturation, value = placed(Scene(objects=(Field((60, 0), (100, 100), color),))).sensed(
        "C", Sense.SURFACE
    )
    red, green, blue = COLORS[color]
    assert value == pytest.approx(100 * max(red, green, blue), abs=0.5)
    assert saturation == pytest.approx(
        100 * (1 - min(red, green, blue) / max(red, green, blue)), abs=0.5
    )
    assert 0 <= hue < 360


def test_colour_edge_is_mixed_and_top_counts() -> None:
    black, white = Field((60, 50), (200, 100), "black"), Field((60, 0), (200, 300), "white")
    for objects, expected in (((white, black), 50), ((black, white), 93), ((white,), 93), ((), 84)):
        _, _, value = placed(Scene(objects=objects)).sensed("C", Sense.SURFACE)
        assert value == pytest.approx(expected, abs=6), objects
    turned = Field((60, 0), (400, 10), "red", heading_deg=90)
    assert covered(turned, (60.0, 150.0), (150.0, 0.0)) == [True, False]
    disc = Field((0, 0), (100, 60), round=True)
    assert covered(disc, (49.0, 0.0), (0.0, 29.0), (45.0, 25.0)) == [True, True, False]


def test_line_can_be_followed() -> None:
    line = Line(oval(800, 400), width_mm=20, closed=True)
    along = [(0.0, 0.0), (399.0, 200.0), (0.0, 400.0), (-399.0, 200.0), (-100.0, 0.0)]
    beside = [(x * 1.1, y * 1.1 + 25.0) for x, y in along]
    assert all(covered(line, *along)) and not any(covered(line, *beside))
    assert covered(Line(((0, 0), (100, 0), (100, 100))), (50.0, 50.0)) == [False], "it is open"
    twice = Line(((0, 0), (0, 0), (100, 0)), width_mm=20)
    points = ((0.0, 10.1), (0.0, 9.9), (100.0, -9.9), (110.1, 0.0))
    assert covered(twice, *points) == [False, True, True, False]


@pytest.mark.parametrize(
    "mark",
    [
        Line(oval(800, 400), width_mm=20, closed=True),
        Line(((0, 0), (100, 300), (-200, 350)), width_mm=90),
        Field((30, 40), (200, 100), heading_deg=33),
        Field((30, 40), (200, 100), heading_deg=33, round=True),
    ],
)
def test_mark_is_never_farther_than_it_says(mark: Line | Field) -> None:
    """A sensor looks no closer at what is beyond its spot, or all around it."""
    rng = np.random.default_rng(0)
    for x, y, way_x, way_y in rng.uniform(-300.0, 500.0, (400, 4)).tolist():
        steepness = abs(mark.beyond_mm(x, y) - mark.beyond_mm(x + way_x, y + way_y))
        assert steepness <= math.hypot(way_x, way_y) + 1e-9


def test_reflection_decreases_with_distance() -> None:
    high = replace(
        ROVER,
        sensors=(PoweredUpSensor("light", "C", SensorKind.COLOR, Mount((60, 0, 60), "down")),),
    )
    _, _, near = placed().sensed("C", Sense.SURFACE)
    _, _, far = placed(robot=high).sensed("C", Sense.SURFACE)
    assert far < near / 5


def test_ambient_light_depends_on_lamp() -> None:
    def light(looks: str, *objects: Any) -> float:
        robot = replace(
            ROVER,
            sensors=(PoweredUpSensor("light", "C", SensorKind.COLOR, Mount((60, 0, 50), looks)),),
        )
        sensed = placed(Scene(objects=objects, light_pct=10.0), robot).sensed("C", Sense.AMBIENT)
        assert isinstance(sensed, float)
        return sensed

    lamp = Lamp((360, 0, 50))
    assert light("ahead", lamp) == pytest.approx(90, abs=2)
    assert light("back", lamp) == light("ahead") == 10
    assert light("ahead", lamp, Wall((200, -50), (200, 50))) == 10, "the wall hides it"
    assert 10 < light("ahead", Lamp((660, 0, 50))) < 40, "a quarter at twice the distance"
    assert light("ahead", Lamp((660, 0, 50))) == pytest.approx(10 + 80 / 4, abs=1)
    assert light("ahead", lamp, lamp) == 100.0, "no sensor reads more"
    assert light("ahead", Lamp((61, 0, 50), 5.0)) == 100.0, "near, and yet no point"
    aside = math.radians(60)
    beside = Lamp((60 + 300 * math.cos(aside), 300 * math.sin(aside), 50))
    assert light("ahead", beside) == pytest.approx(10 + 80 / 2, abs=1), "by the cosine"


def test_distance_to_walls_and_blocks() -> None:
    robot = replace(
        ROVER,
        sensors=(
            UltrasonicSensor("eyes", "C", Mount((60, 0, 40), "left")),
            PoweredUpSensor("near", "D", SensorKind.COLOR_DISTANCE, Mount((60, 0, 40), "ahead")),
        ),
    )
    body = placed(Scene(objects=(Wall((-500, 308), (500, 308)), Block((142, 0)))), robot)
    assert body.distance_mm("C") == pytest.approx(300, abs=2)
    assert body.sensed("D", Sense.DISTANCE) == pytest.approx(50, abs=3), "% of 100 mm"
    assert body.sensed("D", Sense.SURFACE)[0] == pytest.approx(220, abs=5)  # type: ignore[index]
    assert placed(robot=robot).distance_mm("C") == 2000


def test_force_sensor_pushes_block() -> None:
    robot = replace(
        ROVER,
        sensors=(PoweredUpSensor("bump", "C", SensorKind.FORCE, Mount((90, 0, 30), "ahead")),),
    )
    scene = Scene(objects=(Block((200, 0), (60, 60, 60), mass_g=300, spread_mm=(10, 0)),))
    body = placed(scene, robot)
    assert body.sensed("C", Sense.FORCE) == 0
    machine, drive = driven(robot, body)
    pushed = []
    drive.straight(250, OnCompletion.HOLD)
    for _ in range(60):
        machine.advance(50)
        pushed.append(body.sensed("C", Sense.FORCE))
    weight_n = 0.3 * 9.81
    assert 0.2 * weight_n < np.mean([force for force in pushed[:25] if force > 0]) < 1.5 * weight_n  # type: ignore[operator]
    block = int(body.model.joint("object_0").qposadr[0])
    assert body.data.qpos[block] > 0.3, (body.pose(), pushed)
    body.reset(np.random.default_rng(0))
    assert body.data.qpos[block] == pytest.approx(0.2, abs=0.01) and body.data.qpos[block] != 0.2, (
        "drawn anew"
    )


def test_robot_stalls_at_wall() -> None:
    body = placed(Scene(objects=(Wall((200, -100), (200, 100)),)))
    machine, drive = driven(ROVER, body)
    straight(machine, drive, 400, limit_ms=3000)
    assert body.pose().x_m < 0.2


@pytest.mark.parametrize(
    "scene",
    [
        Scene(objects=(Wall((-100, 0), (100, 0)),)),
        Scene(objects=(Block((0, 0), mass_g=100.0),)),
        Scene(objects=(Ramp((-300, 0)),)),
        Scene(
            objects=(Line(((0, 0), (9, 9))), Block((400, 0), round=True)),
            start_mm=((0, 400), (0, 0)),
        ),
        Scene(wall_distance_mm=(20, 300), heading_deg=(0, 60)),
    ],
)
def test_start_inside_an_obstacle_is_refused(scene: Scene) -> None:
    name = "wall" if not scene.objects else type(scene.objects[-1]).__name__
    option = "start_mm" if scene.objects else "wall_distance_mm"
    with pytest.raises(
        TwinError,
        match=f"would start inside of {name}.*; move that, or change {option} or "
        "heading_deg of the",
    ):
        placed(scene, ROVER if scene.objects else TWO_WHEELER)


def test_robot_climbs_ramp() -> None:
    body = placed(Scene(objects=(Ramp((150, 0), length_mm=600, height_mm=80),)))
    machine, drive = driven(ROVER, body)
    straight(machine, drive, 450)
    pitch_deg, _ = body.tilt_deg()
    assert pitch_deg == pytest.approx(-math.degrees(math.atan2(80, 600)), abs=2)
    assert body.data.qpos[2] > 0.05


def test_start_pose_follows_scene() -> None:
    body = placed(Scene(start_mm=((-200.0, 200.0), (100.0, 100.0)), heading_deg=(90.0, 90.0)))
    places = []
    for seed in range(4):
        body.reset(np.random.default_rng(seed))
        places.append(body.pose())
    for pose in places:
        assert (pose.y_m, pose.heading_deg % 360) == pytest.approx((0.1, 90), abs=1e-6)
        assert abs(pose.x_m) <= 0.2 + 1e-6
    assert len({pose.x_m for pose in places}) == 4


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (lambda: Line(((0, 0),)), "two or more"),
        (lambda: Line(((0, 0), (1, 0)), color="beige"), "no color 'beige'"),
        (lambda: Line((0, 0)), r"a line at \(0, 0\); give places"),
        (lambda: Line(((0, 0), (1, 0)), color=(0, 0, 0)), "choose white"),
        (lambda: Field((0, 0), (0, 5)), "a field of 0, 5 mm; give 2 positive sizes"),
        (lambda: Field((math.nan, 0), (5, 5)), "finite"),
        (lambda: Wall((0, 0), (0, 0)), "give two"),
        (lambda: Block((0, 0), mass_g=-3), "positive mass"),
        (lambda: Block((0, 0), (50, 50)), "a block of 50, 50 mm; give 3 positive sizes"),
        (lambda: Block((0, 0), 50), "a block of 50 mm; give 3 positive sizes"),
        (lambda: Block((0, 0, 0)), "give places"),
        (lambda: Lamp((100, 0)), r"give a place \(x, y, height\)"),
        (lambda: Scene(objects=Lamp((0, 0, 9))), "objects is of type Lamp; give several"),
        (lambda: Scene(objects=("line",)), "'line' is not an object"),
        (lambda: Block((0, 0), spread_mm=(5, 5)), "a mass to what is to be moved"),
        (lambda: Ramp((0, 0), height_mm=0), "positive sizes"),
        (lambda: Lamp((0, 0, 100), light_pct=500), "up to 100 %"),
        (lambda: oval(100, 200), "at least its width"),
        (lambda: Scene(start_mm=((5, 1), (0, 0))), "start_mm along x"),
        (lambda: Scene(light_pct=200), "light_pct"),
    ],
)
def test_invalid_objects_raise(wrong: Any, says: str) -> None:
    with pytest.raises(TwinError, match=says) as caught:
        wrong()
    assert "\n" not in str(caught.value)


def test_lists_of_objects_and_of_points_are_taken() -> None:
    line = Line([[0, 0], [100, 0], [100, 100]], closed=True)  # type: ignore[arg-type,list-item]
    assert line == Line(((0, 0), (100, 0), (100, 100)), closed=True) and len(line.segments_mm) == 3
    assert Scene(objects=[line]) == Scene(objects=(line,))  # type: ignore[arg-type]


def test_two_wheeler_with_colour_sensor() -> None:
    sensors = (*TWO_WHEELER.sensors, PoweredUpSensor("light", "B", SensorKind.COLOR))
    body = placed(
        Scene(objects=(Field((60, 0), (60, 60), "red"),)), replace(TWO_WHEELER, sensors=sensors)
    )
    hue, saturation, _ = body.sensed("B", Sense.SURFACE)  # type: ignore[misc]
    assert min(hue, 360 - hue) < 10 and saturation > 60


def test_robots_without_scene_are_unchanged() -> None:
    plain, floor = (
        make_body(TWO_WHEELER),
        make_body(TWO_WHEELER, scene=Scene(objects=(Field((0, 0), (9, 9)),))),
    )
    assert isinstance(plain, MujocoBody) and isinstance(floor, MujocoBody)
    assert plain.model.nq == floor.model.nq and floor.model.ngeom == plain.model.ngeom + 1
    mujoco.mj_step(floor.model, floor.data)


def test_upright_hub_reads_as_mounted() -> None:
    # The hub stands at the back of the robot, its front upwards, its top backwards: the gravity is
    # along its front.
    upright = replace(ROVER, needs_imu=True, hub_sides=("back", "up"))
    quiet = Physics(acceleration_noise_mm_s2=0, gyro_noise_deg_s=0, tilt_noise_deg=0)
    body, flat = (
        make_body(one, physics=quiet) for one in (upright, replace(ROVER, needs_imu=True))
    )
    assert body.acceleration_mm_s2() == pytest.approx((9810, 0, 0), abs=30)
    assert flat.acceleration_mm_s2() == pytest.approx((0, 0, 9810), abs=30)
    for one in (body, flat):
        one.set_voltage("A", 3000)
        one.set_voltage("B", 3000)
        one.advance_to(400)
    turning = flat.angular_velocity_deg_s()[2]
    assert abs(turning) > 20
    assert body.angular_velocity_deg_s() == pytest.approx((turning, 0, 0), abs=3)
    assert body.rotation_deg()[0] == pytest.approx(flat.rotation_deg()[2], abs=1)
