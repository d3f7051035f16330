"""Plan view without a browser."""

from __future__ import annotations

import json
import urllib.request
from pathlib import Path

import numpy as np
import pytest

from bricksrl.errors import PlanError
from bricksrl.page.plan_view import PlanView
from bricksrl.page.server import PageOptions
from bricktwin.plans import ldraw_file
from bricktwin.plans.plan import make_plan, read_plan
from bricktwin.robots import plans

PLANS = Path(plans.__path__[0])


def view(name: str) -> PlanView:
    """One of our robots."""
    return PlanView(read_plan(PLANS / f"{name}.ldr"))


def places(shown: PlanView) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    """Poses [parts, 7]; nan where a part is hidden."""
    poses = shown.board.poses[1]
    assert isinstance(poses, np.ndarray)
    return poses


def test_steps_show_their_parts() -> None:
    shown = view("two_wheeler")
    assert np.isfinite(places(shown)).all()
    shown.press("slider", ["Step", 1])
    assert np.isfinite(places(shown)[:, 0]).sum() == 5
    shown.press("step", None)
    assert np.isfinite(places(shown)[:, 0]).sum() == 7
    facts = shown.board.status[1]
    assert facts["facts"]["step"] == "2 of 11"
    assert facts["note"].startswith("The motors hang below it")
    shown.press("reset", None)
    assert np.isfinite(places(shown)).all()


def test_slider_turns_one_leg() -> None:
    shown = view("walker")
    before = places(shown).copy()
    name = next(one["name"] for one in shown.board.status[1]["sliders"] if "port C" in one["name"])
    shown.press("slider", [name, 90])
    moved = np.linalg.norm(places(shown)[:, :3] - before[:, :3], axis=1) > 1e-4
    # The crank's beam and pin, the rocker with its pins, and the five parts of the leg.
    assert 8 <= moved.sum() <= 12
    shown.press("slider", [name, 0])
    assert np.allclose(places(shown), before, atol=2e-4)


def test_parts_that_touch_stay_together_when_a_leg_turns() -> None:
    shown = view("walker")
    before = places(shown)[:, :3].copy()
    apart_m = np.linalg.norm(before[:, None] - before, axis=-1)
    touching = np.argwhere(np.triu(apart_m < 0.009, 1))
    assert len(touching) > 10
    name = next(one["name"] for one in shown.board.status[1]["sliders"] if "port C" in one["name"])
    for angle_deg in (90, -60):
        shown.press("slider", [name, angle_deg])
        after = places(shown)[:, :3]
        now_m = np.linalg.norm(after[touching[:, 0]] - after[touching[:, 1]], axis=1)
        assert now_m.max() < 0.02
        assert np.abs(after - before).max() > 0.01


def test_sliders_are_held_within_their_ends_and_steps_begin_again() -> None:
    shown = view("two_wheeler")

    def sliders() -> dict[str, dict[str, object]]:
        return {one["name"]: one for one in shown.board.status[1]["sliders"]}

    def facts() -> dict[str, object]:
        return shown.board.status[1]["facts"]

    last = sliders()["Step"]
    assert (last["low"], last["high"], last["value"], last["text"]) == (1, 11, 11, "11")
    whole = facts()["parts"]
    assert whole == len(places(shown))
    for number, value in ((0, 1), (3.4, 3), (99, 11)):
        shown.press("slider", ["Step", number])
        assert sliders()["Step"]["value"] == value
        assert facts()["parts"] == np.isfinite(places(shown)[:, 0]).sum()
    shown.press("step", None)
    assert sliders()["Step"]["value"] == 1 and facts()["step"] == "1 of 11"
    motor = next(name for name in sliders() if "port" in name)
    most = sliders()[motor]["high"]
    assert isinstance(most, float | int) and sliders()[motor]["low"] == -most
    for degrees, value in ((30, 30), (1e9, most), (-1e9, -most)):
        shown.press("slider", [motor, degrees])
        assert sliders()[motor]["value"] == value
    shown.press("reset", None)
    assert sliders()[motor]["value"] == 0 and sliders()["Step"]["value"] == 11


@pytest.mark.parametrize(
    "press",
    [
        ("slider", None),
        ("slider", ["Step"]),
        ("slider", ["Step", "x"]),
        ("slider", ["Step", float("nan")]),
        ("slider", ["Step", 10**400]),
        ("slider", [["Step"], 1]),
        ("x", 1),
    ],
)
def test_invalid_press_is_ignored(press: tuple[str, object]) -> None:
    shown = view("two_wheeler")
    before = places(shown).copy()
    shown.press(*press)
    assert np.array_equal(places(shown), before)


def test_incomplete_plan_shows_steps() -> None:
    lines = [
        "1 15 0 0 0 1 0 0 0 1 0 0 0 1 54696p02.dat",
        "0 STEP",
        "1 4 0 60 0 1 0 0 0 1 0 0 0 1 32316.dat",
    ]
    shown = PlanView(make_plan(ldraw_file.parse("\n".join(lines), "try.ldr")))
    assert "has no port" in shown.board.status[1]["message"]
    assert [one["name"] for one in shown.board.status[1]["sliders"]] == ["Step"]


def test_plan_without_parts_raises() -> None:
    with pytest.raises(PlanError, match="no part that the catalogue knows"):
        PlanView(make_plan(ldraw_file.parse("1 4 0 0 0 1 0 0 0 1 0 0 0 1 99999.dat", "try.ldr")))


@pytest.mark.realtime
def test_the_page_serves_its_drawing() -> None:
    with PlanView(read_plan(PLANS / "two_wheeler.ldr"), PageOptions(page_port=0)) as shown:
        address = shown.url.replace("/?", "/drawing.json?")
        with urllib.request.urlopen(address, timeout=20) as answer:
            drawing = json.loads(answer.read())
    assert len(drawing["bodies"]) == 36
    assert len(drawing["meshes"]) < 36
