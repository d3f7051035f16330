"""Gear trains: what each motor drives, and through which teeth. Plain data."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from dataclasses import dataclass

import numpy as np

from brickhub.errors import PlanError
from bricktwin.plans.geometry import Floats, lines_coincide
from bricktwin.plans.mechanism.kinematics import Hinge, Mechanism
from bricktwin.plans.part import GearForm

_MIN_RATIO = 1e-4
_COAXIAL_M = 0.001


@dataclass(frozen=True)
class Train:
    """A motor and what it drives.

    Attributes:
        hinge: index of the shaft's hinge.
        output: index of the driven hinge; the same without gears.
        ratio: turns of the output's child about its axis per turn of the shaft.
        teeth: meshing pairs from the motor to the output; empty without gears.
        others: indices and ratios of the other geared hinges, including the shaft's.
    """

    port: str
    hinge: int
    output: int
    ratio: float
    teeth: tuple[int, ...]
    others: tuple[tuple[int, float], ...]

    @property
    def gears(self) -> tuple[int, ...]:
        """Teeth ``(motor, output)`` of one pair with the same ratio; empty without gears."""
        if not self.teeth:
            return ()
        driving, driven = Counter(self.teeth[::2]), Counter(self.teeth[1::2])
        first, last = list((driving - driven).elements()), list((driven - driving).elements())
        if len(first) == len(last) == 1:  # an idler does not change the ratio
            return first[0], last[0]
        before, after = math.prod(first), math.prod(last)
        shared = math.gcd(before, after)
        return before // shared, after // shared


def trains(mechanism: Mechanism, path: str) -> tuple[Train, ...]:
    """The train of each motor, in the order of the mechanism's ports. Raises PlanError if two motors drive the same thing, or a
    gear drives a rack."""
    neighbours: dict[int, list[tuple[int, int, int]]] = defaultdict(list)
    for pair in mechanism.gears:
        if GearForm.RACK in pair.forms:
            raise PlanError(f"{path}: a gear drives a rack; sliding parts have no twin, so drive a rotating part")
        neighbours[pair.links[0]].append((pair.links[1], pair.teeth[0], pair.teeth[1]))
        neighbours[pair.links[1]].append((pair.links[0], pair.teeth[1], pair.teeth[0]))
    result: list[Train] = []
    for column, port in enumerate(mechanism.ports):
        index = next((number for number, hinge in enumerate(mechanism.hinges) if hinge.port == port), None)
        if index is None:
            raise PlanError(f"{path}: the motor of port {port} drives the same part as another one, or nothing; remove it")
        result.append(_train(mechanism, neighbours, index, column))
    driven = [hinge for train in result for hinge in {train.output, train.hinge, *(number for number, _ in train.others)}]
    shared = sorted({hinge for hinge in driven if driven.count(hinge) > 1})
    if shared:
        ports = ", ".join(train.port for train in result if {train.output, *(number for number, _ in train.others)} & set(shared))
        raise PlanError(f"{path}: the motors of ports {ports} drive the same part; give each part one motor")
    return tuple(result)


def _train(mechanism: Mechanism, neighbours: dict[int, list[tuple[int, int, int]]], index: int, column: int) -> Train:
    """The train of the motor with shaft hinge ``index``."""
    shaft = mechanism.hinges[index]
    ratios = mechanism.ratios[:, column]
    rotor, case = (shaft.child, shaft.parent) if shaft.turns_child else (shaft.parent, shaft.child)
    reached: dict[int, tuple[int, ...]] = {rotor: ()}
    queue = [rotor]
    while queue:
        link = queue.pop(0)
        for other, link_teeth, other_teeth in neighbours[link]:
            if other not in reached and other != case:
                reached[other] = (*reached[link], link_teeth, other_teeth)
                queue.append(other)
    hinges: dict[int, tuple[int, ...]] = {index: ()}
    for link, teeth in reached.items():
        for number, hinge in enumerate(mechanism.hinges):
            is_free = hinge.port is None and not (hinge.closes_loop or hinge.is_ball) and abs(ratios[number]) > _MIN_RATIO
            # A meshing link turns about the axis of its gear; its other hinges belong to a linkage.
            if teeth and is_free and link in (hinge.parent, hinge.child) and _is_ratio(ratios[number], teeth):
                hinges.setdefault(number, teeth)
    output = max(hinges, key=lambda number: (_weight(mechanism, number), -len(hinges[number]), -number))
    others = tuple((number, _exact(ratios[number], teeth)) for number, teeth in hinges.items() if number != output)
    return Train(mechanism.ports[column], index, output, _exact(ratios[output], hinges[output]), hinges[output], others)


def _exact(ratio: float, teeth: tuple[int, ...]) -> float:
    """The ratio of the teeth with the sign of ``ratio``."""
    return math.copysign(math.prod(teeth[::2]) / math.prod(teeth[1::2]), ratio)


def _is_ratio(ratio: float, teeth: tuple[int, ...]) -> bool:
    return abs(abs(ratio) - math.prod(teeth[::2]) / math.prod(teeth[1::2])) < 0.02 * abs(ratio)


def _weight(mechanism: Mechanism, number: int) -> tuple[bool, float]:
    """Sort key of a hinge's load: whether there is a wheel, and the mass."""
    child = mechanism.hinges[number].child
    carried, queue = {child}, [child]
    while queue:
        link = queue.pop()
        unseen = {hinge.child for hinge in mechanism.hinges if hinge.parent == link and not hinge.closes_loop} - carried
        carried |= unseen
        queue += unseen
    mass_kg = sum(mechanism.links[link].mass_kg for link in carried)
    return any(wheel.link in carried for wheel in mechanism.wheels), round(mass_kg, 6)


def is_balanced(mechanism: Mechanism, hinge: Hinge, link: int, max_kg_m: float) -> bool:
    """Whether a link's centre of mass is close to a hinge's axis."""
    body = mechanism.links[link]
    offset: Floats = np.cross(body.centre_m - hinge.point_m, hinge.axis)
    return bool(body.mass_kg * np.linalg.norm(offset) < max_kg_m)


def is_coaxial(first: Hinge, second: Hinge) -> bool:
    """Whether two hinges share an axis; a ball joint has none."""
    is_ball = first.is_ball or second.is_ball
    return not is_ball and lines_coincide(first.point_m, first.axis, second.point_m, second.axis, offset=_COAXIAL_M, sine=0.02)
