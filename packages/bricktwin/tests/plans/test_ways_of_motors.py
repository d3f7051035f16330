"""Ways of motors: how far each turns until what it drives meets something, and who turns with
whom."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bricktwin.plans import planned_robot as module
from bricktwin.plans.mechanism.articulation import Articulation, Drive, Rod
from bricktwin.plans.mechanism.kinematics import Hinge, Wheel
from bricktwin.plans.mechanism.open_gears import Coupling
from bricktwin.plans.planned_robot import _geared_together, _Sweep, carried_by, free_deg, stops_deg

ORIGIN = np.zeros(3)


def hinge(parent: int, child: int) -> Hinge:
    return Hinge(parent, child, ORIGIN, np.array([0.0, 1.0, 0.0]), None, closes_loop=False)


def sweep(low_deg: float, high_deg: float, asked: list[float] | None = None) -> _Sweep:
    """A sweep whose part is clear between two angles."""
    made = _Sweep.__new__(_Sweep)

    def is_clear(angle_deg: float) -> bool:
        if asked is not None:
            asked.append(angle_deg)
        return low_deg <= angle_deg <= high_deg

    made._is_clear = is_clear  # type: ignore[method-assign]
    made._is_clear_at_start = is_clear(0.0)
    return made


@pytest.mark.parametrize(
    ("travel_deg", "reached_deg"),
    [
        # All of it, exactly, also where it is no multiple of a step.
        (40.0, 40.0),
        (43.7, 43.7),
        (-20.0, -20.0),
        (0.0, 0.0),
    ],
)
def test_a_free_travel_is_reached_to_its_end(travel_deg: float, reached_deg: float) -> None:
    assert sweep(-90.0, 90.0).reach(travel_deg) == reached_deg


@pytest.mark.parametrize("end_deg", [0.2, 4.9, 5.0, 7.3, 31.0, 62.6])
def test_a_travel_ends_half_a_degree_before_what_is_in_the_way(end_deg: float) -> None:
    for sign in (1.0, -1.0):
        found = sweep(-end_deg, end_deg).reach(sign * 300.0)
        # Never beyond it, and no more than half a degree before.
        assert 0.0 <= sign * found <= end_deg < sign * found + 0.51
    # It looks every five degrees, and then between the last two.
    asked: list[float] = []
    sweep(-90.0, 12.0, asked).reach(40.0)
    assert asked[:4] == [0.0, 5.0, 10.0, 15.0]
    assert all(10.0 < angle < 15.0 for angle in asked[4:]) and len(asked) == 4 + 4


def test_what_meets_something_as_it_is_drawn_goes_nowhere() -> None:
    assert sweep(5.0, 90.0).reach(60.0) == 0.0


def robot(gear: float = 1.0, start_deg: float = 0.0, **values: Any) -> Any:
    """A robot whose motor A turns the body 1."""
    drive = Drive("A", hinge(0, 1), gear, 0.0, ())
    made = Articulation(
        bodies=(),
        is_fixed=True,
        drives=(Drive("B", hinge(0, 2), 1.0, 0.0, ()), drive),
        geared=(),
        swings=(),
        loops=(),
        followers=(),
        rods=(),
        wheels=(),
    )
    return SimpleNamespace(
        articulation=replace(made, **values),
        device=lambda port: SimpleNamespace(angle_deg=start_deg),
    )


class Free:
    """Sweeps whose part is clear between two angles of the driven part."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.low_deg, self.high_deg = -90.0, 90.0
        self.ports: list[str] = []
        monkeypatch.setattr(module, "_Sweep", self._made)
        # Nothing is kept of robots that are played.
        monkeypatch.setattr(module, "free_deg", free_deg.__wrapped__)

    def _made(self, planned: Any, drive: Drive) -> _Sweep:
        self.ports.append(drive.port)
        return sweep(self.low_deg, self.high_deg)

    def range_deg(self, planned: Any, low: float, high: float) -> tuple[float, float]:
        return free_deg.__wrapped__(planned, "A", low, high)

    def stops_deg(self, planned: Any) -> tuple[float, float] | None:
        return stops_deg.__wrapped__(planned, "A")


@pytest.fixture
def free(monkeypatch: pytest.MonkeyPatch) -> Free:
    return Free(monkeypatch)


@pytest.mark.parametrize(
    ("gear", "start_deg", "asked", "expected"),
    [
        # The driven part is free from -30 to 40 degrees.
        (1.0, 0.0, (-20.0, 20.0), (-20.0, 20.0)),
        (1.0, 0.0, (-90.0, 90.0), (-30.0, 40.0)),
        # The motor stands at 100 degrees in the plan.
        (1.0, 100.0, (0.0, 200.0), (70.0, 140.0)),
        # Three turns of the motor for one of the part.
        (3.0, 0.0, (-200.0, 200.0), (-90.0, 120.0)),
        # In the opposite direction the ends change places.
        (-2.0, 10.0, (-200.0, 200.0), (-70.0, 70.0)),
        # A range that lies beside the plan's angle is none, but for that.
        (1.0, 0.0, (10.0, 20.0), (0.0, 20.0)),
        (1.0, 0.0, (-20.0, -10.0), (-20.0, 0.0)),
    ],
)
def test_the_range_of_a_motor_is_that_of_its_part_by_its_gear(
    free: Free,
    gear: float,
    start_deg: float,
    asked: tuple[float, float],
    expected: tuple[float, float],
) -> None:
    free.low_deg, free.high_deg = -30.0, 40.0
    found = free.range_deg(robot(gear, start_deg), *asked)
    assert found == pytest.approx(expected, abs=0.5 * abs(gear) + 0.01)
    assert free.ports == ["A"]


@pytest.mark.parametrize(
    ("low_deg", "high_deg", "has_stops"),
    [
        (-60.0, 100.0, True),
        (-359.0, 300.0, True),
        # Who gets all around in one direction has no stops.
        (-400.0, 100.0, False),
        (-100.0, 400.0, False),
        (-400.0, 400.0, False),
        # Less than five degrees are no way at all: the drawing has too little room.
        (-2.0, 2.0, False),
        (-4.0, 4.0, True),
    ],
)
@pytest.mark.parametrize("gear", [1.0, -3.0])
def test_stops_are_where_a_part_meets_something_on_both_sides(
    free: Free, gear: float, low_deg: float, high_deg: float, has_stops: bool
) -> None:
    free.low_deg, free.high_deg = low_deg, high_deg
    found = free.stops_deg(robot(gear, 50.0))
    assert (found is not None) is has_stops
    if found is not None:
        ends = sorted(50.0 + gear * end for end in (low_deg, high_deg))
        assert found == pytest.approx(tuple(ends), abs=0.51 * abs(gear))


@pytest.mark.parametrize(
    "values",
    [
        {"rods": (Rod(0, ORIGIN, 1, ORIGIN, ()),)},
        {"loops": (hinge(0, 1),)},
        {"wheels": (Wheel(1, ORIGIN, 56.0, 1),)},
        {"wheels": (Wheel(3, ORIGIN, 56.0, 1),), "swings": (hinge(1, 3),)},
        {"couplings": (Coupling(((1, 1.0), (2, 0.5))),)},
    ],
)
def test_wheels_and_linkages_have_no_stops(free: Free, values: dict[str, Any]) -> None:
    assert free.stops_deg(robot(**values)) is None
    assert free.ports == []


def test_a_wheel_elsewhere_is_no_reason(free: Free) -> None:
    elsewhere = robot(wheels=(Wheel(2, ORIGIN, 56.0, 1),), swings=(hinge(2, 3),))
    assert free.stops_deg(elsewhere) == pytest.approx((-90.0, 90.0), abs=0.51)


def test_a_motor_carries_all_that_hangs_on_its_body() -> None:
    made = robot(swings=(hinge(1, 3), hinge(3, 4), hinge(2, 5), hinge(0, 6))).articulation
    second, first = made.drives
    assert carried_by(made, first) == {1, 3, 4} and carried_by(made, second) == {2, 5}


def bodies_with(*rates: Any) -> tuple[Any, Any]:
    """A plan of so many motors, and bodies whose joints turn at these rates in each motion."""
    plan = SimpleNamespace(
        parts=[SimpleNamespace(port="ABC"[number]) for number in range(len(rates))]
    )
    joints = [
        SimpleNamespace(motor=number, rates=lambda motions, own=rate: np.array(own, float))
        for number, rate in enumerate(rates)
    ]
    hanging = SimpleNamespace(motor=None, rates=lambda motions: np.array([1.0, 0.0]))
    bodies = SimpleNamespace(motions=lambda: None, joints=[hanging, *joints])
    return plan, bodies


@pytest.mark.parametrize(
    ("rates", "pairs"),
    [
        (((1, 0), (0, 1)), []),
        (((1, 2), (2, 4)), [("A", "B")]),
        (((1, 2), (-3, -6)), [("A", "B")]),
        # Nearly so, as drawings are.
        (((1, 2), (2, 4.1)), [("A", "B")]),
        (((1, 2), (2, 4.5)), []),
        # What cannot turn, turns with nobody.
        (((1, 2), (0.0005, 0.0001)), []),
        (((0, 0), (0, 0)), []),
        (((1, 0), (2, 0), (0, 1)), [("A", "B")]),
        (((1, 1), (2, 2), (3, 3)), [("A", "B"), ("A", "C"), ("B", "C")]),
    ],
)
def test_motors_that_always_turn_at_one_ratio_are_geared_together(
    rates: Any, pairs: list[tuple[str, str]]
) -> None:
    assert list(_geared_together(*bodies_with(*rates))) == pairs
