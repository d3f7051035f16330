"""Check of plans."""

from __future__ import annotations

import re
import time
from collections import Counter

import pytest
from plan_lines import BEAM, PLANS, ROBOTS, findings_of, pin, plan_of
from plan_mutants import mutant

from bricktwin.plans import ldraw_file
from bricktwin.plans.check import _names
from bricktwin.plans.plan import make_plan, read_plan

_COUNT = re.compile(r"^0 !BRICKSRL PARTS .*\n", re.MULTILINE)
SEEDS = {"two_wheeler": 56, "walker": 32, "robo_arm": 32, "ev3_driver": 16}
FRAME = "1 72 0 20 0 1 0 0 0 1 0 0 0 1 32316.dat"
HELD = (BEAM, FRAME, pin(0, 10, 20), pin(0, 10, -20))


def line(number: str, x: float, y: float, z: float, matrix: str = "1 0 0 0 1 0 0 0 1") -> str:
    """A line that places a part."""
    return f"1 4 {x} {y} {z} {matrix} {number}.dat"


@pytest.mark.parametrize("robot", ROBOTS)
def test_our_plans_pass_check(robot):
    plan = read_plan(PLANS / f"{robot}.ldr")
    assert findings_of(plan) == []
    assert 30 <= len(plan.parts) <= 250
    assert plan.robot is not None


def test_two_beams_on_two_pins_pass(findings):
    assert findings(*HELD) == []


@pytest.mark.parametrize(
    ("lines", "kind", "number", "says"),
    [
        (
            (*HELD, line("12345", 0, 0, 0)),
            "unknown part",
            5,
            "part 12345 (once) is not in the catalogue",
        ),
        ((*HELD, "0 !BRICKSRL PARTS 5"), "count", 0, "says PARTS 5, but places 4"),
        ((*HELD, line("2780", 99, 0, 0)), "loose", 5, "not connected to the main body"),
        (HELD[:3], "half-held", 2, "can swing or slide; connect it at a second place"),
        ((*HELD[:3], pin(0, -10, -20)), "half-held", 4, "goes into one part only"),
        ((*HELD[:3], pin(0, 20, -20)), "half-held", 4, "only 4.0 mm are inside"),
        ((*HELD, FRAME), "collision", 5, "is inside Beam 5 (32316) of line 2"),
        (
            (*HELD, line("60483", 0, -20, 40), pin(0, -10, 40)),
            "misfit",
            6,
            "a pin does not go into an axle hole",
        ),
        ((*HELD, line("54696p02", 0, 60, 0)), "wiring", 0, "has no hub"),
    ],
)
def test_each_mistake_has_its_line(findings, lines, kind, number, says):
    found = [one for one in findings(*lines) if one.name == kind and one.line == number]
    assert any(says in one.detail for one in found), findings(*lines)


def test_what_swings_together_is_named_at_its_first_line(findings):
    # The two beams that are pinned twice are the main body, and the first one swings on it.
    second = line("32316", 0, 40, 0)
    (found,) = findings(*HELD[:3], second, pin(0, 30, 0), pin(0, 30, -40))
    assert found.line == 1
    assert found.detail.startswith("Beam 5 (32316), Pin with friction (2780) can swing")


def test_many_parts_are_named_by_their_first_kinds():
    numbers = ("32316", "2780", "2780", "3713", "3001", "3648b", "10928", "32270")
    parts = plan_of(*(line(number, 0, 0, 0) for number in numbers)).parts
    kinds = [parts[0].name, f"2 x {parts[1].name}", *(placed.name for placed in parts[3:])]
    assert _names(list(parts)) == f"{', '.join(kinds[:5])} and 2 more"
    assert _names(list(parts[:6])) == ", ".join(kinds[:5])


def test_free_beam_is_allowed(findings):
    assert findings(BEAM, "0 !BRICKSRL FREE", FRAME, pin(0, 10, 20)) == []


def _gears(distance: float, shift: float = 0.0) -> list[str]:
    """Two axles in a base plate with a gear of 24 teeth each."""
    along_y = "1 0 0 0 0 1 0 -1 0"
    lines = [line("39369", 0, 0, 0)]
    for x, y in ((0.0, 0.0), (distance, shift)):
        lines += [
            line("3705", x, -10, 0, "0 -1 0 1 0 0 0 0 1"),
            line("3713", x, 20, 0, along_y),
            line("3648b", x, -20 - y, 0, along_y),
        ]
    return [
        "0 !BRICKSRL FREE" if text.endswith("3705.dat") else text
        for text in lines
        for text in ([text] if not text.endswith("3705.dat") else ["0 !BRICKSRL FREE", text])
    ]


def test_gears_at_correct_distance_mesh(findings):
    assert [one for one in findings(*_gears(60)) if one.name == "gears"] == []


def test_misplaced_gears_are_found(findings):
    far = [one.detail for one in findings(*_gears(66)) if one.name == "gears"]
    beside = [one.detail for one in findings(*_gears(60, 10)) if one.name == "gears"]
    assert len(far) == len(beside) == 1
    assert "are 2.4 mm too far apart" in far[0]
    assert "meet over only" in beside[0]


def test_enclosed_part_is_found(findings):
    # A beam lies between two others that are pinned together outside it, before it comes.
    frame = line("39794", 0, 0, 0)
    inner = line("32316", 0, 0, 0)
    lid, floor = line("39369", 0, -20, 0), line("39369", 0, 20, 0)
    pins = [pin(x, y, z) for y in (-10, 10) for x, z in ((60, 100), (-60, 100), (60, -100))]
    text = [
        one.detail
        for one in findings(frame, floor, *pins[3:], "0 STEP", lid, *pins[:3], "0 STEP", inner)
    ]
    assert any("has no free path to its place" in one for one in text)


def test_what_an_unknown_part_may_hold_is_one_finding(findings):
    """A brick on an unknown brick on a brick, and what stands on it; a brick far away is loose all
    the same."""
    tower = [
        line("3001", 0, 0, 0),
        line("99999", 0, -24, 0),
        line("3004", 0, -48, 0),
        line("3004", 0, -72, 0),
    ]
    text = "\n0 STEP\n".join(tower).splitlines()
    assert [(one.name, one.line) for one in findings(*text)] == [("unknown part", 3)]
    assert "what it holds, of 3 parts around it, is not checked" in findings(*text)[0].detail
    assert ("loose", 8) in [
        (one.name, one.line) for one in findings(*text, line("3004", 400, 0, 0))
    ]


def test_unconnected_part_is_found(findings):
    found = findings(BEAM, "0 STEP", FRAME, "0 STEP", *HELD[2:])
    assert [(one.name, one.line) for one in found] == [("step", 3)]


def test_what_hangs_on_an_unconnected_part_is_no_finding_of_its_own(findings):
    far = [line("3001", 400, -24 * level, 0) for level in range(5)]
    found = findings(*"\n0 STEP\n".join([BEAM, *far]).splitlines())
    assert [one.line for one in found if one.name == "step"] == [3]


def test_pin_with_a_bush_may_spin(findings):
    """Through two beams that other pins hold together; with a gear on an axle in its bush, it is a
    shaft."""
    bush = "1 0 0 0 40 0 1 0 1 0 0 0 0 -1 32054.dat"
    held = [BEAM, line("32316", 0, 20, 0), pin(0, 10, 0), pin(0, 10, 20), bush]
    assert findings(*held) == []
    axle = "1 0 0 -30 40 0 1 0 1 0 0 0 0 -1 3704.dat"
    assert findings(*held, axle) == []
    gear = "1 0 0 -40 40 1 0 0 0 0 1 0 -1 0 10928.dat"
    assert {one.name for one in findings(*held, axle, gear)} == {"half-held"}


@pytest.mark.parametrize("number", ["67718", "2780", "3648b"])
def test_a_thousand_parts_in_one_place_are_found_in_seconds(findings, number):
    started = time.process_time()
    found = findings(*[line(number, 0, 0, 0)] * 1000)
    assert {"collision"} <= {one.name for one in found}
    assert len(found) < 2500
    assert time.process_time() - started < 30


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS)
def test_mutants_are_found(robot):
    """At least 95 % of mistakes of eight kinds; those without a changed part count and without
    loose parts are excluded."""
    text = (PLANS / f"{robot}.ldr").read_text(encoding="utf-8")
    missed = []
    for seed in range(SEEDS[robot]):
        one = mutant(text, seed)
        if not findings_of(make_plan(ldraw_file.parse(one.text, "mutant.ldr"))):
            missed.append(one)
    assert len(missed) <= 0.05 * SEEDS[robot], Counter(one.kind for one in missed)
    assert all(one.kind == "steps swapped" for one in missed), missed


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS)
def test_missing_part_is_mostly_found(robot):
    text = _COUNT.sub("", (PLANS / f"{robot}.ldr").read_text(encoding="utf-8"))
    mutants = [mutant(text, seed) for seed in range(0, 80, 8)]
    found = sum(
        bool(findings_of(make_plan(ldraw_file.parse(one.text, "mutant.ldr")))) for one in mutants
    )
    assert found >= 5


def test_only_ball_of_arm_is_red() -> None:
    # The camera task finds the ball by its colour.
    assert all(placed.colour != 4 for placed in read_plan(PLANS / "robo_arm.ldr").parts)


BRICK = "1 15 0 0 0 1 0 0 0 1 0 0 0 1 95646.dat"


@pytest.mark.parametrize(
    ("port", "motor", "said"),
    [
        ("1", "95658", "does not fit port 1 of EV3 brick with battery (95646); choose one of A, B"),
        ("A", "54696p02", "does not fit port A of EV3 brick with battery (95646); take one of the"),
    ],
)
def test_a_plug_that_does_not_fit_its_port(port, motor, said):
    lines = (BRICK, f"0 !BRICKSRL PORT {port} left", f"1 15 0 300 0 1 0 0 0 1 0 0 0 1 {motor}.dat")
    assert any(said in str(one) for one in findings_of(plan_of(*lines)))


def test_a_line_of_any_length_is_named_in_short(findings):
    (found,) = findings("1 1 " + "2 " * 10_000)
    assert found.name == "unknown part"
    assert len(found.detail) < 250
