"""Articulation: the bodies and joints of a mechanism that a simulation needs. Plain data.

Balanced shafts and gears become visual parts of their carrier; a light link between two pins becomes a rod. Metres, kilograms,
radians; x forward, y left, z up, in the plan's position.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bricksrl.plans.geometry import Floats
from bricksrl.plans.mechanism.kinematics import Hinge, Link, Mechanism, Mounted, Wheel
from bricksrl.plans.mechanism.trains import Train, is_balanced, is_coaxial

_BALANCED_KG_M = 1.2e-5
"""12 g, 1 mm off the axis: 0.1 Nmm, 1/200 of a motor's friction."""
_ROD_KG = 0.010
"""Heavier links are separate bodies."""


@dataclass(frozen=True, eq=False)
class Turn:
    """A hinge: bodies ``parent`` and ``child`` (indices), a point [3], an axis [3]; or a ball joint."""

    parent: int
    child: int
    point_m: Floats
    axis: Floats
    is_ball: bool = False


@dataclass(frozen=True, eq=False)
class Drive:
    """A motor and the turn that it drives.

    Attributes:
        gear: turns of the motor's shaft, clockwise from outside, per turn of the child.
        armature: inertia of the other geared parts at the axis, kg m².
    """

    port: str
    turn: Turn
    gear: float
    armature: float
    teeth: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Geared:
    """A turn geared to a motor; ``ratio`` is turns per turn of the drive."""

    port: str
    turn: Turn
    ratio: float


@dataclass(frozen=True, eq=False)
class Follower:
    """Visual parts on a body that turn with a motor; ``ratio`` is turns per turn of the drive."""

    body: int
    parts: tuple[int, ...]
    point_m: Floats
    axis: Floats
    port: str
    ratio: float


@dataclass(frozen=True, eq=False)
class Rod:
    """A light link between two pins or balls: bodies, points [3] (of pins in a plane across them), parts.

    Half of its mass is added to each body.
    """

    near: int
    near_m: Floats
    far: int
    far_m: Floats
    parts: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Articulation:
    """The articulation of a robot; the first body is the base.

    Attributes:
        is_fixed: whether the base is fixed.
        swings: turns without a motor.
        loops: turns between bodies that are already connected.
        wheels, mounted: as in the mechanism; their ``link`` is the index of a body.
    """

    bodies: tuple[Link, ...]
    is_fixed: bool
    drives: tuple[Drive, ...]
    geared: tuple[Geared, ...]
    swings: tuple[Turn, ...]
    loops: tuple[Turn, ...]
    followers: tuple[Follower, ...]
    rods: tuple[Rod, ...]
    wheels: tuple[Wheel, ...]
    mounted: tuple[Mounted, ...]

    @property
    def mass_kg(self) -> float:
        """Total mass."""
        return sum(body.mass_kg for body in self.bodies)


def articulation(made: Mechanism, driven: tuple[Train, ...]) -> Articulation:
    """The articulation of a mechanism and its gear trains."""
    work = _Simplifier(made, driven)
    work.make_followers()
    work.merge_shafts()
    work.find_rods()
    return work.result()


class _Simplifier:
    """Stepwise simplification of a mechanism."""

    def __init__(self, made: Mechanism, driven: tuple[Train, ...]) -> None:
        self.made, self.driven = made, driven
        self.home = list(range(len(made.links)))
        """For each link, the one that it has been merged into."""
        self.left = dict(enumerate(made.hinges))
        self.spun: list[tuple[int, Hinge, str, float]] = []
        self.rods: list[tuple[int, Hinge, Hinge]] = []
        self.armature: dict[str, float] = {}
        self.coupled = {train.output for train in driven} | {number for train in driven for number, _ in train.others}
        self.wheels = {wheel.link for wheel in made.wheels}
        self.kept = self.wheels | {one.link for one in made.mounted} | {made.fixed if made.fixed is not None else 0}

    def find(self, link: int) -> int:
        """The link that a link has been merged into."""
        while self.home[link] != link:
            link = self.home[link]
        return link

    def _hinges_of(self, link: int) -> list[int]:
        return [number for number, one in self.left.items() if link in (self.find(one.parent), self.find(one.child))]

    def make_followers(self) -> None:
        """Add balanced shafts and gears that turn with a motor to their carriers as visual parts."""
        for train in self.driven:
            output = self.made.hinges[train.output]
            self.armature[train.port] = 0.0
            for number, ratio in train.others:
                hinge = self.made.hinges[number]
                link = hinge.child if len(self._hinges_of(hinge.child)) == 1 else hinge.parent
                alone = len(self._hinges_of(link)) == 1 and link not in self.kept
                if not alone or not is_balanced(self.made, hinge, link, _BALANCED_KG_M) or hinge is output:
                    continue
                carrier = hinge.parent if link == hinge.child else hinge.child
                inertia = float(hinge.axis @ self.made.links[link].inertia @ hinge.axis)
                relative = ratio / train.ratio * (1.0 if link == hinge.child else -1.0)
                self.armature[train.port] += inertia * relative**2
                self.spun.append((link, hinge, train.port, relative))
                self.home[link] = carrier
                del self.left[number]

    def merge_shafts(self) -> None:
        """Merge an axle that spins freely about one axis with one of the parts around it."""
        for link in sorted(range(len(self.made.links)), key=lambda one: self.made.links[one].mass_kg):
            numbers = self._hinges_of(link)
            if link in self.kept or self.find(link) != link or not numbers or self.coupled & set(numbers):
                continue
            hinges = [self.left[number] for number in numbers]
            if not all(is_coaxial(hinges[0], hinge) for hinge in hinges):
                continue
            if self.made.links[link].mass_kg < _ROD_KG and is_balanced(self.made, hinges[0], link, _BALANCED_KG_M):
                self.home[link] = self.find(hinges[0].parent if self.find(hinges[0].child) == link else hinges[0].child)
                del self.left[numbers[0]]
        self._drop_duplicates()

    def _drop_duplicates(self) -> None:
        """Remove duplicate hinges between two links about one axis."""
        for number, hinge in list(self.left.items()):
            ends = {self.find(hinge.parent), self.find(hinge.child)}
            for other, earlier in self.left.items():
                same = {self.find(earlier.parent), self.find(earlier.child)} == ends and is_coaxial(earlier, hinge)
                if len(ends) == 1 or (same and other != number and (other in self.coupled or other < number)):
                    if number not in self.coupled:
                        del self.left[number]
                    break

    def find_rods(self) -> None:
        """Turn the lightest links of closed loops between two pins, or two balls, into rods."""
        for link in sorted(range(len(self.made.links)), key=lambda one: self.made.links[one].mass_kg):
            numbers = self._hinges_of(link)
            if len(numbers) != 2 or link in self.kept or self.coupled & set(numbers) or self.find(link) != link:
                continue
            first, second = (self.left[number] for number in numbers)
            parallel = np.linalg.norm(np.cross(first.axis, second.axis)) < 0.02 and not is_coaxial(first, second)
            suited = (first.is_ball and second.is_ball) or (parallel and not first.is_ball and not second.is_ball)
            if suited and self.made.links[link].mass_kg < _ROD_KG and self._is_in_loop(link, numbers):
                self.rods.append((link, first, second))
                for number in numbers:
                    del self.left[number]

    def _is_in_loop(self, link: int, numbers: list[int]) -> bool:
        """Whether the link's neighbours are connected without it."""
        ends = [self._other_link(self.left[number], link) for number in numbers]
        reached, waiting = {ends[0]}, [ends[0]]
        while waiting:
            here = waiting.pop()
            for number in self._hinges_of(here):
                other = self._other_link(self.left[number], here)
                if number not in numbers and other not in reached:
                    reached.add(other)
                    waiting.append(other)
        return ends[1] in reached

    def _other_link(self, hinge: Hinge, link: int) -> int:
        first, second = self.find(hinge.parent), self.find(hinge.child)
        return second if first == link else first

    def result(self) -> Articulation:
        """The tree of the remaining links from the first body on, and the loops."""
        made = self.made
        root = self.find(made.fixed if made.fixed is not None else 0)
        order, tree, loops = [root], [], []
        left = sorted(self.left, key=lambda number: number not in self.coupled)
        while left:
            ends = {number: (self.find(self.left[number].parent), self.find(self.left[number].child)) for number in left}
            open_ends = [number for number in left if (ends[number][0] in order) != (ends[number][1] in order)]
            if not open_ends:
                loops += [number for number in left if set(ends[number]) <= set(order)]
                break
            number = open_ends[0]
            left.remove(number)
            order.append(next(link for link in ends[number] if link not in order))
            tree.append(number)
        homes = {link: self.find(link) for link in range(len(made.links))}
        body_of = {link: order.index(home) for link, home in homes.items() if home in order}
        turns = {number: self._turn(self.left[number], body_of) for number in (*tree, *loops)}
        rods = tuple(_rod(made.links[link], first, second, link, body_of) for link, first, second in self.rods)
        pieces = {number: [made.links[link] for link in body_of if body_of[link] == number] for number in range(len(order))}
        for rod, (link, _, _) in zip(rods, self.rods, strict=True):
            for number, place in ((rod.near, rod.near_m), (rod.far, rod.far_m)):
                pieces[number].append(Link((), made.links[link].mass_kg / 2, place, np.zeros((3, 3))))
        bodies = tuple(merged(pieces[number]) for number in range(len(order)))
        return Articulation(
            bodies,
            made.fixed is not None,
            self._drives(turns),
            self._geared(turns),
            tuple(turns[number] for number in tree if number not in self.coupled),
            tuple(turns[number] for number in loops),
            tuple(
                Follower(body_of[link], made.links[link].parts, hinge.point_m, hinge.axis, port, ratio)
                for link, hinge, port, ratio in self.spun
            ),
            rods,
            tuple(replace(wheel, link=body_of[wheel.link]) for wheel in made.wheels),
            tuple(replace(one, link=body_of[one.link]) for one in made.mounted),
        )

    def _turn(self, hinge: Hinge, body_of: dict[int, int]) -> Turn:
        """A hinge as a turn; the child is the later body, and the axis is reversed if that was the parent."""
        parent, child = body_of[hinge.parent], body_of[hinge.child]
        if parent < child:
            return Turn(parent, child, hinge.point_m, hinge.axis, hinge.is_ball)
        return Turn(child, parent, hinge.point_m, -hinge.axis, hinge.is_ball)

    def _drives(self, turns: dict[int, Turn]) -> tuple[Drive, ...]:
        """The motors; seen from outside, a clockwise turn is against the shaft's direction."""
        drives = []
        for train in self.driven:
            turn = turns[train.output]
            flipped = Turn(turn.parent, turn.child, turn.point_m, -turn.axis)
            drives.append(Drive(train.port, flipped, 1.0 / train.ratio, self.armature[train.port], train.teeth))
        return tuple(drives)

    def _geared(self, turns: dict[int, Turn]) -> tuple[Geared, ...]:
        """Bodies geared to a motor's output; the sign follows the turn's axis."""
        found = []
        for train in self.driven:
            for number, ratio in train.others:
                if number in turns:
                    turn = turns[number]
                    flipped = Turn(turn.parent, turn.child, turn.point_m, -turn.axis)
                    found.append(Geared(train.port, flipped, ratio / train.ratio))
        return tuple(found)


def _rod(link: Link, first: Hinge, second: Hinge, own: int, body_of: dict[int, int]) -> Rod:
    """A link as a rod; two pins are moved to the plane of the first one."""
    near, far = (hinge.parent if hinge.child == own else hinge.child for hinge in (first, second))
    shift = 0.0 if first.is_ball else float((second.point_m - first.point_m) @ first.axis)
    return Rod(body_of[near], first.point_m, body_of[far], second.point_m - shift * first.axis, link.parts)


def merged(links: list[Link]) -> Link:
    """Links merged into one rigid body."""
    mass = sum(link.mass_kg for link in links)
    centre = np.asarray(sum(link.mass_kg * link.centre_m for link in links) / mass)
    inertia = np.zeros((3, 3))
    for link in links:
        away = link.centre_m - centre
        inertia += link.inertia + link.mass_kg * (float(away @ away) * np.eye(3) - np.outer(away, away))
    return Link(tuple(part for link in links for part in link.parts), mass, centre, inertia)
