"""``bricktwin plan``."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest

from bricktwin.cli import main
from bricktwin.cli.plan_commands import _PageNotes
from bricktwin.robots import plans

NAME_A_PLAN = "name an LDraw file (.ldr, .mpd or .io)"
PLAN = str(Path(plans.__path__[0]) / "two_wheeler.ldr")


def test_one_page_a_second_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    notes = _PageNotes()
    notes(0, 0)
    notes(1, 9)
    notes(2, 9)  # so soon after that it is not said
    notes.said_s -= 1.0
    notes(3, 9)
    assert capsys.readouterr().err.splitlines() == [
        "finding steps in which it can be built",
        "page 1 of 9",
        "page 3 of 9",
    ]


def test_correct_plan_passes(bricktwin):
    done = bricktwin("plan", "check", PLAN)
    assert (done.code, done.err) == (0, "")
    assert done.out.splitlines() == [
        "it stands: its centre of mass is 49 mm high, 14 mm inside of its wheels",
        "36 parts of 11 kinds, 11 steps, 428 g: all is well",
    ]


def test_robots_have_plans(bricktwin):
    assert bricktwin("plan", "check", "two-wheeler").out == bricktwin("plan", "check", PLAN).out
    assert (
        "there is no robot 'two-wheels'; choose one of"
        in bricktwin("plan", "check", "two-wheels").err
    )
    assert (
        "bench has no building plan; name an LDraw file" in bricktwin("plan", "check", "bench").err
    )


def test_folder_of_the_name_of_a_robot_is_no_plan(tmp_path, monkeypatch, capsys):
    (tmp_path / "walker").mkdir()
    monkeypatch.chdir(tmp_path)
    assert main(["plan", "check", "walker"]) == 0
    assert capsys.readouterr().out.endswith("all is well\n")


def test_folder_in_place_of_a_plan_is_named(fails, tmp_path, monkeypatch):
    (tmp_path / "plans.d").mkdir()
    monkeypatch.chdir(tmp_path)
    for folder in (".", "plans.d", str(tmp_path)):
        says = (
            f"{folder} is a folder; name an LDraw file in it (.ldr, .mpd or .io), or a robot: "
            "two-wheeler, walker, robo-arm"
        )
        fails("plan", "check", folder, says=f"error: {says}")


def test_plan_of_one_part(bricktwin, tmp_path):
    path = tmp_path / "one.ldr"
    path.write_text("0 STEP\n1 0 0 0 0 1 0 0 0 1 0 0 0 1 32316.dat\n", encoding="utf-8")
    assert (
        bricktwin("plan", "check", str(path))
        .out.splitlines()[-1]
        .startswith("1 part of 1 kind, 1 step, ")
    )


def test_mistake_has_line_and_exit_code(bricktwin, tmp_path):
    path = tmp_path / "my.ldr"
    path.write_text(
        Path(PLAN).read_text(encoding="utf-8").replace("!BRICKSRL PORT E", "!BRICKSRL PORT A"),
        encoding="utf-8",
    )
    done = bricktwin("plan", "check", str(path))
    assert done.code == 1
    assert any(
        line.startswith("line ") and "give each its own" in line for line in done.out.splitlines()
    )


def test_robot_that_tips_over_is_told_why(bricktwin, tmp_path):
    lines = Path(PLAN).read_text(encoding="utf-8").splitlines()
    unwanted = ("39370", "!BRICKSRL ROBOT", "!BRICKSRL PARTS")
    path = tmp_path / "my.ldr"
    path.write_text("\n".join(line for line in lines if not any(map(line.count, unwanted))))
    done = bricktwin("plan", "check", str(path))
    assert done.code == 1
    assert "the plan  balance       it tips over backwards" in done.out
    assert "it stands" not in done.out


def test_parts_for_shops(bricktwin, tmp_path):
    listed = bricktwin("plan", "parts", PLAN).out
    assert "  18 x  2780      black" in listed
    assert "Set 45678 SPIKE Prime: 37 of 37 parts\n" in listed
    table, wanted, sets = (
        tmp_path / "parts.csv",
        tmp_path / "wanted.xml",
        tmp_path / "rebrickable.csv",
    )
    bricktwin("plan", "parts", PLAN, "--out", str(table))
    bricktwin("plan", "parts", PLAN, "--out", str(wanted), "--format", "bricklink")
    bricktwin("plan", "parts", PLAN, "--out", str(sets), "--format", "rebrickable")
    rows = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
    assert list(rows[0]) == ["number", "name", "colour", "count", "mass_g", "mass_source"]
    assert sum(int(row["count"]) for row in rows) == 36
    assert sum(float(row["mass_g"]) for row in rows) == pytest.approx(428, abs=0.5)
    counts = re.findall(r"<MINQTY>(\d+)</MINQTY>", wanted.read_text(encoding="utf-8"))
    assert sum(map(int, counts)) == 36
    assert {
        row["Part"]: row["Quantity"]
        for row in csv.DictReader(sets.read_text(encoding="utf-8").splitlines())
    }["2780"] == "18"


def test_what_is_missing_from_own_sets(bricktwin, fails, tmp_path):
    alone = bricktwin("plan", "parts", "walker", "--own", "45678").out.splitlines()
    assert [line.split()[:3] for line in alone[:2]] == [["2", "x", "45603"], ["12", "x", "3673"]]
    assert alone[2].startswith("14 of 84 parts")
    wanted = tmp_path / "wanted.xml"
    both = bricktwin(
        "plan",
        "parts",
        "walker",
        "--own",
        "45678,45681",
        "--out",
        str(wanted),
        "--format",
        "bricklink",
    ).out
    assert "Set 45678 SPIKE Prime and 45681 SPIKE Prime expansion: 82 of 84 parts" in both
    assert re.findall(r"<MINQTY>(\d+)</MINQTY>", wanted.read_text(encoding="utf-8")) == ["2"]
    assert "0 of 84 parts" in bricktwin("plan", "parts", "walker", "--own", "45678,45681,45678").out
    says = (
        "error: there is no inventory of set '45345'; name sets of 45678, 45681, 31313, "
        "45544, 45560, with commas between them"
    )
    fails("plan", "parts", "walker", "--own", "45345", says=says)
    fails("plan", "parts", "--own", "45678", says="error: --own needs a plan; name an LDraw file")


def test_drawn_cables_and_lines_left_out_are_listed(bricktwin, tmp_path):
    path, place = tmp_path / "hose.ldr", "1 0 0 0 0 1 0 0 0 1 0 0 0 1"
    path.write_text(
        f"{place} 32316.dat\n0 SYNTH BEGIN HOSE 0\n{place} LS01.dat\n0 SYNTH END\n1 0 0\n",
        encoding="utf-8",
    )
    listed = bricktwin("plan", "parts", str(path)).out
    assert (
        "   1 x  drawn cable, hose or chain, without a number\nline 5 is left out: "
        "cannot place a part; write 1,"
    ) in listed


def test_the_catalogue(bricktwin):
    done = bricktwin("plan", "parts")
    assert "2780      pins            0.19 g  Pin with friction" in done.out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (
            ["check", "no.ldr"],
            f"error: no.ldr: No such file or directory in {Path.cwd()}; {NAME_A_PLAN}",
        ),
        (
            ["steps", PLAN, "--out", "plan.doc"],
            "error: plan.doc: a booklet is a .pdf or .html file; name one of these",
        ),
        (
            ["parts", PLAN, "--format", "bricklink"],
            "error: --format has no effect without --out; omit it",
        ),
        (
            ["parts", PLAN, "--out", "parts.ods"],
            "error: 'parts.ods' is not a name of a parts list in the format csv; end it in .csv",
        ),
        (
            ["parts", PLAN, "--out", "a.csv", "--format", "bricklink"],
            "error: 'a.csv' is not a name of a parts list in the format bricklink; end it in .xml",
        ),
        (["parts", "--out", "parts.csv"], "error: --out needs a plan; name an LDraw file"),
    ],
)
def test_errors_print_one_line(bricktwin, arguments, says):
    done = bricktwin("plan", *arguments)
    assert (done.code, done.err) == (2, f"{says}\n")


def test_progress_of_a_booklet_is_told(bricktwin, tmp_path, monkeypatch):
    monkeypatch.setattr("bricktwin.plans.booklet.pages.DPI", 60)
    plan = tmp_path / "beam.ldr"
    plan.write_text("0 Beam\n1 4 0 0 0 1 0 0 0 1 0 0 0 1 32316.dat\n")
    done = bricktwin("plan", "steps", str(plan), "--out", str(tmp_path / "beam.pdf"))
    assert done.out == f"3 pages: {tmp_path / 'beam.pdf'}\n"
    first, second, *_ = done.err.splitlines()
    assert first == "finding steps in which it can be built" and second == "page 1 of 3"
