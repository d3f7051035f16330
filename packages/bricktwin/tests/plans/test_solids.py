"""What belongs together does not collide; the same, displaced or tilted, does. Shapes of an
installed LDraw library agree."""

from __future__ import annotations

import functools
import math
import random
from collections.abc import Iterator
from itertools import product

import numpy as np
import pytest
from plan_lines import findings_of, plan_of

from bricktwin.plans import catalogue, ldraw_library
from bricktwin.plans.building import Occupancy, _main_part
from bricktwin.plans.drawing.looks import solids_meet
from bricktwin.plans.geometry import Floats, Form, Solid, rotation
from bricktwin.plans.part import Fit, Part, Site
from bricktwin.plans.plan import Placed

SHIFT = 5.0
"""2 mm in LDU."""
ALONG_Z = "0 0 1 0 1 0 -1 0 0"
AXLE = f"3708 {ALONG_Z}"
NEIGHBOURS = {
    "tyre": [
        f"{rim} | {tyre}"
        for rim, tyre in (
            ("32020", "32019"),
            ("41896", "41897"),
            ("56145", "44309"),
            ("56145", "61481"),
            ("56908", "41897"),
            ("86652", "32019"),
            ("55982", "30648"),
            ("88517", "11957"),
        )
    ],
    "axle in wheel": [
        *(
            f"{wheel} | {AXLE} 0 0 0"
            for wheel in ("41896", "44772", "86652", "56908", "49295p02", "2903", "3649", "3736")
        ),
        f"55982 | {AXLE} 0 0 10",
        f"56145 | {AXLE} 0 0 -10",
        f"56145c01 | {AXLE} 0 0 -10",
    ],
    "axle in button": ["37312 1 0 0 0 0 1 0 -1 0 | 32062 0 -1 0 -1 0 0 0 0 -1 0 -70 0"],
    "peg hole": [
        f"32020 | 6558 {ALONG_Z} 0 20 0",
        "39789 | 3749 0 -1 0 1 0 0 0 0 1 20 24 0",
        f"56908 | 2780 {ALONG_Z} 0 20 -10",
    ],
    "tooth": ["41669 | 3705 0 -1 0 1 0 0 0 0 1 0 0 0"],
    "near": [
        "55982 | 3713 1 0 0 0 1 0 0 0 1 0 0 -10",
        "95646 | 39367p02 0 1 0 1 0 0 0 0 -1 120 -80 120",
        "95658 | 32009 0 -1 0 0 0 1 -1 0 0 -20 -60 0",
        "95658 | 40490 0 1 0 -1 0 0 0 0 1 0 0 -260",
        "99455 | 32062 0 -1 0 -1 0 0 0 0 -1 0 50 50",
    ],
    "gear": [
        "32072 | 32072 0 -0.7071 0.7071 0 0.7071 0.7071 -1 0 0 -14.14 -14.14 -20",
        "3650c | 32123b 0 -1 0 0 0 -1 1 0 0 2 15 12",
        "3650c | 32073 0 1 0 -1 0 0 0 0 1 6 60 12",
    ],
    "stop in the end of a hole": ["32524 | 24316 0 -1 0 1 0 0 0 0 1 0 -20 40"],
}


def line(text: str) -> str:
    """A line from a number and, where it is turned or moved, nine and three more."""
    number, *values = text.split()
    matrix, place = (
        values[:9] or ["1", "0", "0", "0", "1", "0", "0", "0", "1"],
        values[9:] or ["0", "0", "0"],
    )
    return " ".join(["1 4", *place, *matrix, f"{number}.dat"])


def placed(index: int, part: Part, turn: Floats, position: Floats) -> Placed:
    return Placed(index, part, 4, turn, np.asarray(position, dtype=float), 0, index + 1, ())


def collide(*parts: Placed) -> bool:
    return bool(Occupancy(parts).collisions())


@pytest.mark.parametrize("pair", [pair for pairs in NEIGHBOURS.values() for pair in pairs])
def test_neighbours_do_not_collide(pair):
    found = findings_of(plan_of(*map(line, pair.split(" | "))))
    assert "collision" not in {one.name for one in found}, found


@pytest.mark.parametrize("pair", NEIGHBOURS["tyre"] + NEIGHBOURS["axle in button"])
def test_tyre_and_button_hold(pair):
    names = {one.name for one in findings_of(plan_of(*map(line, pair.split(" | "))))}
    assert not names & {"loose", "step", "collision"}


def holes() -> Iterator[tuple[Part, Site]]:
    """The holes of all parts, one for each axis of a part."""
    for part in catalogue.parts():
        yield from (
            (part, site) for site in {(site.fit, site.axis): site for site in part.holes}.values()
        )


def frame(axis: Floats) -> Floats:
    """A rotation that turns x to an axis, [3, 3]."""
    second = np.cross(np.eye(3)[int(np.argmin(np.abs(axis)))], axis)
    second /= np.linalg.norm(second)
    return np.column_stack([axis, second, np.cross(axis, second)])


def displaced(turn: Floats) -> Iterator[tuple[Floats, Floats]]:
    """Shifts across the first axis of a frame, and turns about axes across it."""
    for quarter in range(4):
        across = turn[:, 1] * math.cos(quarter * math.pi / 2) + turn[:, 2] * math.sin(
            quarter * math.pi / 2
        )
        yield SHIFT * across, np.eye(3)
        yield np.zeros(3), rotation(across, math.radians(15))


def test_axle_or_pin_beside_its_hole_or_tilted_is_found():
    missed = []
    for part, site in holes():
        bar, turn, base = (
            catalogue.get("3705" if site.fit is Fit.AXLE_HOLE else "3673"),
            frame(np.array(site.axis)),
            np.eye(3),
        )
        here = placed(0, part, base, np.zeros(3))
        if not collide(here, placed(1, bar, turn, site.centre)):  # it is no blind hole
            moved = (
                (placed(1, bar, tilt @ turn, site.centre + shift))
                for shift, tilt in displaced(turn)
            )
            missed += [
                (part.number, site.centre) for bar_there in moved if not collide(here, bar_there)
            ]
    assert missed == []


def test_tyre_beside_its_rim_or_tilted_is_found():
    seats = [
        (part, site)
        for part in catalogue.parts()
        for site in part.sites
        if site.fit in (Fit.RIM, Fit.TYRE)
    ]
    pairs = [
        (rim, seat, tyre, hold)
        for (rim, seat), (tyre, hold) in product(seats, seats)
        if (seat.fit, hold.fit) == (Fit.RIM, Fit.TYRE) and abs(seat.length - hold.length) <= 4.0
    ]
    assert len(pairs) > 15
    for rim, seat, tyre, hold in pairs:
        here, middle = placed(0, rim, np.eye(3), np.zeros(3)), np.array(hold.centre)
        at = np.array(seat.centre)
        assert not collide(here, placed(1, tyre, np.eye(3), at - middle)), (rim.number, tyre.number)
        for shift, tilt in displaced(frame(np.array(seat.axis))):
            assert collide(here, placed(1, tyre, tilt, at - tilt @ middle + shift)), (
                rim.number,
                tyre.number,
                shift,
            )


def test_forty_overlaps_drawn_by_a_seed_are_found():
    """Two parts, one turned at random; a point of one, 1.2 mm deep in its material, lies on one of
    the other."""
    rng, missed = random.Random(43), []
    deep = {
        part: part.samples[part.blocks(part.samples, 3.0, part.holes)]
        for part in catalogue.parts()
        if part.family != "chains"
    }
    massive = [part for part, points in deep.items() if len(points)]
    assert len(massive) > 200
    for _ in range(40):
        first, second = rng.sample(massive, 2)
        turn = rotation(np.eye(3)[rng.randrange(3)], rng.uniform(0.0, math.pi))
        at = rng.choice(list(deep[first])) - turn @ rng.choice(list(deep[second]))
        if not collide(placed(0, first, np.eye(3), np.zeros(3)), placed(1, second, turn, at)):
            missed.append((first.number, second.number))
    assert missed == []


LIBRARY = ldraw_library.folder()


@functools.cache
def shortcuts() -> list[tuple[str, list[str]]]:
    """Assemblies of the installed library that have only parts of the catalogue, and their
    lines."""
    found = []
    for path in sorted((LIBRARY / "parts").glob("*.dat")) if LIBRARY else ():
        text = path.read_text(encoding="utf-8", errors="replace")
        lines = [one for one in text.splitlines() if one.startswith("1 ")]
        if (
            "Shortcut" in text[:1500]
            and len(lines) > 1
            and all(catalogue.find(one.split()[14]) for one in lines)
        ):
            found.append((path.name, lines))
    return found


@pytest.mark.slow
@pytest.mark.skipif(LIBRARY is None, reason="no LDraw library")
def test_what_ldraw_puts_together_passes():
    assert len(shortcuts()) > 8
    collisions = {
        name: Occupancy(plan_of(*lines).parts).collisions() for name, lines in shortcuts()
    }
    assert not any(collisions.values()), collisions


@pytest.mark.slow
@pytest.mark.skipif(LIBRARY is None, reason="no LDraw library")
def test_moved_and_printed_numbers_of_the_library_are_known():
    """200 numbers of parts that are the same as one of the catalogue, and not in its table."""
    table = {number for part in catalogue.parts() for number in (part.number, *part.aliases)}
    facts: dict[str, str] = {}
    for path in (LIBRARY / "parts").glob("*.dat"):
        text = path.read_text(encoding="utf-8", errors="replace")
        title, name = text.partition("\n")[0], path.stem.lower()
        places = [one.split() for one in text.splitlines() if one.startswith("1 ")]
        if title.startswith(("0 ~Moved to", "0 =")) and len(places) == 1:
            facts[name] = places[0][14].lower().removesuffix(".dat")
        elif "Pattern" in title or ("Sticker" in title and "Shortcut" not in title):
            facts[name] = next(
                (
                    name[:end]
                    for end in range(len(name))
                    if name[end] in "pd" and name[:end] in table
                ),
                name,
            )
    final = {name: facts.get(target, target) for name, target in facts.items()}
    pool = sorted(name for name, target in final.items() if target in table and name not in table)
    drawn = random.Random(43).sample(pool, 200)
    known = [name for name in drawn if catalogue.find(name) is catalogue.find(final[name])]
    assert len(known) >= 190, sorted(set(drawn) - set(known))


@pytest.mark.parametrize(
    ("number", "part"),
    [
        ("571", "6629"),
        ("924", "32192"),
        ("u9393c02", "45601"),
        ("3004p0b", "3004"),
        ("87079d08", "87079"),
        ("3069bpb0123", "3069b"),
        ("3005-7", "3005"),
        ("39367p01", "39367p02"),
        ("64871", "32278"),
    ],
)
def test_moved_and_printed_numbers(number, part):
    assert catalogue.get(f"{number}.dat") is catalogue.get(part)


@pytest.mark.parametrize("number", ["3004x", "p01", "3004p", "99999p01", "3004c01", "s3004p01"])
def test_other_numbers_are_unknown(number):
    assert catalogue.find(number) is None


@pytest.mark.parametrize("axis", range(3))
def test_boxes_meet_where_they_overlap_on_each_axis(axis: int) -> None:
    """Far away from the origin along two axes, and apart along the third."""
    middle = [0.0 if along == axis else 100.0 for along in range(3)]
    beside = [9.0 if along == axis else 100.0 for along in range(3)]
    one = Solid(Form.BOX, tuple(middle), (5.0, 5.0, 5.0))  # type: ignore[arg-type]
    for half, meets in ((3.0, False), (4.5, True)):
        other = Solid(Form.BOX, tuple(beside), (half,) * 3)  # type: ignore[arg-type]
        assert solids_meet(one, other) is solids_meet(other, one) is meets


def test_main_part_is_the_heaviest_one() -> None:
    plan = plan_of(*(f"1 4 0 0 0 1 0 0 0 1 0 0 0 1 {name}.dat" for name in ("2780", "32316")))
    assert _main_part(plan, (0, 1)) == _main_part(plan, (1, 0)) == 1
