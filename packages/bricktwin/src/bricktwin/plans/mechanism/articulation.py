"""Articulation: the bodies and joints of a mechanism that a simulation needs. Plain data.

Balanced shafts and gears become visual parts of their carrier; a light link between two pins
becomes a rod. Metres, kilograms, radians; x forward, y left, z up, in the plan's position.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from bricktwin.plans.connections import graph_of, reached
from bricktwin.plans.geometry import Floats
from bricktwin.plans.mechanism.kinematics import (
    Hinge,
    Link,
    Mechanism,
    Train,
    Wheel,
    is_balanced,
    merged,
    share_axis,
)
from bricktwin.plans.mechanism.open_gears import Coupling, OpenGears, couplings_of, way_to

_BALANCED_KG_M = 1.2e-5
"""Largest imbalance of a shaft that becomes visual: 12 g, 1 mm off its axis, which is a torque of
0.1 Nmm, 1/200 of a motor's friction."""
_ROD_KG = 0.010
"""Largest mass of a link that becomes a rod; heavier ones are bodies of their own."""

_ROD_HALF_M = 0.008
"""Largest distance of a rod's shape from the line between its pins: a module."""


@dataclass(frozen=True, eq=False)
class Drive:
    """A motor and the joint that it drives.

    Attributes:
        gear: turns of the motor's shaft, clockwise from outside, per turn of the child.
        armature: inertia of the other geared parts at the axis, kg m².
    """

    port: str
    joint: Hinge
    gear: float
    armature: float
    teeth: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Geared:
    """A joint geared to a motor; ``ratio`` is turns per turn of the drive."""

    port: str
    joint: Hinge
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
    """A light link between two pins or balls: bodies, points [3] (of pins in a plane across them),
    parts.

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
        swings: joints without a motor.
        loops: joints between bodies that are already connected.
        couplings: constraints of open gears on joints.
        wheels: as in the mechanism; their ``link`` is the index of a body, as those of the hinges
            are.
    """

    bodies: tuple[Link, ...]
    is_fixed: bool
    drives: tuple[Drive, ...]
    geared: tuple[Geared, ...]
    swings: tuple[Hinge, ...]
    loops: tuple[Hinge, ...]
    followers: tuple[Follower, ...]
    rods: tuple[Rod, ...]
    wheels: tuple[Wheel, ...]
    couplings: tuple[Coupling, ...] = ()

    def body_of(self, part: int) -> int | None:
        """Index of the body with a part; ``None`` for a rod, or a part that is not connected."""
        for number, body in enumerate(self.bodies):
            if part in body.parts:
                return number
        return None

    @property
    def joints(self) -> list[Hinge]:
        """All joints of the tree, parents first."""
        joints = [
            *(drive.joint for drive in self.drives),
            *(geared.joint for geared in self.geared),
            *self.swings,
        ]
        return sorted(joints, key=lambda joint: joint.child)


def articulation(
    mechanism: Mechanism,
    trains: tuple[Train, ...],
    opened: OpenGears,
) -> Articulation:
    """The articulation of a mechanism, its gear trains and its open gears."""
    simplifier = _Simplifier(mechanism, trains, opened)
    simplifier.make_followers()
    simplifier.merge_shafts()
    simplifier.find_rods()
    return simplifier.result()


class _Simplifier:
    """Stepwise simplification of a mechanism."""

    def __init__(
        self,
        mechanism: Mechanism,
        trains: tuple[Train, ...],
        opened: OpenGears,
    ) -> None:
        self.mechanism = mechanism
        self.trains = trains
        self.opened = opened
        self.merged_into = np.arange(len(mechanism.links))
        """For each link, the one that it has been merged into, or itself."""
        self.hinges = dict(enumerate(mechanism.hinges))
        self.followers: list[tuple[int, Hinge, str, float]] = []
        self.rods: list[tuple[int, Hinge, Hinge]] = []
        self.armature: dict[str, float] = {}
        self.coupled = {number for train in trains for number in train.hinges}
        # Wheels, hub, sensors and the base stay bodies of their own, however light they are,
        # because the twin gives them contacts and senses.
        self.preserved = {wheel.link for wheel in mechanism.wheels} | set(mechanism.devices)
        self.preserved.add(mechanism.fixed or 0)
        # An open gear turns as no motor does, so it needs a joint.
        self.preserved |= opened.links

    def _merge(
        self,
        link: int,
        other: int,
    ) -> None:
        """Merge a link into another one."""
        # Everything that was merged into this link before goes with it.
        self.merged_into[self.merged_into == link] = self.merged_into[other]

    def _hinges_of(self, link: int) -> list[int]:
        return [number for number, hinge in self.hinges.items() if link in self._ends(hinge)]

    def make_followers(self) -> None:
        """Add balanced shafts and gears that turn with a motor to their carriers as visual
        parts."""
        for train in self.trains:
            output = self.mechanism.hinges[train.output]
            self.armature[train.port] = 0.0
            for number, ratio in train.others:
                hinge = self.mechanism.hinges[number]
                # The shaft is the link of the two that hangs on nothing else; the other one carries
                # it.
                is_child = len(self._hinges_of(hinge.child)) == 1
                link = hinge.child
                carrier = hinge.parent
                if not is_child:
                    link, carrier = carrier, link
                # A train may end in a shaft that carries something, which is a real joint.
                is_alone = len(self._hinges_of(link)) == 1 and link not in self.preserved
                if not is_alone or hinge is output:
                    continue
                if not is_balanced(
                    self.mechanism,
                    hinge,
                    link,
                    _BALANCED_KG_M,
                ):
                    continue
                inertia = float(hinge.axis @ self.mechanism.links[link].inertia @ hinge.axis)
                sign = 1.0 if link == hinge.child else -1.0
                relative = ratio / train.ratio * sign
                # An inertia behind gears counts with the square of their ratio.
                self.armature[train.port] += inertia * relative**2
                self.followers.append((link, hinge, train.port, relative))
                self._merge(link, carrier)
                del self.hinges[number]

    def merge_shafts(self) -> None:
        """Merge an axle that spins freely about one axis with one of the parts around it."""
        for link, numbers in self._light_links():
            hinges = [self.hinges[number] for number in numbers]
            is_shaft = bool(hinges) and all(share_axis(hinges[0], hinge) for hinge in hinges)
            if is_shaft and is_balanced(
                self.mechanism,
                hinges[0],
                link,
                _BALANCED_KG_M,
            ):
                self._merge(link, self._other_end(hinges[0], link))
                del self.hinges[numbers[0]]
        # Merging may leave two links with several hinges about one axis. One of them is kept: one
        # that a motor turns, or else the first.
        for number, hinge in list(self.hinges.items()):
            ends = set(self._ends(hinge))
            for other, earlier in self.hinges.items():
                # Merging may have made the two links of a hinge one.
                is_within = len(ends) == 1
                is_same = set(self._ends(earlier)) == ends and share_axis(earlier, hinge)
                is_first = other in self.coupled or other < number
                if is_within or (is_same and other != number and is_first):
                    if number not in self.coupled:
                        del self.hinges[number]
                    break

    def _light_links(self) -> Iterator[tuple[int, list[int]]]:
        """Light links that nothing needs as bodies, the lightest first, with their hinges."""
        masses_kg = [link.mass_kg for link in self.mechanism.links]
        for link in sorted(range(len(masses_kg)), key=lambda link: masses_kg[link]):
            numbers = self._hinges_of(link)
            is_merged = self.merged_into[link] != link
            is_geared = bool(self.coupled & set(numbers))
            is_needed = link in self.preserved or is_merged or is_geared
            if masses_kg[link] < _ROD_KG and not is_needed:
                yield link, numbers

    def find_rods(self) -> None:
        """Turn the lightest links of closed loops between two pins, or two balls, into rods."""
        for link, numbers in self._light_links():
            if len(numbers) != 2:
                continue
            first, second = (self.hinges[number] for number in numbers)
            sine = np.linalg.norm(np.cross(first.axis, second.axis))
            is_parallel = sine < 0.02 and not share_axis(first, second)
            is_between_balls = first.is_ball and second.is_ball
            is_between_pins = is_parallel and not first.is_ball and not second.is_ball
            # A link between two such ends only keeps a distance if it is part of a loop; elsewhere
            # it swings.
            is_between_ends = is_between_balls or is_between_pins
            if not is_between_ends or self._stands_out(link, first, second):
                continue
            if self._is_in_loop(link, numbers):
                self.rods.append((link, first, second))
                for number in numbers:
                    del self.hinges[number]

    def _stands_out(
        self,
        link: int,
        first: Hinge,
        second: Hinge,
    ) -> bool:
        """Whether a link is more than what lies between its two pins or balls: a leg has its foot
        elsewhere."""
        # A pin may be longer than its holes, which says nothing: what counts lies across it.
        flat = np.eye(3) if first.is_ball else np.eye(3) - np.outer(first.axis, first.axis)
        way_m = flat @ (second.point_m - first.point_m)
        own = np.flatnonzero(self.merged_into == link)
        parts = [part for number in own for part in self.mechanism.links[number].parts]
        corners_m = np.concatenate([self.mechanism.corners_m[part] for part in parts])
        offsets_m = (corners_m - first.point_m) @ flat  # [n, 3]
        shares = np.clip(offsets_m @ way_m / (way_m @ way_m), 0.0, 1.0)
        nearest_m = np.outer(shares, way_m)
        from_way_m = np.linalg.norm(offsets_m - nearest_m, axis=1)
        return bool(from_way_m.max() > _ROD_HALF_M)

    def _is_in_loop(
        self,
        link: int,
        numbers: list[int],
    ) -> bool:
        """Whether the link's neighbours are connected without it."""
        others = self.hinges.keys() - set(numbers)
        neighbours = graph_of(self._ends(self.hinges[number]) for number in others)
        first, second = (self.hinges[number] for number in numbers)
        start = self._other_end(first, link)
        end = self._other_end(second, link)
        return end in reached([start], neighbours)

    def _other_end(
        self,
        hinge: Hinge,
        link: int,
    ) -> int:
        """The first link of a hinge that is not this one."""
        return next(other for other in self._ends(hinge) if other != link)

    def _ends(self, hinge: Hinge) -> tuple[int, int]:
        """The two links of a hinge."""
        return int(self.merged_into[hinge.parent]), int(self.merged_into[hinge.child])

    def result(self) -> Articulation:
        """The tree of the remaining links from the first body on, and the loops."""
        mechanism = self.mechanism
        base = int(self.merged_into[mechanism.fixed or 0])
        order, tree, loops = self._tree(base)
        # A merged link is on the body that it was merged into; a link that is not connected is on
        # none.
        body_of: dict[int, int] = {}
        for link, root in enumerate(self.merged_into.tolist()):
            if root in order:
                body_of[link] = order.index(root)
        joints = {number: _joint(self.hinges[number], body_of) for number in (*tree, *loops)}
        # A shaft's axis points outwards, so clockwise, seen from outside, is negative about it.
        flipped = {number: replace(joint, axis=-joint.axis) for number, joint in joints.items()}
        drives = []
        geared = []
        for train in self.trains:
            armature = self.armature[train.port]
            joint = flipped[train.output]
            drives.append(
                Drive(
                    train.port,
                    joint,
                    1.0 / train.ratio,
                    armature,
                    train.teeth,
                )
            )
            for number, ratio in train.others:
                # Hinges that are no joints any more have become followers.
                if number in joints:
                    geared.append(Geared(train.port, flipped[number], ratio / train.ratio))
        followers = []
        for link, hinge, port, ratio in self.followers:
            parts = mechanism.links[link].parts
            point_m = hinge.point_m
            followers.append(
                Follower(
                    body_of[link],
                    parts,
                    point_m,
                    hinge.axis,
                    port,
                    ratio,
                )
            )
        rods = tuple(
            _rod(
                mechanism.links[link],
                first,
                second,
                link,
                body_of,
            )
            for link, first, second in self.rods
        )
        swings = tuple(joints[number] for number in tree if number not in self.coupled)
        made = Articulation(
            bodies=self._bodies(len(order), body_of, rods),
            is_fixed=mechanism.fixed is not None,
            drives=tuple(drives),
            geared=tuple(geared),
            swings=swings,
            loops=tuple(joints[number] for number in loops),
            followers=tuple(followers),
            rods=rods,
            wheels=tuple(replace(wheel, link=body_of[wheel.link]) for wheel in mechanism.wheels),
        )
        if not self.opened.meshes:
            return made
        return _coupled(made, self.opened, body_of)

    def _tree(self, base: int) -> tuple[list[int], list[int], list[int]]:
        """The links from the first body on, parents first; the hinges of their tree, each with the
        link that it adds; and the hinges that close loops."""
        order = [base]
        tree: list[int] = []
        # A motor can only turn a joint of the tree, because what closes a loop is a constraint. So
        # geared hinges are taken into the tree first.
        remaining = sorted(self.hinges, key=lambda number: number not in self.coupled)
        if self.opened.meshes:
            # A wheel of a differential hangs on the chassis, not on the other wheel's axle.
            nearness = self._nearness(base)
            remaining.sort(key=lambda number: (number not in self.coupled, nearness[number]))
        while remaining:
            number = self._next_hinge(remaining, order)
            if number is None:
                break
            remaining.remove(number)
            ends = self._ends(self.hinges[number])
            order.append(next(link for link in ends if link not in order))
            tree.append(number)
        # Hinges of what is not connected to the base remain too, but are no loops.
        loops = [
            number for number in remaining if set(self._ends(self.hinges[number])) <= set(order)
        ]
        return order, tree, loops

    def _nearness(self, base: int) -> dict[int, int]:
        """How many hinges are between the first body and each hinge, by the fewest."""
        near = {base}
        nearness: dict[int, int] = {}
        for distance in range(len(self.hinges)):
            for number, hinge in self.hinges.items():
                if number not in nearness and near & set(self._ends(hinge)):
                    nearness[number] = distance
            near.update(end for number in nearness for end in self._ends(self.hinges[number]))
        # What is not connected to the first body comes last.
        return {number: nearness.get(number, len(self.hinges)) for number in self.hinges}

    def _next_hinge(
        self,
        remaining: list[int],
        order: list[int],
    ) -> int | None:
        """The first hinge between a link that is in the tree and one that is not."""
        for number in remaining:
            first, second = self._ends(self.hinges[number])
            if (first in order) != (second in order):
                return number
        return None

    def _bodies(
        self,
        count: int,
        body_of: dict[int, int],
        rods: tuple[Rod, ...],
    ) -> tuple[Link, ...]:
        """The bodies: their links, and half of the mass of each rod at either of its ends."""
        links = self.mechanism.links
        pieces: list[list[Link]] = [[] for _ in range(count)]
        for link, number in body_of.items():
            pieces[number].append(links[link])
        for rod, (link, _, _) in zip(rods, self.rods, strict=True):
            half_kg = links[link].mass_kg / 2
            for number, point_m in ((rod.near, rod.near_m), (rod.far, rod.far_m)):
                pieces[number].append(Link((), half_kg, point_m, np.zeros((3, 3))))
        return tuple(merged(body_pieces) for body_pieces in pieces)


def _coupled(
    made: Articulation,
    opened: OpenGears,
    body_of: dict[int, int],
) -> Articulation:
    """An articulation with the couplings of its open gears."""
    joints = made.joints
    joint_of = {joint.child: joint for joint in joints}
    bodies = {body_of[link] for link in opened.links if link in body_of}

    def is_redundant(loop: Hinge) -> bool:
        # An axle in a differential and in a beam is held twice on one line.
        ends = {loop.parent, loop.child}
        ways = [set(way_to(joint_of, end)) for end in ends]
        between = set.symmetric_difference(*ways)
        is_coaxial = all(share_axis(loop, joint_of[body]) for body in between)
        return is_coaxial and not ends.isdisjoint(bodies)

    return replace(
        made,
        loops=tuple(loop for loop in made.loops if not is_redundant(loop)),
        couplings=couplings_of(joints, opened.meshes, body_of),
    )


def _joint(hinge: Hinge, body_of: dict[int, int]) -> Hinge:
    """A hinge between bodies; the child is the later body, and the axis is reversed if that was the
    parent."""
    parent = body_of[hinge.parent]
    child = body_of[hinge.child]
    sign = 1 if parent < child else -1
    return replace(
        hinge,
        parent=min(parent, child),
        child=max(parent, child),
        axis=sign * hinge.axis,
    )


def _rod(
    link: Link,
    first: Hinge,
    second: Hinge,
    number: int,
    body_of: dict[int, int],
) -> Rod:
    """A link as a rod. Of two pins, the second is moved into the plane of the first one."""
    near = first.parent if first.child == number else first.child
    far = second.parent if second.child == number else second.child
    shift = 0.0
    if not first.is_ball:
        shift = float((second.point_m - first.point_m) @ first.axis)
    far_m = second.point_m - shift * first.axis
    return Rod(
        body_of[near],
        first.point_m,
        body_of[far],
        far_m,
        link.parts,
    )
