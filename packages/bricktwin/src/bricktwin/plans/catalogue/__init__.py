"""Part catalogue, by LDraw number, and LDraw's colours: the tables ``parts.csv``, ``devices.csv``
and ``colours.csv``."""

import functools
import re
from collections.abc import Mapping
from dataclasses import dataclass

from brickhub.errors import UnknownNameError
from brickhub.tables import read_table
from bricktwin.plans.catalogue import part_notation
from bricktwin.plans.geometry import Solid, Triple
from bricktwin.plans.part import Device, DeviceKind, MassSource, Part

_PRINTED = re.compile(r"(\d+[a-z]??)(?:p|d|-)\w{1,8}")
"""A number with a pattern, in LDraw's notation: 3004p0b, stickers as 87079d08, formerly 3005-7."""
DIRECT_COLOUR = 0x2000000
"""LDraw's code of black as a direct colour. In codes from here on, the lowest 24 bits are red,
green and blue."""


@functools.cache
def parts() -> tuple[Part, ...]:
    """All parts by family."""
    devices = {row["number"]: row for row in read_table(__package__, "devices")}
    return tuple(_part(row, devices.get(row["number"])) for row in read_table(__package__, "parts"))


@functools.cache
def _by_number() -> dict[str, Part]:
    return {number: part for part in parts() for number in (part.number, *part.aliases)}


def find(number: str) -> Part | None:
    """The part with an LDraw number, with or without ``.dat``, or ``None``. A print or sticker does
    not change the shape."""
    number = number.lower().removesuffix(".dat")
    plain = _PRINTED.fullmatch(number)
    part = _by_number().get(number)
    # The whole number is looked up first, because a part of its own may have one that looks like a
    # print, as 39367p02 does.
    if part is None and plain is not None:
        part = _by_number().get(plain[1])
    return part


def get(number: str) -> Part:
    """The part with an LDraw number. Raises UnknownNameError if it is not in the catalogue."""
    part = find(number)
    if part is None:
        raise UnknownNameError(
            f"part '{number}' is not in the catalogue; use one that `bricktwin plan parts` lists"
        )
    return part


def _part(row: Mapping[str, str], electric: Mapping[str, str] | None) -> Part:
    """The part of a row of ``parts.csv`` and, of a hub, motor or sensor, its row of
    ``devices.csv``."""
    if row["sites"].startswith("chain"):
        sites, solids = part_notation.beam(row["sites"])
        notches = part_notation.solids(row["solids"])[1]
    else:
        sites = part_notation.sites(row["sites"])
        solids, notches = part_notation.solids(row["solids"] or "tubes", sites)
    device = None
    turning: tuple[Solid, ...] = ()
    if electric is not None:
        device = _device(electric)
        turning, _ = part_notation.solids(electric["rotor_solids"])
        sites = (*sites, *part_notation.sites(electric["rotor"], turns=True))
    return Part(
        row["number"],
        row["name"],
        row["family"],
        sites,
        solids,
        float(row["mass_g"]),
        MassSource[row["mass_source"].upper()],
        tuple(row["aliases"].split()),
        turning,
        notches,
        part_notation.gears(row["gears"]),
        device,
        int(row["length"] or 0),
        float(row["wheel_mm"] or 0.0),
        bool(row["is_loose"]),
    )


def _device(row: Mapping[str, str]) -> Device:
    ports = [port.partition("=") for port in row["ports"].split()]
    return Device(
        DeviceKind(row["kind"]),
        row["name"],
        part_notation.point(row["plug"]),
        float(row["cable_mm"] or 0.0),
        tuple((name, part_notation.point(place)) for name, _, place in ports),
        part_notation.point(row["direction"]) if row["direction"] else None,
        row["sold_as"],
    )


@dataclass(frozen=True)
class Colour:
    """A colour.

    Attributes:
        rgb: components 0..1.
        bricklink: BrickLink's number, 0 if unknown.
    """

    code: int
    name: str
    rgb: Triple
    bricklink: int

    @property
    def rebrickable(self) -> int:
        """Rebrickable's number: LDraw's, or that of any colour for a direct colour of LDraw."""
        return self.code if self.code < DIRECT_COLOUR else 9999


@functools.cache
def _colours() -> dict[int, tuple[str, str, int]]:
    """Name, RGB in hexadecimal and BrickLink's number of each colour."""
    rows = read_table(__package__, "colours")
    return {int(row["code"]): (row["name"], row["rgb"], int(row["bricklink"])) for row in rows}


def colour_of(code: int) -> Colour:
    """The colour of a code; grey if unknown."""
    unknown = (f"colour {code}", "808080", 0)
    if code >= DIRECT_COLOUR:
        unknown = (f"#{code & 0xFFFFFF:06x}", f"{code & 0xFFFFFF:06x}", 0)
    name, rgb, bricklink = _colours().get(code, unknown)
    red, green, blue = (component / 255 for component in bytes.fromhex(rgb))
    return Colour(
        code,
        name,
        (red, green, blue),
        bricklink,
    )
