"""Compact notation for the catalogue's parts."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from bricksrl.plans.geometry import AXES, Solid, Triple, bar, cylinder
from bricksrl.plans.part import Device, Fit, MassSource, Part, Site

_FITS = {
    "o": Fit.HOLE,
    "+": Fit.AXLE_HOLE,
    "pin": Fit.PIN,
    "friction": Fit.FRICTION_PIN,
    "axle": Fit.AXLE,
    "stud": Fit.STUD,
    "under": Fit.STUD_HOLE,
    "peg": Fit.PEG,
    "ball": Fit.BALL,
    "socket": Fit.SOCKET,
}
_WITHOUT_SOLIDS = (Fit.TURNTABLE, Fit.STUD, Fit.STUD_HOLE, Fit.BALL, Fit.SOCKET)
"""Sites without solids: collisions ignore studs, sockets and the hollows for them; a towball's head is added to its part."""
WALL_RADIUS, PIN_RADIUS = 9.0, 6.0


def sites(notation: str, *, turns: bool = False) -> tuple[Site, ...]:
    """Sites from text such as ``"o y20: 0,0,-20 0,0,20"``: fit, axis with length, centres; groups are separated by ``|``.

    Fits: ``o`` pin hole, ``+`` axle hole, ``pin``, ``friction``, ``axle``, ``stud``, ``under`` (takes a stud), ``peg``, ``ball``,
    ``socket``.
    """
    result = []
    for line in notation.split("|"):
        head, _, centres = line.partition(":")
        fit, axis = head.split()
        result += [Site(_FITS[fit], centre, AXES[axis[0]], float(axis[1:]), turns) for centre in points_of(centres)]
    return tuple(result)


def points_of(text: str) -> list[Triple]:
    """Points from ``"0,0,-20 0,0,20"``."""
    numbers = [[float(value) for value in point.split(",")] for point in text.split()]
    return [(x, y, z) for x, y, z in numbers]


def tubes(part_sites: Iterable[Site]) -> tuple[Solid, ...]:
    """A tube around each hole, a round bar for each pin and axle."""
    return tuple(
        cylinder(site.centre, site.axis, site.length, PIN_RADIUS if site.fit.is_male else WALL_RADIUS)
        for site in part_sites
        if site.fit not in _WITHOUT_SOLIDS
    )


def webs(chains: Iterable[list[Triple]], normal: Triple, thickness: float) -> tuple[Solid, ...]:
    """Bars along chains of points: a beam's body between the holes."""
    return tuple(
        bar(start, end, normal, 2 * WALL_RADIUS, thickness)
        for chain in chains
        for start, end in zip(chain, chain[1:], strict=False)
    )


def part(
    number: str,
    name: str,
    family: str,
    mass_g: float,
    part_sites: tuple[Site, ...],
    *,
    solids: tuple[Solid, ...] | None = None,
    more: tuple[Solid, ...] = (),
    source: MassSource = MassSource.VOLUME,
    **properties: Any,
) -> Part:
    """A part, with further fields of `Part` by name; by default its solids are tubes around its sites."""
    body = tubes(site for site in part_sites if not site.turns) if solids is None else solids
    return Part(number, name, family, part_sites, (*body, *more), mass_g, source, **properties)


def electric_part(
    number: str,
    name: str,
    mass_g: float,
    device: Device,
    holes: tuple[Site, ...],
    solids: tuple[Solid, ...],
    **properties: Any,
) -> Part:
    """A hub, motor or sensor, with further fields of `Part` by name."""
    family, source = f"{device.kind.value}s", MassSource.ESTIMATE
    return part(number, name, family, mass_g, holes, solids=solids, source=source, device=device, **properties)
