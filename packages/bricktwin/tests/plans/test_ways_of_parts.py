"""Ways of parts to their places: which parts are in the way, in which direction a part goes out,
and how a booklet shows it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plan_lines import BEAM, pin, plan_of

from bricktwin.plans.booklet.instructions import _Author
from bricktwin.plans.building import (
    Fault,
    Move,
    Occupancy,
    _directions,
    _groups,
    _main_part,
    links_of,
    moves_of,
    step_faults,
)
from bricktwin.plans.connections import connections
from bricktwin.plans.geometry import Floats
from bricktwin.plans.plan import Plan

BRICK = "1 4 {} {} {} 1 0 0 0 1 0 0 0 1 3004.dat"
"""A brick of 40 x 24 x 20 LDU."""
OUT = np.array([0.0, -1.0, 0.0])


def author_of(*lines: str) -> _Author:
    """An author who draws nothing."""
    studio: Any = None
    return _Author(plan_of(*lines), studio)


def shifts_of(*parts: int) -> dict[int, Floats]:
    return {part: np.zeros(3) for part in parts}


def listed(way: tuple[Floats, Floats]) -> list[list[float]]:
    return [end.round(6).tolist() for end in way]


def test_a_pin_goes_from_its_end_to_the_mouth_of_its_hole() -> None:
    """It is 40 long, half in the hole of a beam from -10 to 10."""
    author = author_of(BEAM, pin(0, -10, 20))
    move = Move(((1,),), OUT)
    ways = author._ways(move, shifts_of(0))
    assert [listed(way) for way in ways] == [[[0, 10, 20], [0, -10, 20]]]
    # The beam is where it is on its own way.
    shifted = author._ways(move, {0: np.array([0.0, 5.0, 0.0])})
    assert [listed(way) for way in shifted] == [[[0, 10, 20], [0, -5, 20]]]
    # What is not there yet has no hole to go to.
    assert author._ways(move, {}) == []
    # Seen from the other side, it goes through the hole.
    through = author._ways(Move(((1,),), -OUT), shifts_of(0))
    assert [listed(way) for way in through] == [[[0, -30, 20], [0, 10, 20]]]


def test_a_part_is_drawn_28_ldu_before_its_hole() -> None:
    author = author_of(BEAM, pin(0, -10, 20))
    shown, arrows = author._apart([Move(((1,),), OUT)], frozenset({0}))
    assert [one.shift.tolist() for one in shown] == [[0, 0, 0], [0, -48, 0]]
    ((start, end),) = arrows
    assert (end - start).tolist() == [0, 28, 0] and end.tolist() == [0, -10, 20]
    # Without a way it lies in its place.
    shown, arrows = author._apart([Move(((1,),), np.zeros(3))], frozenset({0}))
    assert arrows == () and not shown[1].shift.any()
    shown, arrows = author._apart([Move(((1,),), OUT)], frozenset())
    assert arrows == () and [one.placed.index for one in shown] == [1]


def test_pins_in_one_line_have_one_arrow_and_many_have_two() -> None:
    holes = (-40, -20, 0, 20, 40)
    author = author_of(BEAM, *(pin(0, -10, z) for z in holes))
    for count, arrows in ((2, 2), (4, 4), (5, 2)):
        move = Move(tuple((part,) for part in range(1, count + 1)), OUT)
        ways = author._ways(move, shifts_of(0))
        assert len(ways) == arrows
    # Of many, the first and the last.
    assert sorted(float(start[2]) for start, _ in ways) == [-40, 40]
    # Two beams on one pin: the arrow ends at the outer one.
    other = BEAM.replace("1 4 0 0 0", "1 4 0 -20 0")
    stacked = author_of(BEAM, other, pin(0, -10, 20))
    (way,) = stacked._ways(Move(((2,),), OUT), shifts_of(0, 1))
    assert listed(way) == [[0, 10, 20], [0, -30, 20]]


def test_parts_on_their_way_do_not_overlap() -> None:
    author = author_of(BEAM, pin(0, -10, 20), BRICK.format(0, -60, 20))
    move = Move(((1,),), OUT)
    (way,) = author._ways(move, shifts_of(0))
    # Alone it is 20 out of its hole, and 28 before it.
    assert author._distance_out(move, [way], {}) == 48.0
    # A brick from -60 to -36 is in the way; the next distance is 28 more.
    low, high = author.occupancy.low[1][1], author.occupancy.high[1][1]
    assert low == pytest.approx(-30.0) and high == pytest.approx(10.0)
    brick_low = float(author.occupancy.low[2][1])
    distance = author._distance_out(move, [way], shifts_of(2))
    assert (distance - 48.0) % 28.0 == 0.0
    assert high - distance <= brick_low < high - distance + 28.0
    # Where all is full it gives up after twelve.
    author._is_clear = lambda *arguments: False  # type: ignore[method-assign]
    assert author._distance_out(move, [way], shifts_of(2)) == 48.0 + 12 * 28.0


def test_what_is_put_in_place_together_is_as_far_out_as_its_deepest_part_needs() -> None:
    author = author_of(BEAM, pin(0, -10, 20), pin(0, 10, 0))
    move = Move(((1,), (2,)), OUT)
    ways = author._ways(move, shifts_of(0))
    assert sorted(float(start[1] - end[1]) for start, end in ways) == [20.0, 40.0]
    assert author._distance_out(move, ways, {}) == 68.0


@pytest.mark.parametrize(
    ("shift", "is_clear"),
    [
        ((40.0, 0.0, 0.0), True),
        ((39.9, 0.0, 0.0), False),
        ((-40.0, 0.0, 0.0), True),
        ((-39.9, 0.0, 0.0), False),
        ((0.0, 24.0, 0.0), True),
        ((0.0, 23.9, 0.0), False),
        ((0.0, 0.0, -20.0), True),
        ((0.0, 0.0, -19.9), False),
        ((39.0, 23.0, 20.0), True),
    ],
)
def test_boxes_that_only_touch_are_clear(shift: Any, is_clear: bool) -> None:
    author = author_of(BRICK.format(0, 0, 0), BRICK.format(0, 0, 0), BRICK.format(500, 0, 0))
    move = Move(((0,),), OUT)
    assert author._is_clear(move, np.array(shift), shifts_of(1, 2)) is is_clear
    # The other one may be on its way too.
    others = {1: -np.array(shift), 2: np.zeros(3)}
    assert author._is_clear(move, np.zeros(3), others) is is_clear
    assert author._is_clear(move, np.array(shift), {})


def test_a_part_that_nothing_there_holds_waits_for_the_one_that_will() -> None:
    author = author_of(BEAM, pin(0, -10, 20), BEAM.replace("1 4 0 0 0", "1 4 0 -20 0"))
    beam, peg, other = (Move(((part,),), OUT) for part in range(3))
    # The pin alone holds to nothing; with one of the beams it does, wherever that is.
    assert author._waits(peg, [[peg]], set())
    assert not author._waits(peg, [[peg]], {0})
    assert not author._waits(peg, [[beam], [peg]], set())
    assert not author._waits(peg, [[peg, other]], set())
    # What is connected to nothing at all waits for nothing.
    lonely = author_of(BEAM, BRICK.format(0, -500, 0))
    assert not lonely._waits(Move(((1,),), OUT), [[Move(((1,),), OUT)]], set())


def moves_with(*counts: int) -> list[Move]:
    """Moves of so many items, each of one part."""
    part = iter(range(99))
    return [Move(tuple((next(part),) for _ in range(count)), OUT) for count in counts]


def grouped(lines: list[str], moves: list[Move], most: int) -> list[list[int]]:
    split = author_of(*lines)._filled(moves, 0, most, set(range(99)))
    return [[len(move.items) for move in group] for group in split]


def test_moves_fill_groups_in_order() -> None:
    same = [BRICK.format(100 * number, 0, 0) for number in range(12)]
    assert grouped(same, moves_with(1, 1, 1, 1, 1), 2) == [[1, 1], [1, 1], [1]]
    assert grouped(same, moves_with(2, 2, 3, 1), 4) == [[2, 2], [3, 1]]
    # A single move may have more than a group.
    assert grouped(same, moves_with(5, 1, 1), 2) == [[5], [1, 1]]
    # Never more than eight pieces.
    assert grouped(same, moves_with(*[1] * 9), 99) == [[1] * 8, [1]]
    # Nor more than four kinds.
    kinds = [f"1 {number} {100 * number} 0 0 1 0 0 0 1 0 0 0 1 3004.dat" for number in range(12)]
    assert grouped(kinds, moves_with(*[1] * 9), 99) == [[1] * 4, [1] * 4, [1]]


def test_many_pieces_are_spread_evenly() -> None:
    same = [BRICK.format(100 * number, 0, 0) for number in range(12)]
    author = author_of(*same)
    for count, sizes in ((8, [8]), (9, [5, 4]), (10, [5, 5]), (12, [6, 6])):
        split = author._split(moves_with(*[1] * count), 0, set(range(99)))
        assert [len(group) for group in split] == sizes
    # A move of more than eight is taken apart.
    split = author._split(moves_with(9), 0, set(range(99)))
    assert [sum(len(move.items) for move in group) for group in split] == [5, 4]
    assert all((move.outward == OUT).all() for group in split for move in group)


def test_hidden_parts_are_shown_in_two_halves_and_then_in_an_inset() -> None:
    same = [BRICK.format(100 * number, 0, 0) for number in range(5)]
    author = author_of(*same)
    asked: list[tuple[list[int], list[int]]] = []

    def best(moves: Any, before: Any) -> Any:
        parts = [part for move in moves for part in move.parts]
        asked.append((parts, sorted(before)))
        hidden = [(part,) for part in parts if part in (2, 3)]
        return SimpleNamespace(parts=parts), hidden

    author._best_scene = best  # type: ignore[method-assign]
    author._inset = lambda moves, before, hidden: hidden  # type: ignore[method-assign]
    step: Any = SimpleNamespace(assembly=("leg",))
    shown = list(author._shown(moves_with(1, 1, 1, 1, 1)[1:], frozenset({0}), step, 3))
    assert [[part for move in one.moves for part in move.parts] for one in shown] == [
        [1],
        [2],
        [3],
        [4],
    ]
    # Each sees what was put in place before it.
    assert [sorted(one.before) for one in shown] == [[0], [0, 1], [0, 1, 2], [0, 1, 2, 3]]
    assert [one.inset for one in shown] == [None, [(2,)], [(3,)], None]
    assert {(one.assembly, one.times, one.note) for one in shown} == {(("leg",), 3, "")}
    # Nothing that is seen is split.
    whole = list(author._shown(moves_with(1, 1), frozenset(), step, 1))
    assert len(whole) == 1


def test_an_inset_shows_hidden_parts_with_what_they_touch() -> None:
    author = author_of(BEAM, pin(0, -10, 20), BRICK.format(0, -90, 0), pin(0, -10, 0))
    asked: list[tuple[list[int], list[int]]] = []
    still_hidden: list[Any] = []

    def best(moves: Any, before: Any) -> Any:
        asked.append(([part for move in moves for part in move.parts], sorted(before)))
        return len(asked), still_hidden

    author._best_scene = best  # type: ignore[method-assign]
    moves = [Move(((1,), (3,)), OUT)]
    # Of the two pins one is hidden; it touches the beam, and the brick does not touch it.
    assert author._inset(moves, frozenset({0, 2}), [(1,)]) == 1
    assert asked == [([1], [0])]
    # If that hides it too, it is alone.
    still_hidden.append((1,))
    assert author._inset(moves, frozenset({0, 2}), [(1,)]) == 3
    assert asked[1:] == [([1], [0]), ([1], [])]


# ---------------------------------------------------------------- building


def test_a_pin_goes_out_to_the_side_where_most_of_it_is() -> None:
    for height, outward in ((-10, -1.0), (10, 1.0)):
        plan = plan_of(BEAM, pin(0, height, 20))
        links = links_of(plan.parts, connections(plan.parts))
        ((beam, way),) = links[1]
        assert beam == 0 and way.tolist() == [0.0, outward, 0.0]
        ((peg, back),) = links[0]
        assert peg == 1 and back.tolist() == [0.0, -outward, 0.0]


def test_directions_are_those_of_the_connections_then_the_axes() -> None:
    slant = np.array([0.6, 0.8, 0.0])
    links: Any = {0: [(1, slant), (2, -slant), (3, np.array([1.0, 0.0, 0.0]))]}
    found = [way.tolist() for way in _directions([0], links)]
    assert found == [
        [0.6, 0.8, 0.0],
        [-0.6, -0.8, 0.0],
        [1, 0, 0],
        [-1, 0, 0],
        [0, 1, 0],
        [0, -1, 0],
        [0, 0, 1],
        [0, 0, -1],
    ]
    # Connections within the group do not count.
    assert _directions([0, 1], {0: [(1, slant)], 1: [(0, -slant)]})[0].tolist() == [1, 0, 0]


def test_groups_are_single_items_then_what_touches_then_all() -> None:
    links: Any = {part: [] for part in range(4)}
    links[1] = [(2, OUT)]
    links[2] = [(1, -OUT)]
    items = [(0,), (1,), (2,), (3,)]
    found = [[item[0] for item in group] for group in _groups(items, links)]
    # In the reverse of the author's order.
    assert found == [[3], [2], [1], [0], [1, 2], [1, 2], [0, 1, 2, 3]]
    assert list(_groups([(0,)], links)) == [[(0,)]]
    both = [[item[0] for item in group] for group in _groups([(1,), (2,)], links)]
    assert both == [[2], [1], [1, 2]]


def test_the_main_part_is_the_heaviest_that_is_connected() -> None:
    plan = plan_of(BEAM, pin(0, -10, 20), "1 15 0 0 0 1 0 0 0 1 0 0 0 1 67718.dat")
    assert _main_part(plan, [0, 1]) == 0 and _main_part(plan, [1, 0, 2]) == 2


def moves_in(plan: Plan, occupancy: Occupancy | None = None) -> tuple[list[Move], tuple[int, ...]]:
    (step,) = plan.steps
    links = links_of(plan.parts, connections(plan.parts))
    after = set(range(len(plan.parts)))
    return moves_of(step, after, occupancy or Occupancy(plan.parts), links)


def test_the_first_part_lies_on_the_table_and_others_are_put_on_it() -> None:
    moves, blocked = moves_in(plan_of(BEAM, pin(0, -10, 20), pin(0, 10, 0)))
    assert [move.parts for move in moves] == [[0], [1], [2]] and blocked == ()
    assert not moves[0].outward.any()
    assert moves[1].outward.tolist() == [0.0, -1.0, 0.0]
    assert moves[2].outward.tolist() == [0.0, 1.0, 0.0]


def test_a_part_between_walls_is_blocked_and_a_search_ends() -> None:
    # A ball in a box of six hubs.
    walls = [(150, 0, 0), (-150, 0, 0), (0, 0, 230), (0, 0, -230), (0, 90, 0), (0, -90, 0)]
    lines = [f"1 4 {x} {y} {z} 1 0 0 0 1 0 0 0 1 67718.dat" for x, y, z in walls]
    plan = plan_of(*lines, "0 STEP", "1 1 0 0 0 1 0 0 0 1 0 0 0 1 3713.dat")
    faults = list(step_faults(plan, connections(plan.parts), Occupancy(plan.parts)))
    assert [fault.kind for fault in faults][-1] is Fault.BLOCKED
    assert faults[-1].parts == (6,)
    # With no queries left, nothing is known of its way.
    spent = Occupancy(plan.parts, most_queries=0)
    spent.queries = 1
    unchecked = list(step_faults(plan, connections(plan.parts), spent))
    kinds = [fault.kind for fault in unchecked]
    assert kinds.count(Fault.UNCHECKED) == 2 and Fault.BLOCKED not in kinds
    # With none asked yet, one part more is looked at.
    two = plan_of(BEAM, pin(0, -10, 20), pin(0, -10, 0))
    moves, blocked = moves_in(two, Occupancy(two.parts, 0))
    assert [move.parts for move in moves] == [[0], [1], [2]] and blocked == (1,)


@pytest.mark.parametrize(("count", "is_checked"), [(60, True), (61, False)])
def test_a_step_of_more_than_sixty_parts_is_not_checked(count: int, is_checked: bool) -> None:
    plan = plan_of(*(BRICK.format(100 * number, 0, 0) for number in range(count)))
    occupancy = Occupancy(plan.parts)
    occupancy.is_free = lambda group, others, shift: True  # type: ignore[method-assign]
    kinds = {fault.kind for fault in step_faults(plan, (), occupancy)}
    assert (Fault.UNCHECKED in kinds) is not is_checked


@pytest.mark.parametrize(
    ("shift", "is_near"),
    [
        # Of 40 LDU, each loses a skin of 1.5 at both ends of the moved one.
        ((38.4, 0.0, 0.0), True),
        ((38.6, 0.0, 0.0), False),
        ((-38.4, 0.0, 0.0), True),
        ((-38.6, 0.0, 0.0), False),
        ((0.0, 22.4, 0.0), True),
        ((0.0, 22.6, 0.0), False),
    ],
)
def test_only_what_is_more_than_a_touch_is_near(shift: Any, is_near: bool) -> None:
    parts = plan_of(BRICK.format(0, 0, 0), BRICK.format(0, 0, 0)).parts
    near = Occupancy(parts)._near(0, np.array(shift))
    assert near[1] == is_near and Occupancy(parts).low.shape == (2, 3)


def test_pairs_are_compared_once_and_chains_and_moved_tyres_never() -> None:
    parts = plan_of(*(BRICK.format(10 * number, 0, 0) for number in range(3))).parts
    assert list(Occupancy(parts)._near_pairs()) == [(0, 1), (0, 2), (1, 2)]
    assert Occupancy(parts).collisions() == [(0, 1), (0, 2), (1, 2)]
    rim_and_tyre = plan_of(BRICK.format(45, 0, 0), "1 0 0 0 0 1 0 0 0 1 0 0 0 1 44309.dat").parts
    occupancy = Occupancy(rim_and_tyre)
    assert occupancy.collisions() == [(0, 1)]
    others = np.array([False, True])
    assert occupancy.is_free([0], others, np.array([0.0, 1.0, 0.0]))
    assert not occupancy.is_free([0], others, np.zeros(3))
    assert occupancy.queries == 2
    chain = plan_of(BRICK.format(0, 0, 0), "1 0 0 10 0 1 0 0 0 1 0 0 0 1 3711.dat").parts
    assert Occupancy(chain).collisions() == []


def test_only_parts_that_are_there_are_in_the_way() -> None:
    parts = plan_of(*(BRICK.format(x, 0, 0) for x in (0, 60, 100))).parts
    occupancy = Occupancy(parts)
    shift = np.array([50.0, 0.0, 0.0])
    assert not occupancy.is_free([0], np.array([False, True, True]), shift)
    assert occupancy.is_free([0], np.array([False, False, False]), shift)
    assert not occupancy.is_free([2, 0], np.array([False, True, False]), shift)
    assert occupancy.is_free([0], np.array([False, False, True]), np.array([20.0, 0.0, 0.0]))
