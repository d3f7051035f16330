"""Measures of robots that are made from the numbers of their description: what lies on what, what
has room, and what is drawn where it is."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import mujoco
import numpy as np
import pytest

from brickhub.errors import TwinError
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
)
from bricktwin.plans.drawing import pieces
from bricktwin.plans.drawing.pieces import Piece
from bricktwin.plans.geometry import Floats
from bricktwin.plans.part import DeviceKind
from bricktwin.robots import CART
from bricktwin.twin.models.driving_robot import _Frame, _hub, _motor, driving_robot
from bricktwin.twin.models.mounts import case_of
from bricktwin.twin.scene import OPEN_FLOOR

FLOOR = 0.0


class Box(NamedTuple):
    """Lowest and highest corner of a box above the floor, mm, and its mass, g."""

    low: Floats
    high: Floats
    mass_g: float

    def overlaps(self, other: Box) -> bool:
        return bool((self.low < other.high - 1e-6).all() and (other.low < self.high - 1e-6).all())


def robot_with(
    kind: MotorKind = MotorKind.SPIKE_MEDIUM,
    wheel_mm: float = 56,
    track_mm: float = 130,
    *others: Motor,
    hub: HubKind = HubKind.PRIME,
    chassis: Chassis | None = None,
    sensors: tuple[PoweredUpSensor, ...] = (),
) -> Robot:
    motors = (Motor("left", "A", kind, Direction.COUNTERCLOCKWISE), Motor("right", "B", kind))
    return Robot(
        "cart",
        hub,
        motors=(*motors, *others),
        sensors=sensors,
        drive_base=DriveBase("left", "right", wheel_mm, track_mm),
        chassis=chassis or Chassis(),
    )


def boxes_of(robot: Robot) -> list[Box]:
    """Hub, motors and frame of a robot, mm from the floor."""
    spec = driving_robot(robot, OPEN_FLOOR)
    chassis = spec.body("chassis")
    found = []
    for geom in chassis.geoms:
        if geom.type == mujoco.mjtGeom.mjGEOM_BOX and geom.contype:
            middle = 1000 * (np.array(geom.pos) + chassis.pos)
            half = 1000 * np.array(geom.size)
            found.append(Box(middle - half, middle + half, 1000 * geom.mass))
    return found


KINDS = [MotorKind.SPIKE_SMALL, MotorKind.SPIKE_MEDIUM, MotorKind.SPIKE_LARGE]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("wheel_mm", [24.0, 56.0, 88.0])
def test_motors_lie_side_by_side_below_the_frame_and_that_below_the_hub(
    kind: MotorKind, wheel_mm: float
) -> None:
    hub, left, right, frame = boxes_of(robot_with(kind, wheel_mm))
    # Each motor is on its side, as far from the middle as the other one.
    assert left.low[1] >= -1e-6 and right.high[1] <= 1e-6
    assert left.low[1] == pytest.approx(-right.high[1])
    assert left.high[1] == pytest.approx(-right.low[1])
    assert left.low[[0, 2]] == pytest.approx(right.low[[0, 2]])
    # With room for the wheel of 14 mm, and 8 mm for the axle.
    assert left.high[1] <= 65.0 - 7.0
    assert left.high[1] == pytest.approx(50.0) or left.low[1] == pytest.approx(0.0)
    # The shaft is 12 mm behind the front of its case.
    assert left.high[0] == pytest.approx(12.0)
    # It is on the axle, unless the motor would touch the floor.
    height = left.high[2] - left.low[2]
    assert left.low[2] == pytest.approx(max(wheel_mm / 2 - height / 2, 3.0))
    # What lies on it touches it.
    assert frame.low[2] == pytest.approx(left.high[2])
    assert hub.low[2] == pytest.approx(frame.high[2])
    assert not any(
        one.overlaps(other)
        for number, one in enumerate((hub, left, right, frame))
        for other in (hub, left, right, frame)[number + 1 :]
    )
    size, mass_g = case_of(DeviceKind.MOTOR, kind.value) or ((0.0, 0.0, 0.0), 0.0)
    assert sorted(left.high - left.low) == pytest.approx(sorted(size))
    assert left.mass_g == right.mass_g == pytest.approx(mass_g)


def test_the_hub_is_behind_the_axle_or_where_it_is_said() -> None:
    hub, _, _, frame = boxes_of(robot_with())
    middle = (hub.low + hub.high) / 2
    assert middle[:2] == pytest.approx([-16.0, 0.0])
    size, mass_g = case_of(DeviceKind.HUB, "prime") or ((0.0, 0.0, 0.0), 0.0)
    assert hub.high - hub.low == pytest.approx(size) and hub.mass_g == pytest.approx(mass_g)
    assert ((frame.low + frame.high) / 2)[:2] == pytest.approx([-16.0, 0.0])
    moved, _, _, below = boxes_of(robot_with(chassis=Chassis(hub_mm=(10.0, -5.0), ballast_g=150.0)))
    assert (moved.low + moved.high)[:2] / 2 == pytest.approx([10.0, -5.0])
    # The frame is below it, in the middle, with the ballast.
    assert (below.low + below.high)[:2] / 2 == pytest.approx([10.0, 0.0])
    assert below.mass_g == pytest.approx(frame.mass_g + 150.0)
    assert below.high - below.low == pytest.approx([88.0, 48.0, 8.0])


def test_a_hub_that_is_not_in_the_catalogue_has_the_size_of_a_palm() -> None:
    hub = boxes_of(CART)[0]
    assert hub.high - hub.low == pytest.approx([64.0, 40.0, 32.0])
    assert hub.mass_g == pytest.approx(100.0)


@pytest.mark.parametrize("wheel_mm", [43.2, 56.0, 88.0])
def test_wheels_stand_on_the_floor_at_both_ends_of_the_axle(wheel_mm: float) -> None:
    model = driving_robot(robot_with(wheel_mm=wheel_mm, track_mm=112), OPEN_FLOOR).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for port, side in (("A", 1), ("B", -1)):
        tyre = model.geom(f"tyre_{port}")
        assert 2000 * tyre.size == pytest.approx([wheel_mm, 14.0, wheel_mm])
        assert 1000 * data.geom(f"tyre_{port}").xpos == pytest.approx(
            [0.0, side * 56.0, wheel_mm / 2]
        )
        # One of 56 mm weighs 18 g, others by their area.
        kg = float(model.body(f"wheel_{port}").mass[0])
        assert 1000 * kg == pytest.approx(18.0 * (wheel_mm / 56.0) ** 2, rel=1e-3)
        for joint in ("motor", "backlash"):
            assert data.joint(f"{joint}_{port}").xaxis == pytest.approx([0.0, 1.0, 0.0])
    # The caster is on the floor too.
    assert 1000 * model.geom("caster").size[0] == pytest.approx(9.6)
    assert 1000 * data.geom("caster").xpos[2] == pytest.approx(9.6)
    # A motor that counts counterclockwise turns its wheel forwards when its shaft goes back.
    assert [model.actuator(f"motor_{port}").gear[0] for port in "AB"] == [-1.0, 1.0]


def test_the_caster_is_where_it_is_said() -> None:
    robot = robot_with(chassis=Chassis(caster_mm=(70.0, 12.0)))
    (caster,) = (geom for geom in driving_robot(robot, OPEN_FLOOR).geoms if geom.name == "caster")
    assert 1000 * np.array(caster.pos) == pytest.approx([70.0, 12.0, 9.6 - 28.0])
    assert 1000 * caster.mass == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("wheel_mm", "track_mm", "has_room"),
    [
        # Wheels no smaller than the caster, of 19.2 mm.
        (19.2, 130.0, True),
        (19.1, 130.0, False),
        # A large motor needs half of its width beside each wheel of 14 mm.
        (56.0, "just", True),
        (56.0, "less", False),
    ],
)
def test_motors_need_room_between_the_wheels(
    wheel_mm: float, track_mm: float | str, has_room: bool
) -> None:
    size, _ = case_of(DeviceKind.MOTOR, MotorKind.SPIKE_MEDIUM.value) or ((0.0,) * 3, 0.0)
    just_mm = size[2] + 14.0
    tracks_mm = {"just": just_mm, "less": just_mm - 0.1}
    robot = robot_with(
        wheel_mm=wheel_mm,
        track_mm=tracks_mm[track_mm] if isinstance(track_mm, str) else track_mm,
    )
    if has_room:
        _, left, right, _ = boxes_of(robot)
        assert not left.overlaps(right)
        return
    with pytest.raises(TwinError) as caught:
        driving_robot(robot, OPEN_FLOOR)
    assert str(caught.value).startswith(f"robot 'cart': wheels of {wheel_mm:g} mm, ")
    assert str(caught.value).endswith(
        "leave no room for its motors; give wheels of 19.2 mm or more and a wider axle track"
    )


def test_a_robot_without_a_drive_base_needs_a_model() -> None:
    arm = replace(robot_with(), drive_base=None)
    with pytest.raises(TwinError, match="'cart' has neither a MuJoCo model nor a drive base; give"):
        driving_robot(arm, OPEN_FLOOR)


def test_a_motor_that_drives_nothing_known_turns_above_the_hub() -> None:
    arm = Motor("arm", "C", MotorKind.SPIKE_LARGE, gears=(12, 36))
    robot = robot_with(MotorKind.SPIKE_MEDIUM, 56, 130, arm)
    hub, _, _, extra, _ = boxes_of(robot)
    middle = (extra.low + extra.high) / 2
    hub_middle = (hub.low + hub.high) / 2
    assert middle == pytest.approx(hub_middle + np.array([0.0, 0.0, 30.0]))
    model = driving_robot(robot, OPEN_FLOOR).compile()
    assert 1000 * model.body("rotor_C").pos == pytest.approx([0.0, 0.0, 80.0])
    assert model.actuator("motor_C").gear[0] == pytest.approx(3.0)
    # It is no wheel, so that its motors come in the order of the ports.
    assert [model.actuator(number).name for number in range(model.nu)] == [
        "motor_A",
        "motor_B",
        "motor_C",
    ]


@pytest.mark.parametrize(("track_mm", "distance_m"), [(130, 0.42), (210, 0.42), (300, 0.6)])
def test_cameras_are_as_far_away_as_a_wide_robot_needs(track_mm: float, distance_m: float) -> None:
    spec = driving_robot(robot_with(track_mm=track_mm), OPEN_FLOOR)
    cameras = {camera.name: np.array(camera.pos) for camera in spec.body("chassis").cameras}
    assert set(cameras) == {"chase", "portrait"}
    # From the middle of the robot, within a centimetre.
    chase, portrait = (float(np.linalg.norm(cameras[name])) for name in ("chase", "portrait"))
    assert chase == pytest.approx(distance_m, abs=0.01)
    assert portrait == pytest.approx(0.75 * distance_m, abs=0.01)
    # One looks from behind, the other from the front, both from the right and above.
    assert cameras["chase"][0] < 0 < cameras["portrait"][0]
    assert all(place[1] < 0 < place[2] for place in cameras.values())


# ---------------------------------------------------------------- looks


def drawn_box(piece: Piece) -> Box:
    points = np.concatenate([shape.points for _, shape in piece.shapes])
    return Box(points.min(axis=0), points.max(axis=0), 0.0)


def frame_of(robot: Robot) -> _Frame:
    assert robot.drive_base is not None
    return _Frame(robot, robot.drive_base)


@pytest.mark.parametrize("hub", [HubKind.PRIME, HubKind.TECHNIC, HubKind.CITY])
@pytest.mark.parametrize("kind", [MotorKind.SPIKE_MEDIUM, MotorKind.SPIKE_LARGE])
def test_parts_are_drawn_where_they_are(hub: HubKind, kind: MotorKind) -> None:
    robot = robot_with(kind, hub=hub)
    frame = frame_of(robot)
    drawn = [drawn_box(piece) for piece in frame.parts()]
    masses = boxes_of(robot)
    # Drawings are in the frame of the axle, 28 mm above the floor.
    up = np.array([0.0, 0.0, 28.0])
    for picture, box in zip(drawn[:3], masses[:3], strict=True):
        assert picture.low + up == pytest.approx(box.low, abs=6.5)
        assert picture.high + up == pytest.approx(box.high, abs=6.5)
    along = drawn[3:5]
    across = drawn[5:7]
    top = frame.top
    # Two beams of 13 modules along, and two of 9 across, all at the height of the frame.
    for beam in along:
        assert beam.high - beam.low == pytest.approx([13 * 8.0, 7.6, 7.6], abs=0.5)
    for beam in across:
        assert beam.high - beam.low == pytest.approx([7.6, 9 * 8.0, 7.6], abs=0.6)
    for beam in (*along, *across):
        assert (beam.low[2] + beam.high[2]) / 2 == pytest.approx(top, abs=0.1)
    sides = sorted(float(beam.low[1] + beam.high[1]) / 2 for beam in along)
    assert sides == pytest.approx([-20.0, 20.0], abs=0.1)
    assert all((beam.low + beam.high)[0] / 2 == pytest.approx(-12.0, abs=0.2) for beam in along)
    ends = sorted(float(beam.low[0] + beam.high[0]) / 2 for beam in across)
    # They lie across both of those.
    assert along[0].low[0] < ends[0] < ends[1] < along[0].high[0]
    assert ends == pytest.approx([-52.0, 20.0], abs=0.2)


@pytest.mark.parametrize("wheel_mm", [24.0, 56.0, 88.0])
def test_the_caster_is_drawn_from_the_floor_to_the_frame(wheel_mm: float) -> None:
    robot = robot_with(wheel_mm=wheel_mm, chassis=Chassis(caster_mm=(-60.0, 5.0)))
    frame = frame_of(robot)
    *_, ball, post = [drawn_box(piece) for piece in frame.parts()]
    assert ball.low[2] == pytest.approx(-wheel_mm / 2, abs=0.7)
    assert (ball.low + ball.high)[:2] / 2 == pytest.approx([-60.0, 5.0], abs=0.1)
    assert post.high - post.low == pytest.approx([14.0, 14.0, post.high[2] - post.low[2]], abs=0.1)
    assert post.high[2] == pytest.approx(frame.top)
    # It ends 16 mm above the middle of the ball, but is never shorter than a module.
    middle = 9.6 - wheel_mm / 2
    assert post.low[2] == pytest.approx(min(middle + 16.0, frame.top - 8.0))


@pytest.mark.parametrize(
    "at_mm", [(60.0, 10.0, 18.0), (-70.0, -15.0, 60.0), (25.0, 0.0, 30.0), (12.0, 0.0, 51.0)]
)
def test_a_strut_goes_from_the_frame_to_the_sensor(at_mm: tuple[float, float, float]) -> None:
    frame = frame_of(robot_with())
    ((colour, shape),) = frame._holder(at_mm).shapes
    assert colour == "dark_grey"
    low, high = shape.points.min(axis=0), shape.points.max(axis=0)
    ahead, left, up = at_mm[0] - 12.0, at_mm[1], at_mm[2] - 28.0
    # A bar from 20 mm before or behind the axle, at the height of the frame, and a post upright
    # from there to the sensor, 12 mm behind its eye.
    length = max(abs(ahead) - 20.0, 8.0)
    ends = sorted((math.copysign(20.0, ahead), math.copysign(20.0 + length, ahead)))
    height = max(abs(frame.top - up) - 8.0, 8.0)
    assert low[0] == pytest.approx(min(ends[0], ahead - 3.8))
    assert high[0] == pytest.approx(max(ends[1], ahead + 3.8))
    assert (low[1], high[1]) == pytest.approx((left - 3.8, left + 3.8))
    assert low[2] == pytest.approx(min(frame.top - 3.8, (frame.top + up - height) / 2))
    assert high[2] == pytest.approx(max(frame.top + 3.8, (frame.top + up + height) / 2))


def test_there_is_a_strut_for_each_sensor() -> None:
    light = PoweredUpSensor("light", "C", SensorKind.COLOR, Mount((60.0, 0.0, 18.0), "down"))
    eyes = PoweredUpSensor("eyes", "D", SensorKind.COLOR, Mount((60.0, 20.0, 40.0), "ahead"))
    without = frame_of(robot_with()).parts()
    struts = frame_of(robot_with(sensors=(light, eyes))).parts()[len(without) :]
    assert len(struts) == 2
    assert [drawn_box(strut).high[1] for strut in struts] == pytest.approx([3.8, 23.8])


@pytest.mark.parametrize("kind", [MotorKind.SPIKE_MEDIUM, MotorKind.SPIKE_LARGE])
def test_shafts_are_drawn_on_the_outer_sides(kind: MotorKind) -> None:
    size, _ = case_of(DeviceKind.MOTOR, kind.value) or ((0.0, 0.0, 0.0), 0.0)
    left, right = (drawn_box(_motor(kind, size, side)) for side in (1.0, -1.0))
    assert left.high[1] == pytest.approx(-right.low[1]) and left.low[1] == pytest.approx(
        -right.high[1]
    )
    length, height, width = size
    for motor in (left, right):
        # Its shaft looks out of it.
        assert motor.high - motor.low == pytest.approx([length, width, height], abs=9.5)
        assert motor.high[0] == pytest.approx(12.0, abs=2.0)


def test_a_hub_without_a_drawing_of_its_own_fills_its_case() -> None:
    size = (100.0, 60.0, 40.0)
    drawn = dict(_hub(HubKind.CITY, size).shapes)
    lower, upper, button = (drawn[colour].points for colour in ("dark_grey", "white", "azure"))
    # Three fifths below in grey, two above in white.
    assert (lower.min(axis=0), lower.max(axis=0)) == (
        pytest.approx([-50.0, -30.0, -20.0]),
        pytest.approx([50.0, 30.0, 4.0]),
    )
    assert (upper.min(axis=0), upper.max(axis=0)) == (
        pytest.approx([-49.0, -29.0, 4.0]),
        pytest.approx([49.0, 29.0, 20.0]),
    )
    # A button of 12 mm half way to the front, on top.
    assert np.ptp(button, axis=0) == pytest.approx([12.0, 12.0, 2.0], abs=0.1)
    assert (button.min(axis=0) + button.max(axis=0)) / 2 == pytest.approx(
        [25.0, 0.0, 20.0], abs=0.1
    )


@pytest.mark.parametrize("wheel_mm", [19.2, 21.4, 24.0, 30.0, 34.2, 34.3, 43.2, 56.0, 88.0])
def test_wheels_of_any_size_are_drawn_at_their_size(wheel_mm: float) -> None:
    colours = dict(pieces.wheel(wheel_mm).shapes)
    tyre, rim = colours["black"].points, colours["light_grey"].points
    assert np.ptp(tyre, axis=0)[[0, 2]] == pytest.approx([wheel_mm] * 2, abs=0.8)
    assert np.ptp(tyre, axis=0)[1] == pytest.approx(14.0, abs=0.1)
    # The rim is inside of the tyre, and no thicker.
    assert np.ptp(rim, axis=0).max() < wheel_mm - 5.0
    assert np.ptp(rim, axis=0)[1] <= 13.01
    for _, shape in pieces.wheel(wheel_mm).shapes:
        corners = shape.points[shape.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals = shape.normals[shape.faces].mean(axis=1)
        assert (np.einsum("ij,ij->i", across, normals) > -1e-9).all()
