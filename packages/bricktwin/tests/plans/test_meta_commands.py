"""Lines that begin with 0, of LDraw and of the programs that write it."""

from __future__ import annotations

from pathlib import Path

import pytest
from plan_lines import BEAM, pin, plan_of

from brickhub.errors import PlanError
from bricktwin.plans.check import check
from bricktwin.plans.meta_commands import META_COMMANDS, SYNTH_KINDS, Meaning

PAGE = Path(__file__).parents[4] / "docs" / "plans.md"
LINK = "1 0 0 100 {} 1 0 0 0 1 0 0 0 1 3711.dat"
SEGMENT = "1 16 0 0 0 1 0 0 0 1 0 0 0 1 ls21.dat"
SPARE = "1 2 0 0 900 1 0 0 0 1 0 0 0 1 32316.dat"
DRAWING = ("0 SYNTH SYNTHESIZED BEGIN", "{}", "0 SYNTH SYNTHESIZED END")


def lines_of(*lines: str) -> list[int]:
    """Lines whose parts a plan has."""
    return [placed.line for placed in plan_of(*lines).parts]


def test_page_has_the_table() -> None:
    text = PAGE.read_text(encoding="utf-8")
    for meaning in Meaning:
        words: dict[str, list[str]] = {}
        for command in META_COMMANDS:
            if command.meaning is meaning:
                words.setdefault(command.program, []).append(f"`{command.words}`")
        said = "; ".join(f"{program}: {', '.join(rows)}" for program, rows in words.items())
        assert f"| {said} | {meaning.value} |\n" in text
    assert ", ".join(f"`{name}`" for name, kind in SYNTH_KINDS.items() if kind.is_of_parts) in text


@pytest.mark.parametrize(
    ("lines", "kept"),
    [
        (
            [BEAM, "0 BUFEXCHG A STORE", SPARE, "0 STEP", "0 BUFEXCHG A RETRIEVE", pin(0, 10, 0)],
            [1, 6],
        ),
        (
            [
                BEAM,
                "0 BUFEXCHG A STORE",
                SPARE,
                "0 BUFEXCHG A RETRIEVE",
                SPARE,
                "0 BUFEXCHG A RETRIEVE",
            ],
            [1],
        ),
        (
            [
                BEAM,
                "0 BUFEXCHG A STORE",
                SPARE,
                "0 BUFEXCHG B STORE",
                SPARE,
                "0 BUFEXCHG A RETRIEVE",
            ],
            [1],
        ),
        # What B saw comes back, although A took it away.
        (
            [
                BEAM,
                "0 BUFEXCHG A STORE",
                SPARE,
                "0 BUFEXCHG B STORE",
                "0 BUFEXCHG A RETRIEVE",
                "0 BUFEXCHG B RETRIEVE",
            ],
            [1, 3],
        ),
        ([BEAM, "0 BUFEXCHG C RETRIEVE", SPARE], [1, 3]),
    ],
)
def test_buffer_restores_what_it_stored(lines: list[str], kept: list[int]) -> None:
    assert lines_of(*lines) == kept


@pytest.mark.parametrize(
    ("begin", "end"),
    [
        ("0 !LPUB PART BEGIN IGN", "0 !LPUB PART END"),
        ("0 LPUB PART BEGIN IGN", "0 LPUB PART END"),
        ("0 MLCAD SKIP_BEGIN", "0 MLCAD SKIP_END"),
        ('0 !LPUB BUILD_MOD BEGIN "key"', "0 !LPUB BUILD_MOD END_MOD"),
    ],
)
def test_ignored_lines_are_no_parts(begin: str, end: str) -> None:
    assert lines_of(BEAM, begin, SPARE, "4 16 0 0 0 1 0 0 0 1 0 0 0 1", "1 0 0", end, BEAM) == [
        1,
        7,
    ]
    with pytest.raises(
        PlanError, match=f"line 2: no {end.replace('0 LPUB', '0 !LPUB')} follows; write it after"
    ):
        plan_of(BEAM, begin, SPARE)


def test_lines_that_are_no_parts_end_with_their_own_end() -> None:
    begin, end = "0 !LPUB PART BEGIN IGN", "0 !LPUB PART END"
    nested = ["0 MLCAD SKIP_BEGIN", SPARE, "0 MLCAD SKIP_END"]
    assert lines_of(BEAM, begin, *nested, SPARE, end, pin(0, 10, 0)) == [1, 8]


def test_of_a_modification_the_original_is_the_model() -> None:
    begin, end = '0 !LPUB BUILD_MOD BEGIN "key"', "0 !LPUB BUILD_MOD END"
    middle = "0 !LPUB BUILD_MOD END_MOD"
    assert lines_of(BEAM, begin, SPARE, middle, pin(0, 10, 0), end, SPARE) == [1, 5, 7]


@pytest.mark.parametrize(
    "words", [command.words for command in META_COMMANDS if command.meaning is Meaning.PICTURE]
)
def test_what_is_for_pictures_changes_no_part_and_is_no_title(words: str) -> None:
    plan = plan_of(f"0 {words} END 1 2 3", BEAM, f"0 {words} BEGIN", BEAM)
    assert (len(plan.parts), len(plan.steps), plan.title, plan.faults) == (2, 1, "try", ())


@pytest.mark.parametrize("begin", ["0 MLCAD HIDE ", "0 GHOST 0 MLCAD HIDE ", "0 !: "])
def test_hidden_part_is_a_comment(begin: str) -> None:
    assert lines_of(BEAM, begin + SPARE) == [1]


def test_ghost_is_a_part_of_the_first_model_alone() -> None:
    below = BEAM.replace("32316.dat", "b.ldr")
    models = ["0 FILE a.ldr", BEAM, f"0 GHOST {SPARE}", below]
    models += ["0 FILE b.ldr", pin(0, 10, 0), f"0 GHOST {SPARE}"]
    assert sorted(lines_of(*models)) == [2, 3, 6]
    links = [f"0 GHOST {LINK.format(16 * number)}" for number in range(6)]
    chain = ["0 SYNTH BEGIN CHAIN 0", DRAWING[0], *links, DRAWING[2], "0 SYNTH END"]
    assert len(plan_of(BEAM, *chain).parts) == 7


@pytest.mark.parametrize("generator", ["FLEXHOSE", "RUBBER_BELT", "SPRING"])
def test_what_mlcad_generates_is_one_piece_of_its_model(generator: str) -> None:
    strange = SPARE.replace("32316", "no_part")
    drawing = ["0 MLCAD SKIP_BEGIN", *[SEGMENT] * 9, "0 MLCAD SKIP_END"]
    plan = plan_of(BEAM, strange, f"0 MLCAD {generator} 1 2", *drawing, pin(0, 10, 0))
    assert [placed.line for placed in plan.parts] == [1, 15]
    assert [unknown.number for unknown in plan.unknown] == ["no_part"]
    assert plan.drawn == (3,)


@pytest.mark.parametrize("name", [name for name, kind in SYNTH_KINDS.items() if kind.is_of_parts])
def test_band_of_links_is_its_links(name: str) -> None:
    links = [LINK.format(16 * number) for number in range(6)]
    plan = plan_of(BEAM, f"0 SYNTH BEGIN {name} 0", DRAWING[0], *links, DRAWING[2], "0 SYNTH END")
    assert [placed.part.number for placed in plan.parts] == ["32316", *["3711"] * 6]
    assert plan.drawn == ()
    assert plan.undrawn == ()


@pytest.mark.parametrize("name", SYNTH_KINDS)
def test_links_that_lsynth_has_not_drawn_are_said_to_be_missing(name: str) -> None:
    plan = plan_of(BEAM, f"0 SYNTH BEGIN {name} 0", "0 SYNTH END")
    assert plan.drawn == (2,)
    # A band of rubber is one piece, drawn or not.
    expected = [2] if SYNTH_KINDS[name].is_of_parts else []
    assert [lack.line for lack in plan.undrawn] == expected
    found = [finding for finding in check(plan) if finding.name == "not drawn"]
    assert [finding.line for finding in found] == expected
    for finding in found:
        assert f"the parts of this {name.lower()} yet" in finding.detail


@pytest.mark.parametrize(
    "name",
    [
        "RUBBER_BAND",
        "STRING_BAND",
        "TECHNIC_TREAD",
        "TECHNIC_PNEUMATIC_HOSE",
        "HOSE_FLEXIBLE_12L",
        "MY_HOSE",
    ],
)
def test_band_or_hose_of_one_piece_is_one(name: str) -> None:
    plan = plan_of(
        BEAM,
        f"0 SYNTH BEGIN {name} 0",
        SEGMENT,
        "0 SYNTHESIZED BEGIN",
        SEGMENT,
        SPARE,
        "0 SYNTHESIZED END",
        "0 SYNTH END",
    )
    assert (lines_of(BEAM), plan.unknown, plan.drawn) == ([1], (), (2,))


def test_gears_within_a_band_are_parts() -> None:
    gear = "1 7 0 -54 -20 1 0 0 0 1 0 0 0 1 4019.DAT"
    band = ["0 SYNTH BEGIN TECHNIC_CHAIN_LINK 0", gear, "0 SYNTH INSIDE", SEGMENT, "0 SYNTH END"]
    assert [placed.part.number for placed in plan_of(BEAM, *band).parts] == ["32316", "94925"]
    hose = [
        "0 SYNTH BEGIN TECHNIC_FLEX-SYSTEM_HOSE 0",
        gear,
        "0 SYNTH SHOW",
        gear,
        "0 SYNTH HIDE",
        gear,
        "0 SYNTH END",
    ]
    assert lines_of(BEAM, *hose) == [1, 5]


def test_substituted_segments_are_one_piece_and_parts_stay() -> None:
    begin, end = "0 !LPUB PLI BEGIN SUB hose.dat 4", "0 !LPUB PLI END"
    hose = plan_of(BEAM, begin, *[SEGMENT] * 9, end)
    assert (len(hose.parts), hose.unknown, hose.drawn) == (1, (), (2,))
    parts = plan_of(BEAM, begin, SPARE, SEGMENT, end, pin(0, 10, 0))
    assert [placed.line for placed in parts.parts] == [1, 3, 6]
    assert lines_of(BEAM, "0 !LPUB PLI BEGIN IGN", SPARE, end) == [1, 3]


@pytest.mark.parametrize(
    "words",
    [
        "!LDCAD GENERATED [generator=LDCad]",
        "MLCAD RUBBER_BELT 1 2",
        "MLCAD SPRING 1",
        "MLCAD FLEXHOSE 1",
    ],
)
def test_drawn_model_is_one_piece(words: str) -> None:
    plan = plan_of(
        "0 FILE a.ldr",
        BEAM,
        BEAM.replace("32316.dat", "b.ldr"),
        "0 FILE b.ldr",
        f"0 {words}",
        *[SEGMENT] * 9,
    )
    assert (len(plan.parts), plan.unknown, plan.drawn) == (1, (), (3,))


def test_steps_are_those_of_both_kinds() -> None:
    assert (
        len(plan_of(BEAM, "0 ROTSTEP 0 90 0 REL", SPARE, "0 ROTSTEP END", "0 STEP", SPARE).steps)
        == 3
    )
