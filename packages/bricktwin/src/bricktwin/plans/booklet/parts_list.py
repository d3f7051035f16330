"""Parts lists as CSV, Rebrickable's CSV and BrickLink's XML, and the LEGO sets that have a plan's
hub and many of its parts.

Parts have LDraw's numbers; the shops number some of them otherwise. Colours have the shops'
numbers.
"""

import csv
import functools
import io
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from xml.sax.saxutils import escape

from brickhub.errors import PlanError
from brickhub.tables import read_table
from bricktwin.plans import catalogue
from bricktwin.plans.assemblies import components
from bricktwin.plans.catalogue import Colour, colour_of
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
    def shop_number(self) -> str:
        """LEGO's number of a device that is sold singly, else the part's."""
        device = self.part.device
        if device is not None and device.sold_as:
            return device.sold_as
        return self.part.number

    @property
    def mass_g(self) -> float:
        """Total mass, grams."""
        return self.part.mass_g * self.count


def parts_list(plan: Plan) -> list[Entry]:
    """The parts of a plan by family, highest count first."""
    counts = Counter((placed.part, placed.colour) for placed in plan.parts)
    entries = [Entry(part, colour_of(code), count) for (part, code), count in counts.items()]
    # Families are sorted by their heaviest entry, so that hubs and motors come before pins.
    heaviest_first = sorted(entries, key=lambda entry: -entry.mass_g)
    families = list(dict.fromkeys(entry.part.family for entry in heaviest_first))

    def order(entry: Entry) -> tuple[int, int, str, int]:
        # Name and colour order the entries that are needed equally often, so that the list is
        # always the same.
        family = families.index(entry.part.family)
        return family, -entry.count, entry.part.name, entry.colour.code

    return sorted(entries, key=order)


def as_text(entries: list[Entry], kind: str) -> str:
    """A parts list in one of ``FORMATS``."""
    if kind == "bricklink":
        return _bricklink(entries)
    rows: list[list[str | int | float]] = []
    if kind == "rebrickable":
        # Rebrickable needs these heads to recognise the columns of an uploaded list.
        for entry in entries:
            rows.append([entry.part.number, entry.colour.rebrickable, entry.count])
        return _table(["Part", "Color", "Quantity"], rows)
    heads = ["number", "name", "colour", "count", "mass_g", "mass_source"]
    for entry in entries:
        part = entry.part
        mass_g = round(entry.mass_g, 3)
        mass_source = part.mass_source.value
        rows.append([part.number, part.name, entry.colour.name, entry.count, mass_g, mass_source])
    return _table(heads, rows)


def _table(heads: list[str], rows: list[list[str | int | float]]) -> str:
    text = io.StringIO()
    # Lines end the same way on every system, so that the same plan makes the same bytes.
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows(rows)
    return text.getvalue()


def _bricklink(entries: list[Entry]) -> str:
    """A wanted list for upload; a colour without a BrickLink number is left open."""
    lines = ["<INVENTORY>"]
    for entry in entries:
        colour = ""
        if entry.colour.bricklink:
            colour = f"<COLOR>{entry.colour.bricklink}</COLOR>"
        part = f"<ITEMTYPE>P</ITEMTYPE><ITEMID>{escape(entry.part.number)}</ITEMID>"
        lines.append(f"  <ITEM>{part}{colour}<MINQTY>{entry.count}</MINQTY></ITEM>")
    return "\n".join([*lines, "</INVENTORY>"]) + "\n"


NAMES = {
    "45678": "SPIKE Prime",
    "51515": "MINDSTORMS Robot Inventor",
    "45681": "SPIKE Prime expansion",
    "17101": "BOOST",
    "31313": "MINDSTORMS EV3",
    "45544": "MINDSTORMS Education EV3",
    "45560": "MINDSTORMS Education EV3 expansion",
}
_ELECTRONICS_ONLY = {"51515", "17101"}
"""Sets of which the inventory has only hub, motors and sensors."""
_REPLACEMENTS = {"3704": "32062", "62821": "62821b"}
"""Parts that another one can replace: an axle by a notched one, a differential by its other
mould."""
_MAX_LISTED = 8
"""Largest number of kinds of missing parts that a line names."""


@dataclass(frozen=True)
class LegoSet:
    """A LEGO set.

    Attributes:
        parts: count of each part, as in ``needs``.
        is_listed: whether all of its parts in the catalogue are counted, not only hub, motors and
            sensors.
    """

    number: str
    name: str
    parts: Counter[str] = field(hash=False)
    is_listed: bool


@dataclass(frozen=True)
class Purchase:
    """Sets, and what a plan needs in addition.

    Attributes:
        present: number of the plan's parts in the sets.
        missing: parts to be added.
        uncompared: parts that the catalogue, or the inventory of a set, does not have.
    """

    sets: tuple[LegoSet, ...]
    present: int
    missing: Counter[str]
    uncompared: Counter[str]

    def __str__(self) -> str:
        """One line; names the devices and the most frequent parts, counts the others."""
        names = " and ".join(f"{lego_set.number} {lego_set.name}" for lego_set in self.sets)
        needed = self.present + self.missing.total() + self.uncompared.total()
        text = f"{names}: {self.present} of {needed} parts"
        if self.uncompared:
            text += f"; {self.uncompared.total()} not compared"
        # Devices are listed by names of their own, which the catalogue would not find.
        others = [kind for kind in self.uncompared if kind not in _devices()]
        unknown = sorted(kind for kind in others if catalogue.find(kind) is None)
        if unknown:
            text += f" (not in the catalogue: {', '.join(unknown)})"
        if self.missing:
            text += f"; add {_listing(self.missing)}"
        return text


@functools.cache
def sets() -> tuple[LegoSet, ...]:
    """The sets of ``inventories.csv``, which also names the sources."""
    # The table has a row for each part and a column for each set, so sets are read from its
    # columns.
    rows = read_table("bricktwin.plans.catalogue", "inventories")
    keys = [_key(catalogue.get(row["part"])) for row in rows]
    lego_sets: list[LegoSet] = []
    for number, name in NAMES.items():
        counts = [int(row[number]) for row in rows]
        # The unary plus drops parts with a count of 0, which a set does not have.
        parts = +Counter(dict(zip(keys, counts, strict=True)))
        is_listed = number not in _ELECTRONICS_ONLY
        lego_sets.append(LegoSet(number, name, parts, is_listed))
    return tuple(lego_sets)


def needs(plan: Plan) -> Counter[str]:
    """Count of the plan's parts: devices by their name in ``bricktwin.robots``, others by number,
    with equal parts as one."""
    # A part that a plan may draw as several pieces counts as these pieces.
    numbers: list[str] = []
    for placed in plan.parts:
        numbers += components().get(placed.part.number, (placed.part.number,))
    return Counter(_key(catalogue.get(number)) for number in numbers)


def purchases(plan: Plan) -> list[Purchase]:
    """Sets with the plan's hub, alone or with a set without hub that adds parts; the most complete
    first."""
    needed = needs(plan)
    unknown = Counter({part.number: len(part.lines) for part in plan.unknown})
    hubs = {name for name, part in _devices().items() if part.family == "hubs"}
    extras = [lego_set for lego_set in sets() if not hubs & set(lego_set.parts)]
    result = []
    for base in sets():
        has_hub = bool(hubs & set(base.parts) & set(needed))
        if not has_hub:
            continue
        alone = _purchase((base,), needed, unknown)
        result.append(alone)
        # A set without a full inventory may hold the other parts too; what it lacks is unknown.
        pairs = [_purchase((base, extra), needed, unknown) for extra in extras if base.is_listed]
        result += [pair for pair in pairs if pair.present > alone.present]
    return sorted(result, key=lambda purchase: (-purchase.present, len(purchase.sets)))


def owned(plan: Plan, numbers: Sequence[str]) -> Purchase:
    """The plan's parts in sets that somebody has; a number may occur twice. Raises PlanError for a
    set without an inventory."""
    known = {lego_set.number: lego_set for lego_set in sets() if lego_set.is_listed}
    for number in numbers:
        if number not in known:
            raise PlanError(
                f"there is no inventory of set '{number}'; name sets of {', '.join(known)}, with "
                "commas between them"
            )
    unknown = Counter({part.number: len(part.lines) for part in plan.unknown})
    return _purchase(tuple(known[number] for number in numbers), needs(plan), unknown)


def still_needed(entries: Iterable[Entry], missing: Counter[str]) -> list[Entry]:
    """The entries, with the counts that are missing; a missing part may have any of its colours."""
    # Parts are taken out as they are used, so that the next entry, of another colour, does not
    # count them again.
    left = Counter(missing)
    result = []
    for entry in entries:
        numbers = components().get(entry.part.number, (entry.part.number,))
        keys = [_key(catalogue.get(number)) for number in numbers]
        count = min(entry.count, max(left[key] for key in keys))
        left -= Counter(dict.fromkeys(keys, count))
        if count:
            result.append(replace(entry, count=count))
    return result


def _purchase(
    lego_sets: tuple[LegoSet, ...],
    needed: Counter[str],
    unknown: Counter[str],
) -> Purchase:
    """The parts of a plan that some sets have, and the missing ones. ``unknown`` are the plan's
    parts that the catalogue does not have."""
    available: Counter[str] = Counter()
    for lego_set in lego_sets:
        available += lego_set.parts
    missing = needed - available
    present = needed.total() - missing.total()
    if all(lego_set.is_listed for lego_set in lego_sets):
        return Purchase(
            lego_sets,
            present,
            missing,
            unknown,
        )
    # An inventory that lists electronics only does not say whether the set has the other parts.
    uncompared = Counter({part: count for part, count in missing.items() if part not in _devices()})
    return Purchase(
        lego_sets,
        present,
        missing - uncompared,
        uncompared + unknown,
    )


def _key(part: Part) -> str:
    """Key by which a part is compared: parts with equal keys can replace each other."""
    if part.device is not None:
        return part.device.name
    return _REPLACEMENTS.get(part.number, part.number)


@functools.cache
def _devices() -> dict[str, Part]:
    """Hubs, motors and sensors by their names in ``bricktwin.robots``."""
    return {part.device.name: part for part in catalogue.parts() if part.device is not None}


def _listing(parts: Counter[str]) -> str:
    """Counts, names and numbers."""
    # Devices come first, then the parts that are needed most. The part number settles ties.
    kinds = sorted(parts, key=lambda part: (part not in _devices(), -parts[part], part))
    text = ", ".join(f"{parts[kind]} x {_named(kind)}" for kind in kinds[:_MAX_LISTED])
    others = kinds[_MAX_LISTED:]
    if not others:
        return text
    count = sum(parts[kind] for kind in others)
    return f"{text} and {count} more of other kinds"


def _named(kind: str) -> str:
    if kind in _devices():
        part = _devices()[kind]
        number = part.device.sold_as if part.device is not None else ""
        return f"{part.name} ({number or 'not sold singly'})"
    return f"{catalogue.get(kind).name} ({kind})"
