"""Choices that a model of a plan makes: where its origin is, which wheels roll, how far its motors
turn, and what shares a name."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from brickhub.robot import Motor
from bricktwin.plans.mechanism.articulation import Drive, Geared
from bricktwin.plans.mechanism.kinematics import Hinge, Wheel
from bricktwin.plans.mechanism.open_gears import Coupling
from bricktwin.twin.models import planned_model
from bricktwin.twin.models.planned_model import _Builder, _is_around

ORIGIN = np.zeros(3)


def hinge(parent: int, child: int) -> Hinge:
    return Hinge(parent, child, ORIGIN, np.array([0.0, 1.0, 0.0]), None, closes_loop=False)


def drive(port: str, child: int, gear: float = 1.0, teeth: tuple[int, ...] = ()) -> Drive:
    return Drive(port, hinge(0, child), gear, 0.0, teeth)


def wheel(part: int, place_mm: Any, diameter_mm: float, link: int = 0) -> Wheel:
    return Wheel(link, np.array(place_mm, float) / 1000, diameter_mm, part)


def builder(**values: Any) -> Any:
    """A builder that has built nothing."""
    made: Any = _Builder.__new__(_Builder)
    parts: dict[str, Any] = {
        "is_fixed": False,
        "rods": (),
        "loops": (),
        "wheels": (),
        "drives": (),
        "geared": (),
        "swings": (),
        "couplings": (),
    }
    made.articulation = SimpleNamespace(
        **{**parts, **{name: values[name] for name in parts.keys() & values.keys()}}
    )
    made.planned = SimpleNamespace(
        rolling=values.get("rolling", ()),
        device=lambda port: SimpleNamespace(angle_deg=values.get("angle_deg", 0.0)),
    )
    made.hub_m = np.array([0.01, 0.02, 0.05])
    made.casters = values.get("casters", [])
    return made


@pytest.mark.parametrize(
    ("values", "origin_mm"),
    [
        # On the axle of the driven wheels, below the hub's middle from side to side.
        (
            {"rolling": ((None, wheel(0, (4, 65, 28), 56)), (None, wheel(1, (4, -60, 28), 56)))},
            (4, 20, 28),
        ),
        (
            {"rolling": ((None, wheel(0, (-30, 65, 20), 40)), (None, wheel(1, (50, 65, 36), 72)))},
            (10, 20, 28),
        ),
        # Without wheels, below the hub.
        ({}, (10, 20, 0)),
        # That of the plan, if it stands on the table.
        ({"is_fixed": True, "rolling": ((None, wheel(0, (4, 65, 28), 56)),)}, (0, 0, 0)),
    ],
)
def test_the_origin_is_on_the_axle_or_below_the_hub(values: Any, origin_mm: Any) -> None:
    assert 1000 * builder(**values)._origin() == pytest.approx(origin_mm)


def test_a_rim_in_a_tyre_does_not_roll_itself() -> None:
    tyre = wheel(0, (0, 50, 28), 56, link=2)
    for place_mm, link, is_around in (
        ((0, 50, 28), 2, True),
        # A module away, at most.
        ((0, 58, 28), 2, True),
        ((0, 58.1, 28), 2, False),
        # On another body, it is another wheel.
        ((0, 50, 28), 3, False),
    ):
        assert _is_around(tyre, wheel(1, place_mm, 30, link)) is is_around
    rim = wheel(1, (0, 52, 28), 30, link=2)
    other = wheel(2, (0, -50, 28), 56, link=3)
    caster = wheel(3, (-50, 0, 9), 19, link=0)
    made = builder(wheels=(rim, tyre, caster, other), casters=[(caster, ORIGIN, 0.0095)])
    assert made._tyres() == [tyre, other]


def test_bodies_are_named_after_the_motor_that_moves_them() -> None:
    made = builder(
        drives=(drive("A", 1), drive("B", 2)),
        geared=(Geared("B", hinge(0, 3), 1.0),),
        swings=(hinge(4, 5), hinge(1, 4), hinge(3, 6), hinge(0, 7)),
    )
    assert made._ports() == {1: "A", 2: "B", 3: "B", 4: "A", 5: "A", 6: "B"}


def test_masses_of_bodies_count_all_that_hangs_on_them() -> None:
    made = builder()
    masses = (0.3, 0.02, 0.03, 0.05)
    made.articulation.bodies = [SimpleNamespace(mass_kg=mass) for mass in masses]
    made.articulation.joints = [hinge(0, 1), hinge(1, 2), hinge(0, 3)]
    assert made._subtree_kg() == pytest.approx({0: 0.4, 1: 0.05, 2: 0.03, 3: 0.05})


def test_motors_on_one_train_share_its_friction() -> None:
    coupled = (Coupling(((1, 1.0), (2, 0.5), (4, 1.0))),)
    drives = (drive("A", 1), drive("B", 2), drive("C", 3))
    made = builder(drives=drives, couplings=coupled)
    alone = builder(drives=drives[:1], couplings=coupled)
    whole_nm = alone._train_friction_nm(drives[0])
    assert whole_nm > 0.0
    shared = [made._train_friction_nm(one) for one in drives]
    # Two motors are on the open gears; the third turns what is on its shaft.
    assert shared == pytest.approx([whole_nm / 2, whole_nm / 2, 0.0])
    # A joint behind gears feels it by their ratio, whichever way it turns.
    for gear in (3.0, -3.0):
        geared = drive("A", 1, gear, (12, 36))
        assert builder()._train_friction_nm(geared) == pytest.approx(3 * whole_nm)


@pytest.mark.parametrize(
    ("motor", "values", "start_deg"),
    [
        (Motor("arm", "A"), {}, 25.0),
        (Motor("arm", "A", range_deg=(-10, 70)), {}, 30.0),
        (Motor("arm", "A", range_deg=(-10, 70), gears=(12, 36)), {}, 90.0),
        # A linkage is closed as it is drawn.
        (Motor("arm", "A", range_deg=(-10, 70)), {"rods": ("rod",)}, 25.0),
        (Motor("arm", "A", range_deg=(-10, 70)), {"loops": ("loop",)}, 25.0),
    ],
)
def test_a_motor_starts_in_the_middle_of_its_range_or_as_it_is_drawn(
    motor: Motor, values: Any, start_deg: float
) -> None:
    assert builder(angle_deg=25.0, **values)._start_deg(motor) == pytest.approx(start_deg)


def limited(
    monkeypatch: pytest.MonkeyPatch,
    motor: Motor,
    gear: float = 1.0,
    *,
    free: tuple[float, float] = (-1000.0, 1000.0),
    stops: tuple[float, float] | None = None,
) -> tuple[Any, list[tuple[float, float]]]:
    """The shaft of a motor whose parts are free between two angles, and what was searched."""
    searched: list[tuple[float, float]] = []

    def free_deg(planned: Any, port: str, low: float, high: float) -> tuple[float, float]:
        searched.append((low, high))
        return free

    monkeypatch.setattr(planned_model, "free_deg", free_deg)
    monkeypatch.setattr(planned_model, "stops_deg", lambda planned, port: stops)
    shaft = SimpleNamespace(limited=False, range=None)
    builder()._limit(shaft, motor, gear)
    return shaft, searched


def degrees(shaft: Any) -> list[float]:
    return [math.degrees(angle) for angle in shaft.range]


RANGED = Motor("arm", "A", range_deg=(10, 70))


@pytest.mark.parametrize(
    ("free", "gear", "ends_deg"),
    [
        # Nothing is in the way up to 15 degrees beyond the range.
        ((-1000.0, 1000.0), 1.0, (-5.0, 85.0)),
        ((0.0, 75.0), 1.0, (0.0, 75.0)),
        ((20.0, 60.0), 1.0, (20.0, 60.0)),
        # At the joint, behind gears; a negative one swaps the ends.
        ((-1000.0, 1000.0), 5.0, (-1.0, 17.0)),
        ((0.0, 75.0), -3.0, (-25.0, 0.0)),
    ],
)
def test_end_stops_are_where_parts_meet_but_hardly_beyond_the_range(
    monkeypatch: pytest.MonkeyPatch,
    free: tuple[float, float],
    gear: float,
    ends_deg: tuple[float, float],
) -> None:
    shaft, searched = limited(monkeypatch, RANGED, gear, free=free)
    assert shaft.limited and degrees(shaft) == pytest.approx(ends_deg)
    assert searched == [(-5.0, 85.0)]


def test_a_motor_without_a_range_has_the_stops_of_its_parts_or_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shaft, searched = limited(monkeypatch, Motor("arm", "A"), 2.0, stops=(-90.0, 30.0))
    assert shaft.limited and degrees(shaft) == pytest.approx((-45.0, 15.0)) and searched == []
    shaft, searched = limited(monkeypatch, Motor("arm", "A"))
    assert not shaft.limited and shaft.range is None and searched == []


def test_stops_that_are_given_are_not_searched_for(monkeypatch: pytest.MonkeyPatch) -> None:
    motor = Motor("arm", "A", end_stops_deg=(-30, 30))
    shaft, searched = limited(monkeypatch, motor, stops=(-90.0, 30.0))
    assert not shaft.limited and searched == []


def test_shapes_of_one_name_are_numbered() -> None:
    taken = {"tyre_A", "tyre_A_2", "foot_B"}
    made: Any = _Builder.__new__(_Builder)
    made.spec = SimpleNamespace(geom=lambda name: name if name in taken else None)
    assert made._free_name("tyre_A") == "tyre_A_3"
    assert made._free_name("foot_B") == "foot_B_2" and made._free_name("foot_C") == "foot_C"


def test_places_are_in_the_frame_of_their_body() -> None:
    made: Any = _Builder.__new__(_Builder)
    made.origins = {0: ORIGIN, 2: np.array([0.1, 0.2, 0.3])}
    assert made._local(2, np.array([0.5, 0.5, 0.5])) == pytest.approx((0.4, 0.3, 0.2))
    assert made._local(0, np.array([0.5, 0.5, 0.5])) == pytest.approx((0.5, 0.5, 0.5))


def test_only_motors_without_gears_show_their_shafts_on_what_they_drive() -> None:
    drives = (drive("A", 1), drive("B", 1, -3.0, (12, 36)), drive("C", 2))
    made = builder(drives=drives)
    numbers = {"A": 7, "B": 8, "C": 9}
    made.planned.device = lambda port: SimpleNamespace(index=numbers[port])
    assert made._shafts_of(1) == (7,) and made._shafts_of(2) == (9,) and made._shafts_of(0) == ()
