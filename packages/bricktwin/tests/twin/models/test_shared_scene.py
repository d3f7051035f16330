"""Where several robots start in one scene, and what leaves its place for them."""

from __future__ import annotations

import math

import pytest

from brickhub.errors import TwinError
from bricktwin.twin.models.shared_scene import shared_scene, starts_in
from bricktwin.twin.objects import Ball, Block, Lamp, Object, Ramp, Wall
from bricktwin.twin.scene import OPEN_FLOOR, Scene


def places_mm(scene: Scene, count: int) -> list[tuple[float, float]]:
    """Places of the robots after the first one, without rounding errors."""
    return [
        (round(1000 * x_m, 6) + 0.0, round(1000 * y_m, 6) + 0.0)
        for x_m, y_m, _ in starts_in(scene, count)[1:]
    ]


def test_robots_stand_to_the_left_to_the_right_and_behind_half_a_metre_apart() -> None:
    places = places_mm(OPEN_FLOOR, 13)
    assert places[:4] == [(0.0, 500.0), (0.0, 1000.0), (0.0, 1500.0), (0.0, 2000.0)]
    assert places[4:8] == [(0.0, -500.0), (0.0, -1000.0), (0.0, -1500.0), (0.0, -2000.0)]
    assert places[8:] == [(-500.0, 0.0), (-1000.0, 0.0), (-1500.0, 0.0), (-2000.0, 0.0)]
    many = [(0.0, 0.0), *places_mm(OPEN_FLOOR, 81)]
    assert len(set(many)) == 81 and max(max(map(abs, place)) for place in many) == 2000.0
    # Then the nearest places that are left.
    assert {*many[13:17]} >= {(500.0, 0.0)} and math.hypot(*many[14]) == pytest.approx(707, abs=1)
    rest = [math.hypot(*place) for place in many[13:]]
    assert rest == sorted(rest)
    with pytest.raises(TwinError, match="there is no room for 82 robots"):
        starts_in(OPEN_FLOOR, 82)


def test_robots_stand_beside_the_middle_of_the_firsts_ranges_and_look_as_it_does() -> None:
    scene = Scene(start_mm=((100.0, 300.0), (-50.0, 150.0)), heading_deg=(80.0, 100.0))
    first, second, *_ = starts_in(scene, 3)
    assert first == (0.2, 0.05, 90.0)
    # Who looks along -y, has its left along x.
    assert second == (pytest.approx(0.7), pytest.approx(0.05), 90.0)
    turned = Scene(heading_deg=(30.0, 30.0))
    assert places_mm(turned, 2) == [
        pytest.approx((500 * math.sin(math.pi / 6), 500 * math.cos(math.pi / 6)))
    ]
    assert places_mm(turned, 13)[8] == pytest.approx(
        (-500 * math.cos(math.pi / 6), 500 * math.sin(math.pi / 6))
    )


def test_a_scene_says_where_the_others_start() -> None:
    scene = Scene(others_start=((0.0, 600.0, 180.0), (50.0, -600.0, -90.0)))
    starts = starts_in(scene, 4)
    assert starts[1:3] == [(0.0, 0.6, 180.0), (0.05, -0.6, -90.0)]
    # The next one is beside the first one, half a metre from all.
    assert starts[3][2] == 0.0
    assert all(math.dist(starts[3][:2], start[:2]) > 0.49 for start in starts[:3])
    assert len(starts_in(scene, 1)) == 1 and starts_in(scene, 2) == starts[:2]


LEFT = (0.0, 500.0)


@pytest.mark.parametrize(
    ("item", "is_free"),
    [
        # The place to the left has 20 cm around it.
        (Block((0.0, 735.0), (64.0, 64.0, 64.0)), True),
        (Block((0.0, 730.0), (64.0, 64.0, 64.0)), False),
        (Block((240.0, 500.0), (64.0, 200.0, 64.0)), True),
        (Block((240.0, 500.0), (200.0, 64.0, 64.0)), False),
        (Block((240.0, 500.0), (200.0, 64.0, 64.0), heading_deg=90.0), True),
        (Block((155.0, 655.0), (20.0, 20.0, 20.0)), True),
        (Block((140.0, 640.0), (20.0, 20.0, 20.0)), False),
        (Ball((240.0, 500.0), 74.0), True),
        (Ball((230.0, 500.0), 74.0), False),
        # The way to it has 12 cm on both sides.
        (Wall((130.0, -400.0), (130.0, 240.0), thickness_mm=16.0), True),
        (Wall((126.0, -400.0), (126.0, 240.0), thickness_mm=16.0), False),
        (Wall((130.0, -400.0), (130.0, 240.0), thickness_mm=24.0), False),
        (Wall((-60.0, 200.0), (60.0, 300.0)), False),
        # A ramp begins at its place, and rises ahead of it.
        (Ramp((-700.0, 500.0), 480.0, 100.0), True),
        (Ramp((-700.0, 500.0), 520.0, 100.0), False),
        (Ramp((210.0, 500.0), 400.0, 100.0), True),
        (Ramp((210.0, 500.0), 400.0, 100.0, heading_deg=180.0), False),
        (Ramp((0.0, 710.0), 400.0, 100.0, heading_deg=-90.0), True),
        (Ramp((0.0, 710.0), 400.0, 100.0, heading_deg=90.0), False),
        # A lamp hangs above.
        (Lamp((0.0, 500.0, 300.0)), True),
    ],
)
def test_a_robot_starts_where_there_is_room_for_it_and_its_way(item: Object, is_free: bool) -> None:
    (place,) = places_mm(Scene(objects=(item,)), 2)
    assert (place == LEFT) is is_free


@pytest.mark.parametrize(
    ("item", "stays"),
    [
        (Ball((500.0, 195.0)), False),
        (Ball((500.0, 205.0)), True),
        (Ball((310.0, 0.0)), False),
        (Block((550.0, 0.0), mass_g=50.0), False),
        (Block((550.0, 0.0)), True),
        (Block((710.0, 0.0), mass_g=50.0), True),
        (Wall((500.0, -50.0), (500.0, 50.0)), True),
    ],
)
def test_what_can_be_pushed_leaves_its_place_for_another_robot(item: Object, stays: bool) -> None:
    far = Ball((-900.0, 0.0))
    scene = Scene(objects=(item, far), others_start=((500.0, 0.0, 0.0),))
    assert shared_scene(scene).objects == ((item, far) if stays else (far,))
    assert shared_scene(Scene(objects=(item, far))).objects == (item, far)


@pytest.mark.parametrize(
    ("scene", "what"),
    [
        (Scene(wall_distance_mm=(500.0, 600.0)), "a wall before its sensor"),
        (Scene(held_deg=(0.0, 1.0)), "a hand that holds it"),
        (Scene(ball=True), "a ball in its gripper"),
        (Scene(readings={"eyes": lambda angles: 3.0}), "readings of its own"),
        (Scene(end_stops={"arm": (-10.0, 10.0)}), "end stops of its own"),
    ],
)
def test_what_only_one_robot_can_have_is_named(scene: Scene, what: str) -> None:
    with pytest.raises(TwinError, match=f"^{what}.* is for one robot alone"):
        shared_scene(scene)
