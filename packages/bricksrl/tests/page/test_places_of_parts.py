"""Where the parts of a plan are in the browser: in the twin's axes, and turned by its sliders."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bricksrl.page.plan_view import PlanView
from bricktwin.plans.catalogue import colour_of
from bricktwin.plans.drawing.looks import TINTS
from bricktwin.plans.plan import Plan, read_plan
from bricktwin.robots import plans

PLANS = Path(plans.__path__[0])


@pytest.fixture(scope="module")
def plan() -> Plan:
    return read_plan(PLANS / "two_wheeler.ldr")


@pytest.fixture
def shown(plan: Plan) -> PlanView:
    return PlanView(plan)


def poses(shown: PlanView) -> Any:
    """Places [parts, 3] in metres and quaternions [parts, 4]."""
    found = np.asarray(shown.board.poses[1], np.float64)
    return found[:, :3], found[:, 3:]


def test_parts_stand_where_the_plan_says_in_the_axes_of_the_twin(
    plan: Plan, shown: PlanView
) -> None:
    """LDraw's y is downwards, and its unit is 0.4 mm; the twin drives along x, and z is up."""
    places_m, _ = poses(shown)
    wanted = []
    for part in plan.parts:
        x, y, z = part.position.tolist()
        wanted.append((0.0004 * z, -0.0004 * x, -0.0004 * y))
    assert places_m == pytest.approx(np.array(wanted), abs=1e-6)
    assert wanted[0] == pytest.approx((0.008, 0.0, 0.016))


def turned_deg(before: Any, after: Any) -> Any:
    """Angle by which each part has been turned, 0..180 degrees."""
    cosines = np.abs((before * after).sum(-1)).clip(0.0, 1.0)
    return np.degrees(2.0 * np.arccos(cosines))


@pytest.mark.parametrize("angle_deg", [40, -90])
def test_slider_turns_the_wheel_on_its_motor_by_its_degrees(
    shown: PlanView, angle_deg: int
) -> None:
    sliders = shown.board.status[1]["sliders"]
    names = [one["name"] for one in sliders]
    assert names == ["Step", "right, port A, deg", "left, port E, deg"]
    places_m, before = poses(shown)
    shown.press("slider", ["left, port E, deg", angle_deg])
    moved_m, after = poses(shown)
    angles = turned_deg(before, after)
    is_turned = angles > 1.0
    assert angles[is_turned] == pytest.approx(abs(angle_deg), abs=0.1)
    assert 2 <= is_turned.sum() <= 6, "an axle with a wheel"
    assert angles[~is_turned] == pytest.approx(0.0, abs=0.1)
    # A wheel turns about its own axle, and goes nowhere.
    assert moved_m == pytest.approx(places_m, abs=1e-6)
    assert (places_m[is_turned][:, 1] > 0.0).all(), "on the left"
    said = {one["name"]: one for one in shown.board.status[1]["sliders"]}
    assert said["left, port E, deg"] == {
        "name": "left, port E, deg",
        "low": -360,
        "high": 360,
        "value": angle_deg,
    }
    assert said["right, port A, deg"]["value"] == 0


def test_turns_add_up_and_a_reset_takes_them_back(shown: PlanView) -> None:
    _, before = poses(shown)
    for label in ("left, port E, deg", "right, port A, deg"):
        shown.press("slider", [label, 90])
    _, both = poses(shown)
    assert (turned_deg(before, both) > 1.0).sum() >= 4
    shown.press("reset", None)
    _, after = poses(shown)
    assert turned_deg(before, after) == pytest.approx(0.0, abs=0.1)


def test_parts_are_drawn_on_the_floor_in_their_colours(plan: Plan, shown: PlanView) -> None:
    drawing = shown.board.drawing[1]
    assert drawing is not None
    assert [body.name for body in drawing.bodies] == [f"{number}" for number in range(36)]
    # Wheels of 56 mm stand on it, and the axle is at the origin.
    assert drawing.floor_m == pytest.approx(-0.028, abs=1e-6)
    tints = {(*tint, 1.0) for tint in TINTS.values()}
    plain = 0
    for part, body in zip(plan.parts, drawing.bodies, strict=True):
        main = (*colour_of(part.colour).rgb, 1.0)
        colours = {shape.colour for shape in body.shapes}
        assert colours and colours <= {main, *tints}
        plain += main in colours
    assert plain > 20, "most have a surface in the part's own colour"


def test_whole_robot_is_seen_from_its_left_front(plan: Plan, shown: PlanView) -> None:
    drawing = shown.board.drawing[1]
    assert drawing is not None
    corners = []
    for part in plan.parts:
        for corner in part.to_plan(np.asarray(part.part.bounds)):
            x, y, z = corner.tolist()
            corners.append((0.0004 * z, -0.0004 * x, -0.0004 * y))
    lowest, highest = np.min(corners, axis=0), np.max(corners, axis=0)
    assert drawing.view.target == pytest.approx(tuple((lowest + highest) / 2), abs=1e-6)
    assert drawing.view.distance_m == pytest.approx(1.8 * math.dist(lowest, highest), rel=1e-6)
    assert drawing.view.yaw_deg == 35.0


def test_title_and_step_of_a_plan_are_told(shown: PlanView) -> None:
    status = shown.board.status[1]
    assert (status["title"], status["subtitle"]) == ("2Wheeler", "building plan")
    assert (status["state"], status["controls"], status["message"]) == ("", ["step", "reset"], "")
    assert status["facts"] == {"step": "11 of 11", "parts": 36}
    assert status["sliders"][0] == {
        "name": "Step",
        "low": 1,
        "high": 11,
        "value": 11,
        "text": "11",
    }
    shown.press("slider", ["Step", 1])
    status = shown.board.status[1]
    assert status["facts"] == {"step": "1 of 11", "parts": 5}
    assert (status["sliders"][0]["value"], status["sliders"][0]["text"]) == (1, "1")
