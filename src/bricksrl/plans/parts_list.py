"""Parts lists: CSV, Rebrickable's CSV, BrickLink's XML."""

from __future__ import annotations

import csv
import io
from collections import Counter
from dataclasses import dataclass
from xml.sax.saxutils import escape

from bricksrl.plans.colours import Colour, colour_of
from bricksrl.plans.part import Part
from bricksrl.plans.plan import Plan

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
    return sorted(entries, key=lambda one: (families.index(one.part.family), -one.count, one.part.name, one.colour.code))


def as_text(entries: list[Entry], kind: str) -> str:
    """A parts list in one of ``FORMATS``."""
    if kind == "bricklink":
        return _bricklink(entries)
    if kind == "rebrickable":
        return _table(["Part", "Color", "Quantity"], [[one.part.number, one.colour.code, one.count] for one in entries])
    heads = ["number", "name", "colour", "count", "mass_g", "mass_source", "bricklink", "rebrickable"]
    rows = [
        [
            one.part.number,
            one.part.name,
            one.colour.name,
            one.count,
            round(one.mass_g, 3),
            one.part.mass_source.value,
            one.part.number,
            one.part.number,
        ]
        for one in entries
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
    for one in entries:
        colour = f"<COLOR>{one.colour.bricklink}</COLOR>" if one.colour.bricklink else ""
        item = f"<ITEMTYPE>P</ITEMTYPE><ITEMID>{escape(one.part.number)}</ITEMID>{colour}<MINQTY>{one.count}</MINQTY>"
        lines.append(f"  <ITEM>{item}</ITEM>")
    return "\n".join([*lines, "</INVENTORY>"]) + "\n"
