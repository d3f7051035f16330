"""``bricktwin plan``: check a building plan, list its parts, draw its booklet."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional

from brickhub.cli.terminal import print_line, print_note
from brickhub.errors import PlanError, counted
from brickhub.files import write_durably
from brickhub.options import option, refuse_ignored
from bricktwin import robots
from bricktwin.plans import catalogue
from bricktwin.plans.booklet.parts_list import as_text, owned, parts_list, purchases, still_needed
from bricktwin.plans.check import check
from bricktwin.plans.plan import Plan, read_plan
from bricktwin.robots.planned import check_named, plan_file, without_stops

_ROBOTS = "two-wheeler, walker, robo-arm, ev3-driver"
_PLAN = f"An LDraw file (.ldr, .mpd), Studio's .io, or a robot: {_ROBOTS}."
PlanArgument = Annotated[Positional[Path], option(metavar="FILE", help=_PLAN)]


def read_named_plan(path: Path) -> Plan:
    """The plan in a file, or that of a robot of this package."""
    if path.is_dir() and str(path) not in robots.ROBOTS:
        raise PlanError(
            f"{path} is a folder; name an LDraw file in it (.ldr, .mpd or .io), or a robot: "
            f"{_ROBOTS}"
        )
    if path.is_file() or path.suffix:
        return read_plan(path)
    robot = robots.get(str(path))
    file = plan_file(robot.model or "")
    if file is None:
        raise PlanError(
            f"{robot.name} has no building plan; name an LDraw file (.ldr, .mpd or .io)"
        )
    return read_plan(file)


def _print_faults(plan: Plan) -> None:
    """Print which lines of the file are left out."""
    for fault in plan.faults:
        print_line(f"line {fault.line} is left out: {fault.text}")


@dataclass(frozen=True)
class CheckPlan:
    """Check a building plan: unknown, loose and half-held parts, collisions, gears, steps, ports,
    cables.

    One line per finding, with the line of the file and advice; exit code 1 if there are any.

    Examples:
      bricktwin plan check two-wheeler
      bricktwin plan check my_robot.mpd
    """

    plan: PlanArgument

    def execute(self) -> int:
        plan = read_named_plan(self.plan)
        # Models import MuJoCo, which no other command of plans needs.
        from bricktwin.twin.models.balance import plan_balance, plan_stance

        balance = plan_balance(plan)
        findings = check(plan) + check_named(plan) + plan_stance(plan)
        for finding in findings:
            location = f"line {finding.line}" if finding.line else "the plan"
            print_line(f"{location:9} {finding.name:13} {finding.detail}")
        # Most motors need no stop, so this is information and no fault.
        free = without_stops(plan)
        if free:
            remedy = (
                "for one that homes a motor by stalling, write 0 !BRICKSRL STOPS LOW HIGH "
                "before the motor"
            )
            print_line(
                f"nothing stops {counted(len(free), 'motor')} ({', '.join(free)}) in a twin; "
                f"{remedy}"
            )
        if balance is not None and balance.fault is None:
            print_line(f"it stands: {balance}")
        kinds = len({placed.part for placed in plan.parts})
        parts = counted(len(plan.parts), "part")
        steps = counted(len(plan.different_steps), "step")
        summary = f"{parts} of {counted(kinds, 'kind')}, {steps}, {plan.mass_g:.0f} g"
        if findings:
            print_line(f"{summary}: {counted(len(findings), 'finding')}")
            return 1
        print_line(f"{summary}: all is well")
        return 0


_ENDINGS = {"csv": ".csv", "rebrickable": ".csv", "bricklink": ".xml"}
"""Endings of the files of parts by format: by its ending a spreadsheet or a shop knows a file."""


@dataclass(frozen=True)
class PlanParts:
    """List the parts of a building plan, as a table or as a file for part shops, and the sets that
    contain its electronics.

    Without a plan, list the catalogue.

    Examples:
      bricktwin plan parts two-wheeler
      bricktwin plan parts two-wheeler --out parts.csv
      bricktwin plan parts two-wheeler --format bricklink --out wanted.xml
      bricktwin plan parts walker --own "45678,45681"
      bricktwin plan parts
    """

    plan: Annotated[Positional[Path | None], option(metavar="FILE", help=_PLAN)] = None
    out: Annotated[Path | None, option(metavar="FILE")] = None
    """File to write."""
    format: Literal["csv", "rebrickable", "bricklink"] = "csv"
    """Format of the file: a table with masses, Rebrickable's CSV, or BrickLink's wanted list in
    XML."""
    own: Annotated[str | None, option(metavar="SET[,SET]")] = None
    """LEGO sets that you have, such as 45678,45681: list what is missing, with the numbers of
    shops."""

    def execute(self) -> None:
        if self.out is None:
            refuse_ignored(self, ("--plan", "--own"), "without --out")
        elif self.out.suffix.lower() != _ENDINGS[self.format]:
            raise PlanError(
                f"'{self.out}' is not a name of a parts list in the format {self.format}; end it "
                f"in {_ENDINGS[self.format]}"
            )
        if self.plan is None:
            self._print_catalogue()
            return
        plan = read_named_plan(self.plan)
        entries = parts_list(plan)
        advice = purchases(plan)
        if self.own is not None:
            advice = [owned(plan, self.own.split(","))]
            entries = still_needed(entries, advice[0].missing)
        if self.out is not None:
            write_durably(self.out, as_text(entries, self.format).encode())
        else:
            for entry in entries:
                # What has to be bought is listed in its colour by the number that shops use.
                number = entry.part.number if self.own is None else entry.shop_number
                name = entry.part.name
                colour = entry.colour.name
                print_line(
                    f"{entry.count:4} x  {number:10}{colour:20}{entry.mass_g:8.2f} g  {name}"
                )
        # The formats of shops have no place for unknown parts, but a reader needs to know of them.
        for unknown in plan.unknown:
            fault = "not in the catalogue"
            if unknown.is_file:
                fault = "a file that is not beside the plan"
            print_line(f"{len(unknown.lines):4} x  {unknown.number:10}{fault}")
        if plan.drawn:
            print_line(f"{len(plan.drawn):4} x  drawn cable, hose or chain, without a number")
        _print_faults(plan)
        total = f"{counted(len(plan.parts), 'part')}, {plan.mass_g:.0f} g"
        if self.own is not None:
            missing = sum(entry.count for entry in entries)
            total = f"{missing} of {total} to be added"
        if self.out:
            total = f"{total}: {self.out}"
        print_line(total)
        for purchase in advice:
            print_line(f"Set {purchase}")

    def _print_catalogue(self) -> None:
        """Print all parts of the catalogue. Raises PlanError if an option needs a plan."""
        for name, value in (("--out", self.out), ("--own", self.own)):
            if value is not None:
                raise PlanError(f"{name} needs a plan; name an LDraw file")
        for part in catalogue.parts():
            print_line(f"{part.number:10}{part.family:12}{part.mass_g:8.2f} g  {part.name}")


_SILENCE_S = 1.0
"""Longest time without a word while a booklet is drawn, in which a page or two are."""


@dataclass
class _PageNotes:
    """Notes of how far a booklet is, one a second."""

    said_s: float = 0.0

    def __call__(
        self,
        number: int,
        count: int,
    ) -> None:
        """Say that a page is drawn, unless something was said just now."""
        if not count:
            print_note("finding steps in which it can be built")
        now_s = time.monotonic()
        if number and now_s - self.said_s >= _SILENCE_S:
            self.said_s = now_s
            print_note(f"page {number} of {count}")


@dataclass(frozen=True)
class PlanSteps:
    """Draw the booklet of a building plan: cover, parts list, a page for each step, cables.

    Examples:
      bricktwin plan steps two-wheeler --out two_wheeler.pdf
      bricktwin plan steps my_robot.mpd --out my_robot.html
    """

    plan: PlanArgument
    out: Annotated[Path, option(metavar="FILE")]
    """The .pdf or .html to write."""

    def execute(self) -> None:
        from bricktwin.plans.booklet.sheets import write_booklet

        plan = read_named_plan(self.plan)
        _print_faults(plan)
        pages = write_booklet(plan, self.out, _PageNotes())
        print_line(f"{counted(pages, 'page')}: {self.out}")
