"""What sensors see, in a world of which every ray is known; and inertial sensors by formulas."""

from __future__ import annotations

import colorsys
import math
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bricktwin.twin.engines.engine import Hit
from bricktwin.twin.engines.rotations import Vector, about, rotated, rotated_back, yaw_quaternion
from bricktwin.twin.objects import COLORS, Beacon, Block, Field, Lamp, Line
from bricktwin.twin.scene import FLOOR, Scene
from bricktwin.twin.senses import (
    FloatingBase,
    SummedNoise,
    Turns,
    WorldSenses,
    clockwise_deg,
    spot_mm,
)

DOWN, AHEAD, LEFT = (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)


@dataclass
class Rays:
    """An engine whose rays meet a geometry at this distance, or nothing."""

    distance_m: float = math.inf
    geom: int = 0
    asked: list[tuple[Vector, Vector]] = field(default_factory=list)

    def index(self, kind: str, name: str) -> int:
        return 7

    def ray(self, origin_m: Vector, direction: Vector, groups: tuple[int, ...]) -> Hit | None:
        self.asked.append((origin_m, direction))
        if math.isinf(self.distance_m):
            return None
        return Hit(self.distance_m, self.geom, (0.0, 0.0, 1.0))


def senses(scene: Scene, **rays: Any) -> WorldSenses:
    return WorldSenses(Rays(**rays), scene)  # type: ignore[arg-type]


def seen(rgb: tuple[float, float, float], brightness: float = 1.0) -> Any:
    hue, saturation, value = colorsys.rgb_to_hsv(*(brightness * part for part in rgb))
    return pytest.approx((360.0 * hue, 100.0 * saturation, 100.0 * value))


@pytest.mark.parametrize(
    ("above_mm", "brightness"), [(5.0, 1.0), (20.0, 1.0), (40.0, 0.25), (200.0, 0.01)]
)
def test_a_color_sensor_sees_the_floor_darker_from_afar(above_mm: float, brightness: float) -> None:
    floor = senses(Scene())
    assert floor.surface((0.0, 0.0, above_mm / 1000), DOWN) == seen(FLOOR, brightness)
    slanted = (0.6, 0.0, -0.8)
    assert floor.surface((0.0, 0.0, 0.8 * above_mm / 1000), slanted) == seen(FLOOR, brightness)


def test_a_color_sensor_sees_what_is_nearest() -> None:
    scene = Scene(objects=(Block((300.0, 0.0), color="green"),))
    eye = (0.0, 0.0, 0.05)
    assert senses(scene, distance_m=0.04, geom=7).surface(eye, DOWN) == seen(
        COLORS["green"], (20 / 40) ** 2
    )
    assert senses(scene, distance_m=0.06, geom=7).surface(eye, DOWN) == seen(FLOOR, (20 / 50) ** 2)
    # What is no object of the scene is a wall of bricks; where there is nothing, it is black.
    hue, saturation, value = senses(scene, distance_m=0.02, geom=3).surface(eye, AHEAD)
    assert (hue < 20 or hue > 340) and saturation > 60 and value > 50
    assert senses(scene).surface(eye, AHEAD) == (0.0, 0.0, 0.0)
    assert senses(scene).surface(eye, (0.8, 0.0, 0.6)) == (0.0, 0.0, 0.0)


def test_a_spot_mixes_the_colors_below_it_as_the_area_they_cover() -> None:
    """A line whose edge goes through the middle of the spot; another mark on top."""
    eye = (0.1, 0.05, 0.016)
    radius_mm = spot_mm(16.0)
    assert 5.0 < radius_mm < 7.0 and spot_mm(32.0) > 1.5 * radius_mm

    def mean(*objects: Any) -> np.ndarray:
        return np.array(senses(Scene(objects=objects))._floor((eye[0], eye[1], 0.0), 0.016))

    black, red = np.array(COLORS["black"]), np.array(COLORS["red"])
    half = mean(Line(((110.0, -500.0), (110.0, 500.0)), width_mm=20.0))
    share = (FLOOR[0] - half[0]) / (FLOOR[0] - black[0])
    assert 0.35 < share < 0.65
    assert half == pytest.approx((1 - share) * np.array(FLOOR) + share * black)
    # All of it is covered, or nothing.
    assert mean(Field((100.0, 50.0), (30.0, 30.0))) == pytest.approx(red)
    assert mean(Field((100.0 + 15.0 + radius_mm, 50.0), (29.0, 30.0))) == pytest.approx(FLOOR)
    # The mark that lies on top hides the other one.
    line = Line(((110.0, -500.0), (110.0, 500.0)), width_mm=20.0)
    field = Field((100.0, 50.0), (30.0, 30.0))
    assert mean(line, field) == pytest.approx(red)
    assert mean(field, line) == pytest.approx((1 - share) * red + share * black)


def lamp_at(*at_mm: float) -> Scene:
    return Scene(objects=(Lamp(at_mm, 40.0),), light_pct=10.0)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("at_mm", "light_pct"),
    [
        # Its brightness is that 300 mm ahead, and weakens with the square of the distance.
        ((300.0, 0.0, 0.0), 10.0 + 40.0),
        ((600.0, 0.0, 0.0), 10.0 + 10.0),
        ((150.0, 0.0, 0.0), 100.0),
        # From the side by the cosine, and from behind not at all.
        ((180.0, 240.0, 0.0), 10.0 + 24.0),
        ((0.0, 300.0, 0.0), 10.0),
        ((-300.0, 0.0, 0.0), 10.0),
    ],
)
def test_a_lamp_adds_to_the_light_of_the_room(at_mm: tuple[float, ...], light_pct: float) -> None:
    assert senses(lamp_at(*at_mm)).ambient((0.0, 0.0, 0.0), AHEAD) == pytest.approx(light_pct)


def test_a_lamp_behind_an_obstacle_is_not_seen() -> None:
    eye = (0.0, 0.0, 0.1)
    lamp = lamp_at(300.0, 0.0, 100.0)
    assert senses(lamp, distance_m=0.29).ambient(eye, AHEAD) == 10.0
    assert senses(lamp, distance_m=0.31).ambient(eye, AHEAD) == pytest.approx(50.0)
    two = Scene(objects=(*lamp.objects, Lamp((600.0, 0.0, 100.0), 40.0)), light_pct=10.0)
    assert senses(two).ambient(eye, AHEAD) == pytest.approx(60.0)
    # Very near it gets no brighter, and no reading is above 100 %.
    assert senses(lamp_at(1.0, 0.0, 0.0)).ambient((0.0, 0.0, 0.0), AHEAD) == 100.0
    dim = Scene(objects=(Lamp((1.0, 0.0, 0.0), 0.5),), light_pct=10.0)
    assert senses(dim).ambient((0.0, 0.0, 0.0), AHEAD) == pytest.approx(10.0 + 0.5 * 100)


@pytest.mark.parametrize(
    ("at_mm", "reading"),
    [
        ((1000.0, 0.0, 0.0), (50.0, 0.0)),
        ((2000.0, 0.0, 0.0), (100.0, 0.0)),
        ((2001.0, 0.0, 0.0), ()),
        # To the right positive.
        ((300.0, -300.0, 0.0), (100.0 * math.hypot(300.0, 300.0) / 2000.0, 45.0)),
        ((300.0, 519.615, 0.0), (30.0, -60.0)),
        ((-300.0, 0.0, 0.0), ()),
        ((0.0, 300.0, 0.0), ()),
    ],
)
def test_a_beacon_is_seen_before_the_sensor(
    at_mm: tuple[float, float, float], reading: tuple[float, ...]
) -> None:
    scene = Scene(objects=(Beacon(at_mm),))
    eye = (0.0, 0.0, 0.0)
    assert senses(scene).beacon(eye, AHEAD, LEFT) == pytest.approx(reading, abs=1e-3)
    assert senses(scene, distance_m=0.1).beacon(eye, AHEAD, LEFT) == ()


def test_the_nearest_beacon_is_the_one_that_is_reported() -> None:
    scene = Scene(objects=(Beacon((1500.0, 0.0, 0.0)), Beacon((0.1, -500.0, 0.0))))
    distance, direction = senses(scene).beacon((0.0, 0.0, 0.0), AHEAD, LEFT)
    assert (distance, direction) == pytest.approx((25.0, 90.0), abs=0.1)


@pytest.mark.parametrize(
    ("gaze", "hit_m", "distance_mm"),
    [
        (AHEAD, 0.5, 500.0),
        (AHEAD, 2.99, 2990.0),
        (AHEAD, 3.01, math.inf),
        (AHEAD, math.inf, math.inf),
        (DOWN, math.inf, 100.0),
        (DOWN, 0.04, 40.0),
        (DOWN, 0.2, 100.0),
        ((0.8, 0.0, -0.6), 5.0, 100.0 / 0.6),
        ((0.8, 0.0, 0.6), math.inf, math.inf),
    ],
)
def test_distance_is_to_the_nearest_surface(gaze: Vector, hit_m: float, distance_mm: float) -> None:
    got = senses(Scene(), distance_m=hit_m).distance_mm((0.0, 0.0, 0.1), gaze)
    assert got == pytest.approx(distance_mm)


@pytest.mark.parametrize("turns", [3, -3])
def test_a_heading_counts_whole_turns_clockwise(turns: int) -> None:
    state, steps = Turns(), 20 * abs(turns)
    for step in range(1, steps + 1):
        # A quaternion's angle is counter-clockwise.
        state.update(yaw_quaternion(-2 * math.pi * turns * step / steps))
    assert state.heading_deg == pytest.approx(360.0 * turns)
    assert state.rotation_rad == pytest.approx((0.0, 0.0, -2 * math.pi * turns))
    assert clockwise_deg(yaw_quaternion(math.radians(30))) == pytest.approx(-30)


def test_rotation_is_summed_up_in_the_axes_of_what_turns() -> None:
    state = Turns()
    nose_down = about((0.0, 1.0, 0.0), 0.4)
    state.update(nose_down)
    assert state.rotation_rad == pytest.approx((0.0, 0.4, 0.0)) and state.heading_deg == 0.0
    state.update(yaw_quaternion(0.0))
    assert state.rotation_rad == pytest.approx((0.0, 0.0, 0.0))


def test_noise_of_a_heading_walks_by_time_alone() -> None:
    class Ones:
        count = 0

        def standard_normal(self) -> float:
            self.count += 1
            return 1.0

    rng = Ones()
    noise = SummedNoise(rng)  # type: ignore[arg-type]
    # A sample for each 5 ms; the deviation of their sum is that of 833 samples in a second.
    step_deg = math.sqrt(0.005 / 833)
    assert noise.deg(0.0049, 2.0) == 0.0
    assert noise.deg(0.0051, 2.0) == pytest.approx(2.0 * step_deg)
    assert noise.deg(0.0051, 2.0) == pytest.approx(2.0 * step_deg)
    assert noise.deg(1.0001, 3.0) == pytest.approx(200 * 3.0 * step_deg)
    assert rng.count == 200


def test_an_accelerometer_beside_the_axis_feels_the_turn() -> None:
    """A hub 0.1 m ahead of the origin of a chassis that is tilted, accelerates and spins."""
    tilt = about((0.0, 1.0, 0.0), 0.5)
    hub = (0.1, 0.02, 0.05)
    mounted = about((0.0, 0.0, 1.0), 0.3)
    spin, angular, linear = (0.1, -0.4, 2.0), (3.0, 1.0, -5.0), (0.7, 0.2, -1.0)
    fields = {"site_pos": [0.0, 0.0, 0.0, *hub], "site_quat": [1.0, 0.0, 0.0, 0.0, *mounted]}
    engine: Any = SimpleNamespace(
        qpos=[9.0, 1.0, 2.0, 3.0, *tilt],
        qvel=[8.0, 0.0, 0.0, 0.0, *spin],
        qacc=[7.0, *linear, *angular],
        gravity=[0.0, 0.0, -9.81],
        index=lambda kind, name: ["other", "imu"].index(name),
        nominal=lambda field: fields[field],
    )
    base = FloatingBase(engine, 1, 1, "imu")
    assert base.position() == (1.0, 2.0, 3.0) and base.orientation() == tilt
    assert base.in_world(AHEAD) == pytest.approx(rotated(AHEAD, tilt))
    assert base.angular_velocity() == pytest.approx(rotated_back(spin, mounted))
    # a + w' x r + w x (w x r) - g, in the axes of the hub.
    world = np.array(linear) - np.array([0.0, 0.0, -9.81])
    felt = np.array(rotated_back(tuple(world), tilt)) + np.cross(angular, hub)
    felt += np.cross(spin, np.cross(spin, hub))
    assert base.specific_force() == pytest.approx(rotated_back(tuple(felt), mounted))
    up = base.up((0.0, 0.0, 1.0))
    assert up == pytest.approx(rotated_back(rotated_back((0.0, 0.0, 1.0), tilt), mounted))
