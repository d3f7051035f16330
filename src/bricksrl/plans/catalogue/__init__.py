"""The catalogue: kinds of parts by their LDraw numbers."""

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
    """All kinds of parts, family by family."""
    return (*beams(), *fasteners(), *moving(), *electric(), *ev3(), *system())


@functools.cache
def _by_number() -> dict[str, Part]:
    return {number: part for part in parts() for number in (part.number, *part.aliases)}


def find(number: str) -> Part | None:
    """The part of that LDraw number, with or without ``.dat``; ``None`` where the catalogue has none."""
    return _by_number().get(number.lower().removesuffix(".dat"))


def get(number: str) -> Part:
    """The part of that LDraw number.

    Raises:
        UnknownNameError: the catalogue has none.
    """
    found = find(number)
    if found is None:
        raise UnknownNameError(f"part '{number}' is not in the catalogue; use one that `bricksrl plan parts` lists")
    return found


__all__ = ["find", "get", "parts"]
