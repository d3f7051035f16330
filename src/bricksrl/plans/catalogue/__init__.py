"""Part catalogue, by LDraw number."""

from __future__ import annotations

import functools

from bricksrl.errors import UnknownNameError
from bricksrl.plans.catalogue.beams import beams
from bricksrl.plans.catalogue.electric import electric
from bricksrl.plans.catalogue.ev3 import ev3
from bricksrl.plans.catalogue.fasteners import fasteners
from bricksrl.plans.catalogue.moving import moving
from bricksrl.plans.catalogue.system import system
from bricksrl.plans.part import Part


@functools.cache
def parts() -> tuple[Part, ...]:
    """All parts by family."""
    return (*beams(), *fasteners(), *moving(), *electric(), *ev3(), *system())


@functools.cache
def _by_number() -> dict[str, Part]:
    return {number: part for part in parts() for number in (part.number, *part.aliases)}


def find(number: str) -> Part | None:
    """The part with an LDraw number, with or without ``.dat``, or ``None``."""
    return _by_number().get(number.lower().removesuffix(".dat"))


def get(number: str) -> Part:
    """The part with an LDraw number. Raises UnknownNameError if it is not in the catalogue."""
    part = find(number)
    if part is None:
        raise UnknownNameError(f"part '{number}' is not in the catalogue; use one that `bricksrl plan parts` lists")
    return part


__all__ = ["find", "get", "parts"]
