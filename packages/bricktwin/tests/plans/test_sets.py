"""LEGO sets with the parts of a plan."""

from __future__ import annotations

import csv
from collections import Counter
from pathlib import Path

import pytest
from plan_lines import BEAM, PLANS, pin, plan_of

from brickhub.errors import PlanError
from bricktwin.plans.assemblies import components
from bricktwin.plans.booklet.parts_list import (
    as_text,
    needs,
    owned,
    parts_list,
    purchases,
    sets,
    still_needed,
)
from bricktwin.plans.plan import read_plan

HUB = "1 15 0 0 0 1 0 0 0 1 0 0 0 1 67718.dat"
LARGE = "1 15 0 0 900 1 0 0 0 1 0 0 0 1 54675.dat"
RACK = "1 15 0 0 1800 1 0 0 0 1 0 0 0 1 87761.dat"
UNKNOWN = "1 15 0 0 2700 1 0 0 0 1 0 0 0 1 99999.dat"
EXAMPLE = Path(__file__).parents[4] / "examples" / "13_front_steered.ldr"
PATHS = [PLANS / f"{name}.ldr" for name in ("two_wheeler", "walker", "robo_arm")] + [EXAMPLE]


@pytest.mark.parametrize(
    ("path", "lines"),
    [
        (PATHS[0], ["45678 SPIKE Prime: 37 of 37 parts"]),
        (
            PATHS[1],
            [
                (
                    "45678 SPIKE Prime and 45681 SPIKE Prime expansion: 82 of 84 parts; add 2 x "
                    "Medium angular motor (45603)"
                ),
                (
                    "45678 SPIKE Prime: 70 of 84 parts; add 2 x Medium angular motor (45603), 12 x "
                    "Pin (3673)"
                ),
            ],
        ),
        (PATHS[3], ["45678 SPIKE Prime: 32 of 33 parts; add 1 x Axle 12 (3708)"]),
    ],
    ids=lambda value: getattr(value, "stem", ""),
)
def test_sets_for_our_plans(path, lines):
    found = [str(one) for one in purchases(read_plan(path))]
    assert [line for line in found if line in lines] == lines


def test_arm_needs_parts_besides_two_sets():
    first, second, *_ = purchases(read_plan(PATHS[2]))
    assert [one.number for one in first.sets + second.sets] == ["45678", "45560", "45678", "45681"]
    assert first.missing == {"spike-medium": 2, "94925": 4, "18938": 1, "18939": 1}
    assert second.missing == {"spike-medium": 2, "94925": 4, "3648b": 2, "43857": 1}


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_sets_and_what_is_added_are_what_a_plan_needs(path):
    plan = read_plan(path)
    needed = needs(plan)
    composed = sum(placed.part.number in components() for placed in plan.parts)
    assert needed.total() == len(plan.parts) + composed  # of two parts each
    for one in purchases(plan):
        have = sum((chosen.parts for chosen in one.sets), Counter())
        assert one.missing + one.uncompared == needed - have
        assert one.present == (needed & have).total()


def test_set_without_parts_list_compares_devices_only():
    (found,) = [
        one for one in purchases(plan_of(HUB, LARGE, BEAM)) if one.sets[0].number == "51515"
    ]
    assert str(found) == (
        "51515 MINDSTORMS Robot Inventor: 1 of 3 parts; 1 not compared; add 1 x Large angular "
        "motor (45602)"
    )


def test_second_set_must_add_a_part():
    pairs = {
        one.sets[1].number for one in purchases(plan_of(HUB, LARGE, RACK)) if len(one.sets) == 2
    }
    assert pairs == {"45681"}


def test_unknown_part_is_named_and_not_bought():
    lines = [str(one) for one in purchases(plan_of(HUB, UNKNOWN, UNKNOWN))]
    assert (
        lines[0] == "45678 SPIKE Prime: 1 of 3 parts; 2 not compared (not in the catalogue: 99999)"
    )


def test_devices_are_named_first_and_many_kinds_are_shortened():
    kinds = ("3003", "3648b", "3649", "10928", "2905", "10197", "98989", "99010")
    lines = [
        f"1 15 0 0 {900 * place} 1 0 0 0 1 0 0 0 1 {number}.dat"
        for place, number in enumerate(kinds, 2)
    ]
    alone = next(one for one in purchases(plan_of(HUB, LARGE, LARGE, *lines)) if len(one.sets) == 1)
    assert "add 1 x Large angular motor (45602), 1 x" in str(alone)
    assert str(alone).endswith(") and 1 more of other kinds")


def test_plan_without_hub_lists_no_set():
    assert purchases(plan_of(BEAM, LARGE)) == []


def test_moulds_and_assemblies_count_as_the_parts_of_a_set():
    """A notched axle serves for a plain one; a rim with its tyre is two parts; the hub's colour
    does not matter."""
    lines = ("3704", "56145c01", "45601", "6558", "42924")
    needed = needs(
        plan_of(
            *(
                f"1 15 0 0 {900 * place} 1 0 0 0 1 0 0 0 1 {number}.dat"
                for place, number in enumerate(lines)
            )
        )
    )
    assert needed == {"32062": 1, "56145": 1, "44309": 1, "prime": 1, "6558": 2}


def test_inventories():
    """All parts are in the catalogue, with as many as the sources say."""
    totals = {one.number: one.parts.total() for one in sets()}
    assert totals == {
        "45678": 469,
        "51515": 7,
        "45681": 558,
        "17101": 3,
        "31313": 543,
        "45544": 464,
        "45560": 736,
    }
    assert [one.number for one in sets() if not one.is_listed] == ["51515", "17101"]


BLUE_BEAM = BEAM.replace("1 4 ", "1 1 ", 1)
FEW = plan_of(HUB, pin(0, 0, 0), pin(0, 0, 20), pin(0, 0, 40), BEAM, BLUE_BEAM, BLUE_BEAM)


def test_parts_are_listed_by_family_the_heaviest_first_and_then_by_count():
    entries = parts_list(FEW)
    assert [(entry.part.number, entry.colour.code, entry.count) for entry in entries] == [
        ("67718", 15, 1),
        ("32316", 1, 2),
        ("32316", 4, 1),
        ("2780", 0, 3),
    ]
    beams = entries[1]
    assert beams.mass_g == pytest.approx(2 * beams.part.mass_g)
    # A device that is sold singly has LEGO's number of that, and a beam its own.
    assert entries[0].shop_number == entries[0].part.device.sold_as != "67718"
    assert beams.shop_number == "32316"


def test_lists_for_shops_have_their_heads_and_colours():
    entries = parts_list(FEW)
    heads, *rows = csv.reader(as_text(entries, "csv").splitlines())
    assert heads == ["number", "name", "colour", "count", "mass_g", "mass_source"]
    assert len(rows) == 4
    number, name, colour, count, mass_g, _ = rows[1]
    assert (number, name, colour, count) == ("32316", "Beam 5", entries[1].colour.name, "2")
    assert float(mass_g) == pytest.approx(entries[1].mass_g, abs=5e-4)
    head, *rows = as_text(entries, "rebrickable").splitlines()
    assert head == "Part,Color,Quantity"
    assert rows[1] == f"32316,{entries[1].colour.rebrickable},2"
    first, *items, last = as_text(entries, "bricklink").splitlines()
    assert (first, last) == ("<INVENTORY>", "</INVENTORY>") and len(items) == 4
    colour = f"<COLOR>{entries[1].colour.bricklink}</COLOR>"
    item = f"<ITEMTYPE>P</ITEMTYPE><ITEMID>32316</ITEMID>{colour}<MINQTY>2</MINQTY>"
    assert items[1].strip() == f"<ITEM>{item}</ITEM>"
    assert entries[1].colour.bricklink and entries[1].colour.rebrickable


@pytest.mark.parametrize(
    ("missing", "counts"),
    [
        ({}, []),
        ({"32316": 1}, [("32316", 1, 1)]),
        # What is missing may have any of its colours: first that which is needed most.
        ({"32316": 3}, [("32316", 1, 2), ("32316", 4, 1)]),
        ({"32316": 9, "2780": 2}, [("32316", 1, 2), ("32316", 4, 1), ("2780", 0, 2)]),
        ({"3001": 5}, []),
    ],
)
def test_of_a_list_what_is_missing_is_still_needed(missing, counts):
    found = still_needed(parts_list(FEW), Counter(missing))
    assert [(entry.part.number, entry.colour.code, entry.count) for entry in found] == counts


def test_a_wheel_is_needed_as_often_as_the_scarcer_of_its_halves_is_missing():
    """LDraw has a rim with its tyre as one part, and shops have two."""
    wheels = plan_of(*["1 0 0 0 0 1 0 0 0 1 0 0 0 1 56145c01.dat"] * 4)
    for missing, count in (
        ({"56145": 1, "44309": 3}, 3),
        ({"56145": 2}, 2),
        ({"56145": 9, "44309": 9}, 4),
    ):
        (entry,) = still_needed(parts_list(wheels), Counter(missing))
        assert entry.count == count


def test_sets_that_somebody_has_may_be_several_of_one():
    number = "45678"
    (once,) = [one for one in sets() if one.number == number]
    have = once.parts["32316"]
    many = plan_of(*[BEAM] * (have + 2))
    alone, twice = owned(many, [number]), owned(many, [number, number])
    assert (alone.present, alone.missing) == (have, Counter({"32316": 2}))
    assert twice.missing == Counter({"32316": 2 - min(2, have)})
    assert owned(many, []).missing == Counter({"32316": have + 2})
    with pytest.raises(PlanError, match="there is no inventory of set '51515'; name sets of 45678"):
        owned(many, [number, "51515"])
