"""Notation of the catalogue: points, sites, beams, solids, gears."""

from __future__ import annotations

import math

import pytest

from bricktwin.plans.catalogue.part_notation import beam, gears, point, points, sites, solids
from bricktwin.plans.geometry import Form
from bricktwin.plans.part import Fit, GearForm

ROOT_HALF = math.sqrt(0.5)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("1,2,-3", [(1, 2, -3)]),
        ("0,0,±20", [(0, 0, -20), (0, 0, 20)]),
        ("0..40,0,0", [(0, 0, 0), (20, 0, 0), (40, 0, 0)]),
        ("40..0,0,0", [(40, 0, 0), (20, 0, 0), (0, 0, 0)]),
        ("0..80/40,0,1", [(0, 0, 1), (40, 0, 1), (80, 0, 1)]),
        ("0;5,0,±1", [(0, 0, -1), (0, 0, 1), (5, 0, -1), (5, 0, 1)]),
        ("1,0,0 2,0,0", [(1, 0, 0), (2, 0, 0)]),
        ("", []),
    ],
)
def test_points(text: str, found: list[tuple[float, float, float]]) -> None:
    assert points(text) == found


def test_sites_have_a_kind_an_axis_and_centres() -> None:
    found = sites("o y20: 0,0,±20 | + x40: 10,0,0", turns=True)
    assert [(site.fit, site.centre, site.axis, site.length) for site in found] == [
        (Fit.HOLE, (0, 0, -20), (0, 1, 0), 20),
        (Fit.HOLE, (0, 0, 20), (0, 1, 0), 20),
        (Fit.AXLE_HOLE, (10, 0, 0), (1, 0, 0), 40),
    ]
    assert all(site.turns for site in found)
    assert not any(site.turns for site in sites("o y20: 0,0,0"))


@pytest.mark.parametrize(
    ("tilt", "centre", "axis"),
    [
        ("", (5, 10, 0), (0, 0, 1)),
        (" tilted 0", (5, 10, 0), (0, 0, 1)),
        (" tilted 90", (5, 0, 10), (0, -1, 0)),
        (" tilted -90", (5, 0, -10), (0, 1, 0)),
        (" tilted 45", (5, 10 * ROOT_HALF, 10 * ROOT_HALF), (0, -ROOT_HALF, ROOT_HALF)),
        (" turned 90", (-10, 5, 0), (0, 0, 1)),
    ],
)
def test_tilted_group_turns_about_x_and_a_turned_one_about_z(
    tilt: str, centre: tuple[float, float, float], axis: tuple[float, float, float]
) -> None:
    (site,) = sites(f"o z20{tilt}: 5,10,0")
    assert site.centre == pytest.approx(centre, abs=1e-9)
    assert site.axis == pytest.approx(axis, abs=1e-9)


def test_beam_has_holes_where_it_says_and_bars_between_them() -> None:
    holes, found = beam("chain y20 o-+: 0,0,0..40")
    assert [(hole.fit, hole.centre) for hole in holes] == [
        (Fit.HOLE, (0, 0, 0)),
        (Fit.AXLE_HOLE, (0, 0, 40)),
    ]
    assert [hole.arm for hole in holes] == [(0, 0, -1), (0, 0, 1)], "along the beam"
    forms = [solid.form for solid in found]
    assert forms.count(Form.BOX) == 2 and forms.count(Form.CYLINDER) == 2


def test_chains_that_meet_share_a_hole() -> None:
    holes, _ = beam("chain y20 oo: 0,0,0 20,0,0 | chain y20 oo: 20,0,0 20,0,20")
    assert [hole.centre for hole in holes] == [(0, 0, 0), (20, 0, 0), (20, 0, 20)]
    assert holes[1].arm == (1, 0, 0), "the first decides"


def test_solids_and_notches() -> None:
    found, notches = solids(
        "box 0,0,±60 80,20,20 | notch ball 0,0,0 24 | cylinder z20 0,0,0 9.5 "
        "| ring y15 0,0,0 74.5 68"
    )
    assert [solid.form for solid in found[:3]] == [Form.BOX, Form.BOX, Form.CYLINDER]
    assert len(found) == 4
    assert [(before, solid.form) for before, solid in notches] == [(2, Form.BALL)]
    around = sites("o y20: 0,0,0 | pin z20: 0,0,0 | stud y4: 0,0,0")
    (hole, pin), _ = solids("tubes", around)
    assert (hole.form, pin.form) == (Form.CYLINDER, Form.CYLINDER)
    assert hole.half[0] > pin.half[0], "a tube is wider than a pin"


def test_gears() -> None:
    spur, bevel = gears("spur 24 y10 0,0,0 | bevel 12 z10 0,0,2 set_back=3 up=0,1,0")
    assert (spur.form, spur.teeth, spur.width, spur.set_back) == (GearForm.SPUR, 24, 10, 5)
    assert (bevel.form, bevel.teeth, bevel.centre) == (GearForm.BEVEL, 12, (0, 0, 2))
    assert (bevel.axis, bevel.set_back, bevel.up) == ((0, 0, 1), 3, (0, 1, 0))
    assert point("3,4,5") == (3, 4, 5)
