"""Pins, axles, bushes and connectors. Positions and lengths from LDraw.org's part library."""

from __future__ import annotations

import math

from bricksrl.plans.catalogue.build import PIN_RADIUS, part, sites
from bricksrl.plans.geometry import AXES, Solid, ball, box, cylinder, ring
from bricksrl.plans.part import Fit, MassSource, Part, Site

_AXLES = {
    2: "3704",
    3: "4519",
    4: "3705",
    5: "32073",
    6: "3706",
    7: "44294",
    8: "3707",
    9: "60485",
    10: "3737",
    11: "23948",
    12: "3708",
    16: "50451",
    32: "50450",
}
_COLOURED = {3: "4211815", 4: "370526", 5: "205", 6: "370626", 7: "300", 8: "370726", 12: "370826"}
"""LDraw's numbers for axles of one colour and moved ones."""
_X = AXES["x"]


def fasteners() -> list[Part]:
    """All pins, axles, bushes and connectors."""
    return [*_pins(), *_axles(), *_bushes(), *_blocks(), *_pin_connectors(), *_angles(), *_steering_links()]


def axle_mass_g(length: float) -> float:
    """Mass of an axle without a stop; within 0.01 g of the volumes at LDraw.org."""
    return round(0.1033 * length, 3)


def _pins() -> list[Part]:
    rows = [
        ("2780", "Pin with friction", 0.193, "friction x40: 0,0,0", ("61332", "4459", "4121715")),
        ("3673", "Pin", 0.183, "pin x40: 0,0,0", ("4211807",)),
        ("6558", "Pin 3 with friction", 0.290, "friction x60: 0,0,0", ("42924", "391")),
        ("32556", "Pin 3", 0.273, "pin x60: 0,0,0", ("39888",)),
        ("32002", "Pin 3/4", 0.144, "friction x30: -5,0,0", ()),
        ("4274", "Pin 1/2", 0.108, "pin x20: -10,0,0", ("4211483", "4143005")),
        ("43093", "Axle pin with friction", 0.212, "friction x20: -10,0,0 | axle x20: 10,0,0", ("4206482",)),
        ("3749", "Axle pin", 0.201, "pin x20: -10,0,0 | axle x20: 10,0,0", ("6562", "4186017")),
        ("11214", "Axle pin 3, 2 of pin", 0.319, "friction x40: -10,0,0 | axle x20: 20,0,0", ()),
        ("18651", "Axle pin 3, 2 of axle", 0.316, "friction x20: -20,0,0 | axle x40: 10,0,0", ()),
        ("65249", "Axle pin 3, 2 of axle, without friction", 0.305, "pin x20: -20,0,0 | axle x40: 10,0,0", ()),
        ("89678", "Pin 1/2 with friction and a stud", 0.114, "friction x20: -10,0,0 | stud x4: 2,0,0", ()),
        ("32054", "Pin 3 with a bush", 0.316, "+ x20: -20,0,0 | friction x40: 10,0,0", ("65304", "4140801")),
        ("87082", "Pin 3 with a hole", 0.540, "o y20: 0,0,0 | friction x20: -20,0,0 20,0,0", ("44874",)),
        (
            "32138",
            "Double pin 3 with an axle hole",
            1.093,
            "+ z18: 0,0,0 | friction x20: -20,-10,0 -20,10,0 20,-10,0 20,10,0",
            ("32136",),
        ),
    ]
    on_pin, on_axle = (ball((-10.0, 0.0, 0.0), 8.0),), (ball((-12.0, 0.0, 0.0), 8.0),)
    pin_sites, axle_sites = sites("friction x20: 10,0,0 | ball x16: -10,0,0"), sites("axle x20: 10,0,0 | ball x16: -12,0,0")
    return [
        *(part(number, name, "pins", mass, sites(text), aliases=aliases) for number, name, mass, text, aliases in rows),
        part("6628", "Pin with a towball", "pins", 0.259, pin_sites, more=on_pin, aliases=("66906", "50")),
        part("2736", "Axle with a towball", "axles", 0.243, axle_sites, more=on_axle, length=1),
    ]


def _axles() -> list[Part]:
    plain = [
        _axle(number, f"Axle {length}", length, axle_mass_g(length), aliases=(_COLOURED[length],) if length in _COLOURED else ())
        for length, number in _AXLES.items()
    ]
    notched = _axle("32062", "Axle 2 notched", 2, 0.188, source=MassSource.VOLUME, aliases=("4109810",))
    studded = part(
        "6587", "Axle 3 with a stud", "axles", 0.326, sites("axle x60: 0,0,0 | stud x4: 32,0,0"), aliases=("13670",), length=3
    )
    middle = sites("axle x80: 0,0,0")
    collared = part("99008", "Axle 4 with a stop in the middle", "axles", 0.437, middle, more=(_head(10.0, 20.0),), length=4)
    long = part("59426", "Axle 5.5 with a stop", "axles", 0.574, sites("axle x110: 0,0,0"), more=(_head(-32.0, 10.0),), length=6)
    stopped = [
        _axle(number, f"Axle {length} with a stop", length, mass, stop=stop, source=MassSource.VOLUME)
        for number, length, mass, stop in (
            ("24316", 3, 0.326, 1.0),
            ("87083", 4, 0.429, 1.0),
            ("15462", 5, 0.532, 1.0),
            ("55013", 8, 0.842, 1.0),
        )
    ]
    return [*plain, notched, studded, collared, long, *stopped]


def _head(x: float, length: float) -> Solid:
    return cylinder((x, 0.0, 0.0), _X, length, 8.0)


def _axle(
    number: str,
    name: str,
    length: int,
    mass_g: float,
    stop: float = 0.0,
    source: MassSource = MassSource.RULE,
    aliases: tuple[str, ...] = (),
) -> Part:
    """An axle along x; a stop is a round head at +x."""
    part_sites = (Site(Fit.AXLE, (0.0, 0.0, 0.0), _X, 20.0 * length),)
    head = (_head(10.0 * length - 2, 4.0),) if stop else ()
    return part(number, name, "axles", mass_g, part_sites, more=head, source=source, aliases=aliases, length=length)


def _bushes() -> list[Part]:
    rows = [
        ("3713", "Bush", 0.135, "+ z20: 0,0,0", ("6590", "4211622"), "bushes"),
        ("32123b", "Half bush", 0.080, "+ z10: 0,0,0", ("32123a", "32123", "4265c", "4265b", "4265a", "4211573"), "bushes"),
        ("49283", "Cable clip", 0.346, "+ z20: 0,0,0", (), "bushes"),
        ("59443", "Axle joiner 2", 0.363, "+ z40: 0,0,0", ("6538c", "6538b", "6538a", "6538"), "connectors"),
        ("26287", "Axle joiner 3", 0.537, "+ z60: 0,0,0", ("42195",), "connectors"),
        ("18948", "Axle joiner 3 for a driving ring", 0.681, "+ z60: 0,0,0", (), "connectors"),
        ("61903", "Universal joint 3", 0.443, "+ z20: 0,0,-20 0,0,20", ("62520c01",), "connectors"),
        ("45590", "Flexible double axle joiner", 0.511, "+ z20: 0,0,0 20,0,0", (), "connectors"),
        ("75535", "Pin joiner 2", 0.445, "o x40: 0,0,0", ("62462", "15555", "29219", "428", "53293", "86849"), "connectors"),
    ]
    body = (box((0.0, 0.0, -19.5), (18.0, 20.0, 57.0)),)
    tooth = part("41669", "Tooth 1 x 3", "connectors", 0.457, sites("+ y16: 0,0,0"), solids=body, aliases=("16646",))
    return [
        tooth,
        *(part(number, name, family, mass, sites(text), aliases=aliases) for number, name, mass, text, aliases, family in rows),
    ]


def _blocks() -> list[Part]:
    """Cross blocks: holes at right angles."""
    rows = [
        ("6536", "Cross block 2, axle", 0.385, "+ x20: 0,0,0 | o z20: 0,20,0"),
        ("32184", "Cross block 3, two axles", 0.608, "+ x20: 0,-20,0 0,20,0 | o z20: 0,0,0"),
        ("42003", "Cross block 3, axle", 0.611, "+ x20: 0,-20,0 | o z20: 0,0,0 0,20,0"),
        ("32291", "Cross block 2 x 2, axle", 0.505, "+ x20: 0,0,0 | o z20: -10,20,0 10,20,0"),
        ("41678", "Cross block 2 x 2 split, axle", 0.863, "+ x10: -15,0,0 15,0,0 | o y20: -10,0,-20 10,0,-20"),
        ("63869", "Cross block 2 x 3, axle", 0.840, "+ x20: 0,0,0 | o z20: -20,20,0 0,20,0 20,20,0"),
        ("92907", "Cross block 2 x 2 x 2, two axles", 1.028, "+ x10: -15,20,-20 -15,20,0 15,20,-20 15,20,0 | o z20: 0,0,0"),
        ("98989", "Cross block 2 x 4", 0.932, "+ x20: 0,-40,0 | o x20: 0,-20,0 0,0,0 | o z20: -10,20,0 10,20,0"),
        ("44809", "Cross block 2 x 2 bent", 0.582, "o x20: 0,0,-20 | o y20: 0,0,0 | o z20: 20,0,0"),
        ("32039", "Axle connector with an axle hole", 0.289, "+ x20: 0,0,-20 | + z20: 0,0,0"),
    ]
    biscuit = sites("o x20: -20,0,-20 -20,0,20 20,0,-20 20,0,20 | o y20: -20,0,0 0,0,-20 0,0,0 0,0,20 20,0,0")
    blocks = [part(number, name, "connectors", mass, sites(text)) for number, name, mass, text in rows]
    return [*blocks, part("39793", "Block 3 x 3", "connectors", 2.204, biscuit, solids=(box((0, 0, 0), (60, 20, 58)),))]


def _pin_connectors() -> list[Part]:
    """Blocks with pins."""
    corner = "friction y20: 0,20,0 0,20,40 | friction z20: 0,-40,-20 0,0,-20"
    rows = [
        ("15100", "Pin with a hole across", 0.351, "o y20: 0,0,0 | friction x20: 20,0,0", ("27676",)),
        ("15461", "Connector 3 with two pins", 0.610, "o x20: -10,0,0 | friction x20: 10,-20,0 10,20,0", ("46189",)),
        (
            "87408",
            "Double toggle joint, axle and pin holes",
            1.211,
            "+ y20: 0,-10,-20 0,-10,20 | o y20: 0,-10,0 | o z20: 0,-30,-20 0,-30,20 0,-50,-20 0,-50,20",
            (),
        ),
        (
            "48496",
            "Double toggle joint with two pins",
            0.968,
            "pin y20: 0,10,-20 0,10,20 | o y10: 0,-5,0 | o z20: 0,-30,-20 0,-30,20",
            ("18171",),
        ),
        ("22961", "Axle with a hole across", 0.369, "o y20: 0,0,0 | axle x20: 20,0,0", ()),
        ("27940", "Axle 3 with a hole across", 0.576, "o y20: 0,0,0 | axle x20: -20,0,0 20,0,0", ()),
        ("10197", "Hub with two axles at 90", 0.550, "o x20: 0,0,0 | axle z20: 0,0,-20 | axle y20: 0,-20,0", ()),
        (
            "33299a",
            "Thin beam 3 with a boss and a pin",
            0.561,
            "+ y10: 0,5,20 | + y20: 0,0,0 | pin y20: 0,20,40",
            ("33299b", "33299"),
        ),
        ("6553", "Axle 1.5 with an axle hole across", 0.472, "+ x20: 0,0,0 | axle y40: 0,30,0", ("4211536",)),
        (
            "48989",
            "Cross block 3 with four pins",
            1.552,
            "o x20: 0,-20,0 0,20,0 | o z20: 0,0,0 | friction z20: 0,-20,-20 0,-20,20 0,20,-20 0,20,20",
            ("65489",),
        ),
        (
            "55615",
            "Corner 3 x 3 with four pins",
            1.809,
            f"o x20: 0,-40,0 0,0,0 0,0,40 | o y20: 0,0,20 | o z20: 0,-20,0 | {corner}",
            ("49130",),
        ),
    ]
    return [part(number, name, "connectors", mass, sites(text), aliases=aliases) for number, name, mass, text, aliases in rows]


def _steering_links() -> list[Part]:
    """Bars between two sockets for towballs."""
    rows = [("32005", 6, 100.0, 0.612, ("32005a", "32005b", "2739", "2739a", "2739b")), ("32293", 9, 160.0, 1.090, ())]
    return [
        part(
            number,
            f"Steering link {length}",
            "connectors",
            mass,
            sites(f"socket y12: 0,0,0 0,0,{apart:g}"),
            more=(
                cylinder((0.0, 0.0, apart / 2), "z", apart - 20.0, PIN_RADIUS),
                *(ring((0.0, 0.0, z), "y", 12.0, 10.0, 8.0) for z in (0.0, apart)),
            ),
            aliases=aliases,
        )
        for number, length, apart, mass, aliases in rows
    ]


def _angles() -> list[Part]:
    """Angle connectors: a pin hole, and one or two axle holes that meet there."""
    rows = [("32034", 2, 180.0), ("32016", 3, 157.5), ("32192", 4, 135.0), ("32015", 5, 112.5), ("32014", 6, 90.0)]
    first = sites("o x20: 0,0,0 | + z20: 0,0,-20")
    parts = [part("32013", "Angle connector 1", "connectors", 0.441, first)]
    for number, kind, angle_deg in rows:
        bend = math.radians(180 - angle_deg)
        along = (0.0, -math.sin(bend), math.cos(bend))
        second = Site(Fit.AXLE_HOLE, (0.0, 20 * along[1], 20 * along[2]), along, 20.0)
        parts.append(part(number, f"Angle connector {kind}, {angle_deg:g}", "connectors", 0.722, (*first, second)))
    return parts
