"""Robots of a site: which worlds each is offered, and how files name what others have."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from brickhub.errors import TwinError
from bricktwin.robots import EV3_DRIVER, ROBO_ARM, SCOUT, TWO_WHEELER, WALKER
from bricktwin.robots.as_drawn import robot_as_drawn
from bricktwin.site import robots as module
from bricktwin.site.robots import (
    _can_be_in,
    _disc_of,
    _held,
    _numbered,
    _rounded,
    _starts,
    _title,
    write_robots,
)
from bricktwin.twin.arena import COLORS
from bricktwin.twin.scene import OPEN_FLOOR, Scene
from bricktwin.worlds import WORLDS, world

EXAMPLES = Path(__file__).parents[4] / "examples"
WALL = Scene(wall_distance_mm=(200.0, 300.0))
MINE = Scene(start_mm=((0.0, 10.0), (0.0, 0.0)))


@pytest.fixture
def offered(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """Writes robots without their files; the worlds of each, by its name."""
    written: dict[str, dict[str, Scene]] = {}

    def write(site: Path, folder: str, robot: Any, worlds: dict[str, Scene]) -> list[str]:
        written[robot.name] = worlds
        return [f"{folder}/{name}" for name in worlds]

    monkeypatch.setattr(module, "_write_worlds", write)

    def offer(robots: Any, worlds: Any, further: Any = None) -> Any:
        return write_robots(tmp_path, robots, worlds, further or {}), written

    return offer


def test_drivers_are_offered_all_worlds_and_others_a_wall(offered: Any) -> None:
    names = ("wall", "line-simple", "squares", "maze")
    worlds = {name: world(name) for name in names}
    index, written = offered((TWO_WHEELER, WALKER, ROBO_ARM), worlds)
    assert list(written["two-wheeler"]) == ["open floor", *names]
    assert list(written["walker"]) == ["open floor", "wall"]
    # An arm has no gyroscope, and stands where it is.
    assert list(written["robo-arm"]) == ["open floor"]
    assert [entry["name"] for entry in index] == ["two-wheeler", "walker", "robo-arm"]
    assert [entry["title"] for entry in index] == ["2Wheeler", "Walker", "RoboArm"]
    assert [entry["drives"] for entry in index] == [True, False, False]
    assert index[1]["meshes"] == "robots/walker/meshes.json"
    assert index[1]["worlds"] == ["robots/walker/open floor", "robots/walker/wall"]
    assert written["walker"]["open floor"] is OPEN_FLOOR


def test_some_robots_are_offered_fewer_worlds_but_all_of_ones_own(offered: Any) -> None:
    worlds = {"wall": world("wall"), "squares": world("squares"), "my mat": MINE}
    assert "my mat" not in WORLDS
    _, written = offered((EV3_DRIVER, SCOUT), worlds, {"scout": {"track": MINE}})
    assert list(written["ev3-driver"]) == ["open floor", "wall", "my mat"]
    assert list(written["scout"]) == ["open floor", "wall", "squares", "my mat", "track"]


def test_a_robot_that_sees_nothing_is_not_put_before_a_wall(offered: Any) -> None:
    blind = replace(TWO_WHEELER, name="blind", sensors=())
    assert not _can_be_in(blind, WALL) and _can_be_in(blind, OPEN_FLOOR)
    assert _can_be_in(TWO_WHEELER, WALL) and _can_be_in(TWO_WHEELER, OPEN_FLOOR)
    index, written = offered((blind,), {"wall": WALL, "my mat": MINE})
    assert list(written["blind"]) == ["open floor", "my mat"]
    # A name that is not one of ours is its title.
    assert index[0]["title"] == "blind" and index[0]["drives"]


def test_a_robot_on_one_axle_is_held_in_all_of_its_worlds() -> None:
    balancer = robot_as_drawn(EXAMPLES / "drawings" / "balancer.ldr").robot
    held = _held(balancer, MINE)
    assert held.held_deg is not None and held.start_mm == MINE.start_mm
    low, high = held.held_deg
    # It leans by what brings its mass above its axle.
    assert low == high and abs(low) < 30.0
    assert _held(TWO_WHEELER, MINE) is MINE
    assert _held(replace(TWO_WHEELER, model=None), MINE) is MINE


def test_meshes_that_another_file_has_are_their_numbers() -> None:
    first, second, other = {"a": "1"}, {"b": "2"}, {"c": "3"}
    assert _numbered([second, other, dict(first)], [first, second]) == [1, other, 0]
    assert _numbered([], [first]) == []


def test_numbers_of_a_frame_are_exact_to_a_hundredth_of_a_millimetre() -> None:
    assert _rounded(np.array([[0.1234567, -1.0], [2.000004, 0.0]])) == [0.12346, -1.0, 2.0, 0.0]


def test_names_of_worlds_are_words() -> None:
    assert _title("line-simple") == "line simple" and _title("my_mat-2") == "my mat 2"


def test_a_room_has_as_many_starts_as_it_has_room_for(monkeypatch: pytest.MonkeyPatch) -> None:
    for room, expected in ((0, 0), (1, 1), (3, 3), (9, 4)):

        def starts_in(scene: Scene, count: int, room: int = room) -> list[int]:
            if count > room:
                raise TwinError("no room")
            return list(range(count))

        monkeypatch.setattr(module, "starts_in", starts_in)
        assert len(_starts(OPEN_FLOOR)) == expected


def test_the_disc_of_a_robot_is_the_last_shape_of_its_colour() -> None:
    class Shape:
        def __init__(self, *colour: float) -> None:
            self.colour = colour

    class Drawn:
        def __init__(self, *shapes: Shape) -> None:
            self.shapes = shapes

    disc = Shape(*COLORS[0], 1.0)
    drawing: Any = Drawn()
    drawing.bodies = [
        Drawn(disc, Shape(0.1, 0.2, 0.3, 1.0)),
        Drawn(Shape(*COLORS[0], 0.5)),
        Drawn(),
    ]
    assert _disc_of(drawing) == {"body": 0, "shape": 0}
    drawing.bodies.append(Drawn(Shape(0.0, 0.0, 0.0, 1.0), disc))
    assert _disc_of(drawing) == {"body": 3, "shape": 1}
