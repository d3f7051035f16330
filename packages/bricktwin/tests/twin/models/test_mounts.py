"""Mounts of sensors and hubs: where they are, where they look, and what touches them."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from brickhub.robot import Mount, PoweredUpSensor, SensorKind, UltrasonicSensor
from brickhub.robot.spec import LOOKS
from bricktwin.plans.drawing.pieces import Piece
from bricktwin.plans.part import DeviceKind
from bricktwin.twin.engines.conventions import SHAPE_GROUP
from bricktwin.twin.models import mounts
from bricktwin.twin.models.mounts import (
    add_hub_site,
    case_of,
    hub_axes,
    mount_of,
    mount_sensor,
)

AXLE_M = 0.028
AT_MM = (60.0, -20.0, 45.0)
EYE_MM = np.array([60.0, -20.0, 17.0])
"""The same from the chassis' origin, which is as high as the axle."""


def mounted(sensor: Any) -> tuple[mujoco.MjModel, mujoco.MjData, Piece]:
    spec = mujoco.MjSpec()
    chassis = spec.worldbody.add_body(name="chassis")
    chassis.add_freejoint()
    chassis.add_geom(size=[0.01, 0.0, 0.0], mass=0.1, contype=0, conaffinity=0)
    drawn = mount_sensor(spec, chassis, sensor, AXLE_M)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data, drawn


def boxes_mm(model: mujoco.MjModel, data: mujoco.MjData) -> list[tuple[Any, Any, int]]:
    """Lowest and highest corner of each box, and whether it collides."""
    found = []
    for geom in range(1, model.ngeom):
        reach = np.abs(data.geom_xmat[geom].reshape(3, 3)) @ model.geom_size[geom]
        middle = data.geom_xpos[geom]
        found.append(
            (1000 * (middle - reach), 1000 * (middle + reach), int(model.geom_contype[geom]))
        )
    return found


@pytest.mark.parametrize("looks", LOOKS)
def test_a_sensor_looks_out_of_its_case_to_its_side(looks: str) -> None:
    gaze = np.array(LOOKS[looks])
    along = int(np.abs(gaze).argmax())
    color = PoweredUpSensor("light", "C", SensorKind.COLOR, Mount(AT_MM, looks))
    eyes = UltrasonicSensor("eyes", "D", Mount(AT_MM, looks))
    for sensor, site, collides in ((color, "sensor_C", 0), (eyes, "ultrasonic_D", 1)):
        model, data, drawn = mounted(sensor)
        assert 1000 * data.site(site).xpos == pytest.approx(EYE_MM)
        # Its x axis is the viewing direction.
        assert data.site(site).xmat.reshape(3, 3)[:, 0] == pytest.approx(gaze, abs=1e-9)
        ((low, high, contype),) = boxes_mm(model, data)
        size, mass_g = case_of(DeviceKind.SENSOR, sensor.kind.value)  # type: ignore[misc]
        # The eye is in the middle of a large side, which is the front one.
        front = high[along] if gaze[along] > 0 else low[along]
        assert front == pytest.approx(EYE_MM[along])
        assert high[along] - low[along] == pytest.approx(min(size))
        others = [axis for axis in range(3) if axis != along]
        assert (low + high)[others] / 2 == pytest.approx(EYE_MM[others])
        assert sorted((high - low)[others]) == pytest.approx(sorted(size[:2]))
        assert contype == collides
        assert model.body("chassis").mass[0] - 0.1 == pytest.approx(mass_g / 1000)
        # It is drawn where it is.
        points = np.concatenate([shape.points for _, shape in drawn.shapes])
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        assert np.linalg.norm(middle - (low + high) / 2) < 8.0


@pytest.mark.parametrize("looks", ["ahead", "back", "left"])
def test_only_the_button_of_a_force_sensor_is_touched(looks: str) -> None:
    gaze = np.array(LOOKS[looks])
    along = int(np.abs(gaze).argmax())
    sensor = PoweredUpSensor("bump", "B", SensorKind.FORCE, Mount(AT_MM, looks))
    model, data, _ = mounted(sensor)
    button, case = sorted(boxes_mm(model, data), key=lambda one: -one[2])
    assert (button[2], case[2]) == (1, 0)
    # From the front backwards: 8 mm of button, then the case.
    sign = int(gaze[along])
    ends = sorted(
        round(sign * (float(value) - EYE_MM[along]), 3)
        for one in (button, case)
        for value in (one[0][along], one[1][along])
    )
    size, mass_g = case_of(DeviceKind.SENSOR, sensor.kind.value)  # type: ignore[misc]
    assert ends == pytest.approx([-8.0 - max(size), -8.0, -8.0, 0.0])
    assert model.body("chassis").mass[0] - 0.1 == pytest.approx(mass_g / 1000)
    # The site around the button measures what touches it.
    assert model.sensor("force_B").type[0] == mujoco.mjtSensor.mjSENS_TOUCH
    assert model.site("sensor_B").size.tolist() == [0.012] * 3
    assert 1000 * data.site("sensor_B").xpos == pytest.approx(EYE_MM)


@pytest.mark.parametrize(
    ("sides", "front", "left", "top"),
    [
        (("up", "ahead"), (1, 0, 0), (0, 1, 0), (0, 0, 1)),
        (("ahead", "down"), (0, 0, -1), (0, 1, 0), (1, 0, 0)),
        (("left", "ahead"), (1, 0, 0), (0, 0, -1), (0, 1, 0)),
        (("down", "back"), (-1, 0, 0), (0, 1, 0), (0, 0, -1)),
    ],
)
def test_axes_of_a_hub_are_its_front_its_left_and_its_top(
    sides: tuple[str, str], front: Any, left: Any, top: Any
) -> None:
    axes = hub_axes(sides)
    assert axes.T.tolist() == [list(front), list(left), list(top)]
    assert np.linalg.det(axes) == pytest.approx(1.0)
    spec = mujoco.MjSpec()
    add_hub_site(spec.worldbody, axes, (0.1, 0.2, 0.3))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.site("imu").xmat.reshape(3, 3) == pytest.approx(axes, abs=1e-9)
    assert data.site("imu").xpos.tolist() == [0.1, 0.2, 0.3]


def test_sensors_without_a_mount_look_where_their_kind_does() -> None:
    def looks(kind: SensorKind) -> str:
        return mount_of(PoweredUpSensor("s", "A", kind)).looks

    assert looks(SensorKind.COLOR) == looks(SensorKind.EV3_COLOR) == "down"
    assert looks(SensorKind.FORCE) == looks(SensorKind.EV3_TOUCH) == "ahead"
    assert looks(SensorKind.EV3_GYRO) == "up"
    assert mount_of(UltrasonicSensor("eyes", "A")).looks == "ahead"
    own = Mount(AT_MM, "left")
    assert mount_of(UltrasonicSensor("eyes", "A", own)) is own
    # A floor that it faces is near; one that looks ahead is higher.
    assert mount_of(PoweredUpSensor("s", "A", SensorKind.COLOR)).at_mm[2] < 20


def test_cases_are_those_of_the_catalogue() -> None:
    (length, width, height), mass_g = case_of(DeviceKind.HUB, "prime")  # type: ignore[misc]
    assert (length, width, height) == pytest.approx((88.0, 56.0, 32.0), abs=6.0)
    assert 100 < mass_g < 250 and length >= width >= height
    assert case_of(DeviceKind.MOTOR, "prime") is case_of(DeviceKind.HUB, "none") is None


@pytest.mark.parametrize(
    ("kind", "at_mm", "looks"),
    [
        # Eyes are in front of the axle; what reads the floor is close above it.
        (SensorKind.ULTRASONIC, (60.0, 0.0, 40.0), "ahead"),
        (SensorKind.EV3_ULTRASONIC, (60.0, 0.0, 40.0), "ahead"),
        (SensorKind.COLOR, (60.0, 0.0, 12.0), "down"),
        (SensorKind.COLOR_DISTANCE, (60.0, 0.0, 12.0), "down"),
        (SensorKind.EV3_COLOR, (60.0, 0.0, 12.0), "down"),
        # A button is farthest ahead, so that it meets what the robot drives against.
        (SensorKind.FORCE, (80.0, 0.0, 30.0), "ahead"),
        (SensorKind.EV3_TOUCH, (80.0, 0.0, 30.0), "ahead"),
        # A gyroscope lies behind, upright.
        (SensorKind.EV3_GYRO, (-60.0, 0.0, 90.0), "up"),
    ],
)
def test_a_sensor_without_a_mount_has_its_usual_place(
    kind: SensorKind, at_mm: tuple[float, float, float], looks: str
) -> None:
    mount = mount_of(PoweredUpSensor("one", "C", kind))
    assert mount.at_mm == at_mm and mount.looks == looks


def box_of(piece: Piece, colour: str) -> tuple[Any, Any]:
    points = dict(piece.shapes)[colour].points
    return points.min(axis=0), points.max(axis=0)


def test_a_force_sensor_is_drawn_behind_the_front_of_its_button() -> None:
    drawn = mounts._force_sensor((40.0, 24.0, 22.0))
    low, high = box_of(drawn, "black")
    # A button of 8 mm length and radius.
    assert low == pytest.approx([-8.0, -8.0, -8.0], abs=0.2)
    assert high == pytest.approx([0.0, 8.0, 8.0], abs=0.2)
    low, high = box_of(drawn, "white")
    assert low == pytest.approx([-48.0, -12.0, -11.0]) and high == pytest.approx([-8.0, 12.0, 11.0])
    # A stripe in the middle of its length, a little wider than the case.
    low, high = box_of(drawn, "light_grey")
    assert low == pytest.approx([-36.0, -12.2, 0.0]) and high == pytest.approx([-20.0, 12.2, 6.0])


def test_other_sensors_are_drawn_behind_their_round_eye() -> None:
    drawn = mounts._small_sensor((26.0, 24.0, 20.0))
    low, high = box_of(drawn, "white")
    assert low == pytest.approx([-20.0, -13.0, -12.0]) and high == pytest.approx([-2.0, 13.0, 12.0])
    # The eye is before the case, and its rim before the eye.
    low, high = box_of(drawn, "black")
    assert (low[0], high[0]) == pytest.approx((-2.2, -0.6))
    assert high[1:] == pytest.approx([8.8, 8.8], abs=0.15)
    low, high = box_of(drawn, "azure")
    assert (low[0], high[0]) == pytest.approx((-1.8, 0.2))
    assert high[1:] == pytest.approx([8.6, 8.6], abs=0.15)


@pytest.mark.parametrize("kind", [SensorKind.COLOR, SensorKind.FORCE, SensorKind.ULTRASONIC])
def test_only_the_place_of_a_button_measures_what_touches_it(kind: SensorKind) -> None:
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="chassis")
    sensor = PoweredUpSensor("one", "D", kind)
    mounts.add_sensor_site(spec, body, sensor, np.array([0.1, 0.2, 0.3]), [0.6, 0.0, 0.8, 0.0])
    (site,) = body.sites
    assert site.pos.tolist() == [0.1, 0.2, 0.3] and site.quat.tolist() == [0.6, 0.0, 0.8, 0.0]
    is_button = kind is SensorKind.FORCE
    assert len(spec.sensors) == is_button
    # A site is seen by nobody: it is in the group of shapes that touch, or in one of its own.
    assert site.group == (5 if is_button else SHAPE_GROUP)
    if is_button:
        # As large as the button, 24 mm.
        assert site.type == mujoco.mjtGeom.mjGEOM_BOX and site.size.tolist() == [0.012] * 3
        assert spec.sensors[0].name == "force_D" and spec.sensors[0].objname == site.name
