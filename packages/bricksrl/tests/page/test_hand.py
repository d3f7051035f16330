"""A hand that pulls robots and objects."""

from __future__ import annotations

import time

import numpy as np
import pytest

from bricksrl.page.hand import Hand
from bricktwin.robots import TWO_WHEELER, WALKER
from bricktwin.twin.make_body import make_body
from bricktwin.twin.objects import Block
from bricktwin.twin.scene import OPEN_FLOOR, Scene
from bricktwin.view.mirror import Mirror

CUP = Scene(objects=(Block((300.0, 0.0), (60.0, 60.0, 80.0), mass_g=40.0, round=True),))


def pulled(robot, scene, name: str, to_m: tuple[float, float], value=None):
    """Positions of robot and object after a second in which one is pulled."""
    body, mirror, hand = (
        make_body(robot, scene=scene),
        Mirror(make_body(robot, scene=scene)),
        Hand(),
    )
    number = [one.name for one in mirror.drawing.bodies].index(name)
    for time_ms in range(5, 1000, 5):
        hand.pull([number, *to_m] if value is None else value)
        hand.act(body, mirror.numbers)
        body.advance_to(time_ms)
    hand.pull(None)
    hand.act(body, mirror.numbers)
    assert not body.data.xfrc_applied.any()
    return body.data.qpos[:2].copy(), body.data.qpos[-7:-5].copy()


@pytest.mark.parametrize("robot", [TWO_WHEELER, WALKER])
def test_robot_comes_to_the_hand(robot) -> None:
    there, _ = pulled(robot, OPEN_FLOOR, "chassis", (0.1, 0.2))
    here, _ = pulled(robot, OPEN_FLOOR, "chassis", (0.1, 0.2), [9999, 0.0, 0.0])
    assert np.linalg.norm(here) < 0.03 and np.linalg.norm(there - here) > 0.1


def test_object_comes_to_the_hand_and_the_robot_stays() -> None:
    robot, cup = pulled(TWO_WHEELER, CUP, "object_0", (0.3, 0.25))
    assert np.linalg.norm(robot) < 0.01 and np.linalg.norm(cup - (0.3, 0.25)) < 0.03


@pytest.mark.parametrize(
    "value", [None, 1, "x", [], [1, 2], [1.5, 0, 0], [0, "a", 0], [0, float("nan"), 0], [-1, 0, 0]]
)
def test_other_values_pull_nothing(value) -> None:
    here, _ = pulled(TWO_WHEELER, OPEN_FLOOR, "chassis", (0.0, 0.0), value or [99, 0, 0])
    assert np.linalg.norm(here) < 0.01


def test_hand_of_a_closed_tab_lets_go(monkeypatch) -> None:
    body, mirror, hand = make_body(TWO_WHEELER), Mirror(make_body(TWO_WHEELER)), Hand()
    hand.pull([0, 1.0, 0.0])
    hand.act(body, mirror.numbers)
    assert body.data.xfrc_applied.any()
    later_s = time.monotonic() + 2.0
    monkeypatch.setattr(time, "monotonic", lambda: later_s)
    hand.act(body, mirror.numbers)
    assert not body.data.xfrc_applied.any()


def test_wall_keeps_its_grip_pushes_the_robot_and_is_put_back() -> None:
    scene = Scene(wall_distance_mm=(250.0, 250.0))
    body, mirror, hand = (
        make_body(TWO_WHEELER, scene=scene),
        Mirror(make_body(TWO_WHEELER, scene=scene)),
        Hand(),
    )
    number = [one.name for one in mirror.drawing.bodies].index("wall")
    body.reset(np.random.default_rng(0))
    robot_m, wall_m = body.data.qpos[:2].copy(), body.data.mocap_pos[0].copy()
    for time_ms in range(5, 1500, 5):
        hand.pull([number, 0.4 if time_ms == 5 else -0.1, 0.5])
        hand.act(body, mirror.numbers)
        body.advance_to(time_ms)
    moved_m = body.data.mocap_pos[0] - wall_m
    assert moved_m == pytest.approx([-0.5, 0.0, 0.0], abs=1e-6)
    assert body.data.qpos[0] < robot_m[0] - 0.1
    drawn = mirror.poses(body.data.qpos, None, body.data.mocap_pos)[number]
    assert drawn[:2] == pytest.approx(wall_m[:2] + moved_m[:2], abs=1e-6)
    body.reset(np.random.default_rng(0))
    assert (body.data.mocap_pos[0] == wall_m).all() and body.data.qpos[:2] == pytest.approx(
        robot_m, abs=1e-3
    )
