"""Parts lists: CSV, Rebrickable's CSV, BrickLink's XML.

Parts have LDraw's numbers; the shops number some of them otherwise. Colours have the shops' numbers."""

from __future__ import annotations

import csv
import io
from collections import Counter
from dataclasses import dataclass
from xml.sax.saxutils import escape

from bricktwin.plans.colours import Colour, colour_of
from bricktwin.plans.part import Part
from bricktwin.plans.plan import Plan

FORMATS = ("csv", "rebrickable", "bricklink")


@dataclass(frozen=True)
class Entry:
    """Parts of one kind and colour."""

    part: Part
    colour: Colour
    count: int

    @property
    def mass_g(self) -> float:
        """Total mass, grams."""
        return self.part.mass_g * self.count


def parts_list(plan: Plan) -> list[Entry]:
    """The parts of a plan by family, highest count first."""
    counts = Counter((placed.part, placed.colour) for placed in plan.parts)
    entries = [Entry(part, colour_of(code), count) for (part, code), count in counts.items()]
    families = list(dict.fromkeys(entry.part.family for entry in sorted(entries, key=lambda entry: -entry.mass_g)))
    entries.sort(key=lambda entry: (families.index(entry.part.family), -entry.count, entry.part.name, entry.colour.code))
    return entries


def as_text(entries: list[Entry], kind: str) -> str:
    """A parts list in one of ``FORMATS``."""
    if kind == "bricklink":
        return _bricklink(entries)
    if kind == "rebrickable":
        return _table(
            ["Part", "Color", "Quantity"], [[entry.part.number, entry.colour.rebrickable, entry.count] for entry in entries]
        )
    heads = ["number", "name", "colour", "count", "mass_g", "mass_source"]
    rows = [
        [
            entry.part.number,
            entry.part.name,
            entry.colour.name,
            entry.count,
            round(entry.mass_g, 3),
            entry.part.mass_source.value,
        ]
        for entry in entries
    ]
    return _table(heads, rows)


def _table(heads: list[str], rows: list[list[str | int | float]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows(rows)
    return text.getvalue()


def _bricklink(entries: list[Entry]) -> str:
    """A wanted list for upload; a colour without a BrickLink number is left open."""
    lines = ["<INVENTORY>"]
    for entry in entries:
        colour = f"<COLOR>{entry.colour.bricklink}</COLOR>" if entry.colour.bricklink else ""
        item = f"<ITEMTYPE>P</ITEMTYPE><ITEMID>{escape(entry.part.number)}</ITEMID>{colour}<MINQTY>{entry.count}</MINQTY>"
        lines.append(f"  <ITEM>{item}</ITEM>")
    return "\n".join([*lines, "</INVENTORY>"]) + "\n"
