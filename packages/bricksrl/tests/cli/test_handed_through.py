"""Commands of bricktwin under ``bricksrl``."""

from __future__ import annotations

from pathlib import Path

from bricksrl.cli import main


def test_plan_is_checked_as_by_bricktwin(capfd) -> None:
    assert main(("plan", "check", "two-wheeler")) == 0
    written = capfd.readouterr()
    assert written.out.endswith("\n36 parts of 11 kinds, 11 steps, 428 g: all is well\n")
    assert written.err == ""


def test_errors_print_one_line(fails) -> None:
    fails("plan", "check", "two-wheels", says="there is no robot 'two-wheels'; choose one of")
    fails(
        "plan",
        "check",
        "no.ldr",
        says=f"no.ldr: No such file or directory in {Path.cwd()}; name an LDraw file",
    )
    fails("plan", "parts", "--out", "parts.csv", says="--out needs a plan; name an LDraw file")
    fails("twin", "fit", "nothing.jsonl", says="cannot read the log")


def test_help_spells_the_command_as_it_was_called(bricksrl) -> None:
    for command in ("plan check", "plan parts", "plan steps", "twin record", "twin fit"):
        told = bricksrl(*command.split(), "--help").stdout
        assert f"\n  bricksrl {command} " in told and "bricktwin" not in told
    assert "bricktwin" not in bricksrl("twin", "--help").stdout
