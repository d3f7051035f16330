"""Sub-models in files beside a plan."""

from __future__ import annotations

from pathlib import Path

import pytest
from plan_lines import BEAM, pin

from brickhub.errors import PlanError
from bricktwin.plans.check import check
from bricktwin.plans.ldraw_text import sources_of
from bricktwin.plans.plan import read_plan

OTHER = "1 72 0 20 0 1 0 0 0 1 0 0 0 1 {}"
REAR = OTHER.format("32316.dat").replace("0 20 0", "0 0 0", 1)


def written(folder: Path, name: str, *lines: str) -> Path:
    """A file with these lines."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize(
    ("placed", "file"),
    [
        ("rear.ldr", "rear.ldr"),
        ("REAR.LDR", "rear.ldr"),
        ("rear.ldr", "Rear.LDR"),
        ("rear half.ldr", "rear half.ldr"),
        ('"rear half.ldr"', "Rear  half.ldr"),
        ("s\\rear.ldr", "s/rear.ldr"),
        ("sub/deep/rear.ldr", "Sub/Deep/rear.ldr"),
        ("rear.mpd", "rear.mpd"),
        ("rear.dat", "rear.dat"),
        (".\\rear.ldr", "rear.ldr"),
    ],
)
def test_model_is_found_beside_the_plan(tmp_path: Path, placed: str, file: str) -> None:
    written(tmp_path, file, "0 the rear", "0 STEP", REAR)
    plan = read_plan(
        written(tmp_path, "plan.ldr", BEAM, pin(0, 10, 20), pin(0, 10, -20), OTHER.format(placed))
    )
    assert [part.line for part in plan.parts] == [1, 2, 3, 4] or [
        part.line for part in plan.parts
    ] == [4, 1, 2, 3]
    assert (plan.unknown, len(plan.steps), check(plan)) == ((), 1, [])


@pytest.mark.parametrize(
    "name",
    [
        "../rear.ldr",
        "..\\rear.ldr",
        "{}/rear.ldr",
        "sub/../../rear.ldr",
        "link.ldr",
        "notes.txt",
        "sub",
    ],
)
def test_nothing_outside_of_the_folder_is_read(tmp_path: Path, name: str) -> None:
    outside = written(tmp_path, "rear.ldr", BEAM)
    written(tmp_path, "car/notes.txt", BEAM)
    written(tmp_path, "car/sub/x.ldr", BEAM)
    (tmp_path / "car" / "link.ldr").symlink_to(outside)
    plan = read_plan(written(tmp_path, "car/plan.ldr", BEAM, OTHER.format(name.format(tmp_path))))
    assert (len(plan.parts), len(plan.unknown)) == (1, 1)


def test_missing_file_says_what_to_do(tmp_path: Path) -> None:
    plan = read_plan(written(tmp_path, "plan.ldr", BEAM, OTHER.format("rear.ldr")))
    (found,) = check(plan)
    assert (found.line, found.name) == (2, "missing file")
    assert (
        "rear.ldr (once) is a model in a file of its own, which is not beside the plan; put it "
        "there, or join both"
    ) in found.detail


def test_models_of_two_files_may_have_one_name(tmp_path: Path) -> None:
    for name, part in (("left", "32316"), ("right", "32524")):
        inner = OTHER.format(f"{part}.dat")
        written(
            tmp_path,
            f"{name}.mpd",
            "0 FILE main.ldr",
            OTHER.format("leg.ldr"),
            "0 FILE leg.ldr",
            inner,
            inner,
        )
    plan = read_plan(
        written(
            tmp_path,
            "plan.ldr",
            OTHER.format("left.mpd"),
            OTHER.format("right.mpd"),
            OTHER.format("left.mpd"),
        )
    )
    assert [part.part.number for part in plan.parts] == ["32316"] * 2 + ["32524"] * 2 + [
        "32316"
    ] * 2
    assert len({part.assembly for part in plan.parts}) == 3


def test_file_in_a_folder_finds_what_is_beside_it(tmp_path: Path) -> None:
    written(
        tmp_path,
        "sub/a.ldr",
        OTHER.format("b.ldr"),
        OTHER.format("c.ldr"),
        OTHER.format("../c.ldr"),
    )
    written(tmp_path, "sub/b.ldr", BEAM)
    written(tmp_path, "c.ldr", pin(0, 0, 0))
    plan = read_plan(written(tmp_path, "plan.ldr", OTHER.format("sub/a.ldr")))
    assert [part.part.number for part in plan.parts] == ["32316", "2780", "2780"]


@pytest.mark.parametrize("other", ["plan.ldr", "PLAN.LDR", "a.ldr"])
def test_cycle_of_files_raises(tmp_path: Path, other: str) -> None:
    written(tmp_path, "a.ldr", BEAM, OTHER.format(other))
    with pytest.raises(PlanError, match=f"^a.ldr, line 2: '{other}' would be nested in itself"):
        read_plan(written(tmp_path, "plan.ldr", OTHER.format("a.ldr")))


def test_cycle_over_several_files_names_the_line_that_closes_it(tmp_path: Path) -> None:
    written(tmp_path, "a.ldr", OTHER.format("b.ldr"))
    written(tmp_path, "b.ldr", BEAM, BEAM, OTHER.format("c.ldr"))
    written(tmp_path, "c.ldr", "0 a title", OTHER.format("a.ldr"))
    with pytest.raises(PlanError, match="^c.ldr, line 2: 'a.ldr' would be nested in itself"):
        read_plan(written(tmp_path, "plan.ldr", BEAM, OTHER.format("a.ldr")))


@pytest.mark.parametrize("content", ["", "0 a title", "0 a title\n0 STEP\n", "0 STEP\n\n\n"])
def test_file_without_parts_is_a_finding(tmp_path: Path, content: str) -> None:
    """Once for each line that places it."""
    written(tmp_path, "rear.ldr", content)
    plan = read_plan(written(tmp_path, "plan.ldr", BEAM, *[OTHER.format("rear.ldr")] * 2))
    said = [(each.line, each.detail) for each in check(plan) if "rear.ldr" in each.detail]
    assert [line for line, _ in said] == [2, 3]
    assert "'rear.ldr' has no parts" in said[0][1]


def test_mistake_in_another_file_names_it(tmp_path: Path) -> None:
    written(tmp_path, "a.ldr", BEAM, "1 4 0 0 zero 1 0 0 0 1 0 0 0 1 32316.dat")
    plan = read_plan(
        written(tmp_path, "plan.ldr", BEAM, OTHER.format("a.ldr"), OTHER.format("a.ldr"))
    )
    assert [(fault.line, fault.text) for fault in plan.faults] == [
        (2, "in a.ldr, line 2: cannot place a part; write 1, a colour, 12 numbers and a file")
    ]
    written(tmp_path, "a.ldr", "\0" * 9)
    with pytest.raises(PlanError, match="a.ldr is not a text file"):
        read_plan(tmp_path / "plan.ldr")


def test_plan_is_made_anew_when_a_file_beside_it_changes(tmp_path: Path) -> None:
    written(tmp_path, "a.ldr", BEAM)
    plan = written(tmp_path, "plan.ldr", OTHER.format("a.ldr"))
    before = list(sources_of(plan))
    written(tmp_path, "a.ldr", spare := BEAM.replace("32316", "32524"))
    assert spare.encode() in list(sources_of(plan)) != before
    assert next(sources_of(plan)) == b"plan.ldr"


def test_embedded_model_and_part_come_before_a_file(tmp_path: Path) -> None:
    written(tmp_path, "leg.ldr", pin(0, 0, 0))
    written(tmp_path, "32316.dat", pin(0, 0, 0))
    plan = written(
        tmp_path,
        "plan.mpd",
        "0 FILE main.ldr",
        OTHER.format("leg.ldr"),
        BEAM,
        "0 FILE leg.ldr",
        BEAM,
        BEAM,
    )
    assert [part.part.number for part in read_plan(plan).parts] == ["32316"] * 3
