"""Part catalogue: numbers, sites, sizes, masses."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from plan_lines import solid_volume

from brickhub.errors import UnknownNameError
from brickhub.tables import read_table
from bricktwin.plans import catalogue
from bricktwin.plans.catalogue import part_notation
from bricktwin.plans.part import DeviceKind, Fit, Part

PARTS = catalogue.parts()


def test_at_least_250_kinds_each_number_once():
    numbers = [number for part in PARTS for number in (part.number, *part.aliases)]
    assert len(PARTS) >= 250
    assert [number for number, count in Counter(numbers).items() if count > 1] == []


@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.number)
def test_parts_have_mass_size_and_samples(part: Part):
    low, high = part.bounds
    assert 0.05 < part.mass_g < 300
    assert ((high - low) > 0).all() and ((high - low) < 700).all()
    assert len(part.samples)
    assert part.contains(part.samples, 0.5).all()
    for site in part.sites:
        assert np.linalg.norm(site.axis) == pytest.approx(1)
        if site.fit in (Fit.HOLE, Fit.AXLE_HOLE):
            assert not part.contains(np.array([site.centre]), 0.0).any()


STEEL = ("92911c01", "99948")


def test_mass_is_below_solid_plastic():
    for part in PARTS:
        if part.device is None:
            g_per_mm3 = 7.85e-3 if part.number in STEEL else 1.05e-3
            full_g = solid_volume(part) * 0.4**3 * g_per_mm3
            assert part.mass_g < 1.35 * full_g, part.number


def test_block_mass_is_close_to_ldraw_volume():
    """Volumes of the shapes times 1.05 g/cm³."""
    for number, mass_g in {
        "3005": 0.482,
        "3004": 0.904,
        "3008": 3.440,
        "3001": 2.644,
        "3023b": 0.401,
        "3020": 1.410,
        "3036": 7.981,
    }.items():
        assert catalogue.get(number).mass_g == pytest.approx(mass_g, abs=0.06), number


def test_beams_have_holes_a_module_apart():
    for holes, number in ((3, "32523"), (15, "32278")):
        beam = catalogue.get(number)
        places = np.array([site.centre for site in beam.sites])
        assert len(places) == holes
        assert np.allclose(np.diff(places, axis=0), [0, 0, 20])
        assert np.allclose(beam.bounds[1], [9, 10, 10 * holes - 1])


def test_the_wheel_has_the_diameter_of_the_two_wheeler():
    low, high = catalogue.get("39367p02").bounds
    assert (high - low)[0] * 0.4 == pytest.approx(56)


def test_motors_turn_an_axle_hole():
    for part in PARTS:
        if part.device is not None and part.device.kind is DeviceKind.MOTOR:
            assert any(site.turns and site.fit is Fit.AXLE_HOLE for site in part.sites), part.number
        else:
            assert not any(site.turns for site in part.sites), part.number


def test_parts_are_found_by_number_suffix_or_alias():
    assert catalogue.get("2780.dat") is catalogue.get("2780") is catalogue.get("61332")


def test_unknown_part_number_raises():
    with pytest.raises(
        UnknownNameError, match=r"^part '99999' is not in the catalogue; .*`bricktwin plan parts`"
    ):
        catalogue.get("99999")


def test_notation_of_points_ranges_and_sets():
    assert part_notation.points("0,0,-20 ±40,0..20,1") == [
        (0, 0, -20),
        (-40, 0, 1),
        (-40, 20, 1),
        (40, 0, 1),
        (40, 20, 1),
    ]
    assert [z for _, _, z in part_notation.points("0,0,40..0 0,0,-80..80/80 0,0,5;±10")] == [
        40,
        20,
        0,
        -80,
        0,
        80,
        5,
        -10,
        10,
    ]


def test_chains_of_a_beam_share_a_hole_and_skip_none():
    holes, solids = part_notation.beam("chain y20 o-+: -20..20,0,0 | chain y20 +o: 20,0,0..20")
    assert [(hole.fit, hole.centre) for hole in holes] == [
        (Fit.HOLE, (-20, 0, 0)),
        (Fit.AXLE_HOLE, (20, 0, 0)),
        (Fit.HOLE, (20, 0, 20)),
    ]
    assert len(solids) == 3 + 3


def test_every_device_is_a_row_of_the_parts():
    rows = {
        row["number"]: row["family"] for row in read_table("bricktwin.plans.catalogue", "parts")
    }
    assert all(
        rows[row["number"]] == f"{row['kind']}s"
        for row in read_table("bricktwin.plans.catalogue", "devices")
    )
