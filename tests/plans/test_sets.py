"""Sets with the electronics of a plan."""

from __future__ import annotations

import pytest
from plan_lines import BEAM, PLANS, plan_of

from bricksrl.plans import catalogue
from bricksrl.plans.plan import read_plan
from bricksrl.plans.sets import SETS, SINGLY, purchases

HUB = "1 15 0 0 0 1 0 0 0 1 0 0 0 1 67718.dat"
LARGE = "1 15 0 0 900 1 0 0 0 1 0 0 0 1 54675.dat"


@pytest.mark.parametrize(
    ("robot", "spike"),
    [
        ("two_wheeler", "45678 SPIKE Prime: all of its hub, motors and sensors"),
        ("walker", "45678 SPIKE Prime: add 2 x Medium angular motor (45603)"),
        ("robo_arm", "45678 SPIKE Prime: add 2 x Medium angular motor (45603)"),
    ],
)
def test_our_robots_need_one_set(robot, spike):
    lines = purchases(read_plan(PLANS / f"{robot}.ldr"))
    assert "51515 MINDSTORMS Robot Inventor: all of its hub, motors and sensors" in lines
    assert spike in lines
    assert lines[0].endswith("all of its hub, motors and sensors")


def test_expansion_set_with_missing_devices_is_listed():
    lines = purchases(plan_of(HUB, LARGE, LARGE.replace("900", "1800")))
    assert lines[0] == "45678 SPIKE Prime and 45681 SPIKE Prime expansion: all of its hub, motors and sensors"
    assert lines[1] == "45678 SPIKE Prime: add 1 x Large angular motor (45602)"


def test_plan_without_hub_lists_no_set():
    assert purchases(plan_of(BEAM, LARGE)) == []


def test_set_devices_are_in_catalogue():
    known = {part.device.name for part in catalogue.parts() if part.device is not None} | {"essential"}
    assert {name for one in SETS for name in one.devices} <= known
    assert set(SINGLY) <= known
