"""Space that parts occupy: collisions, and free paths to their places in the building steps.

A part collides if sample points of it are inside the material of another; a hole is room for the
pin or axle that fits into it, and for nothing else. A step is tried backwards: its parts are
removed one after the other, each along a straight line.
"""

import enum
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np

from bricktwin.plans.connections import Connection, neighbours, open_holes, reached
from bricktwin.plans.geometry import Bools, Floats
from bricktwin.plans.plan import Placed, Plan, Step

_MARGIN = 0.8
"""Depth at which a point counts as inside, LDU. Together with the sampling depth, overlaps up to
0.7 mm are tolerated, because real parts are slightly smaller."""
_MIN_POINTS = 2
"""Least number of points inside of another part that make a collision."""
# These limits end the collision search, because a file may hold a heap of parts in one place.
_MAX_PAIRS = 200
"""Largest number of colliding pairs that are found."""
_MAX_COMPARED = 50_000
"""Largest number of pairs that are compared."""
# These limits end the search for paths, because its time grows with the number of trials.
_MAX_QUERIES = 6000
"""Largest number of collision queries for a plan."""
_MAX_ITEMS = 60
"""Largest number of parts in a step whose paths are searched."""
_SKIN = 1.5
"""Length by which the bounds of a part are made smaller (LDU) to find overlaps that are more than a
touch."""


class Occupancy:
    """Space occupied by the parts of a plan.

    Attributes:
        low, high: [n, 3], bounds of each part in the plan's frame.
        queries: number of calls of `is_free`; ``most_queries``: above it, no further paths are
            searched.
    """

    def __init__(
        self,
        parts: Sequence[Placed],
        most_queries: int = _MAX_QUERIES,
    ) -> None:
        self._parts = parts
        self.queries = 0
        self.most_queries = most_queries
        self.low: Floats = np.array([placed.bounds[0] for placed in parts]).reshape(-1, 3)
        self.high: Floats = np.array([placed.bounds[1] for placed in parts]).reshape(-1, 3)

    def collisions(self) -> list[tuple[int, int]]:
        """Pairs of colliding parts, the lower index first; at most 200."""
        colliding: list[tuple[int, int]] = []
        for index, other in islice(self._near_pairs(), _MAX_COMPARED):
            if self._hit(index, other):
                colliding.append((index, other))
                if len(colliding) == _MAX_PAIRS:
                    break
        return colliding

    def _near_pairs(self) -> Iterator[tuple[int, int]]:
        """Pairs of parts whose bounds overlap, the lower index first."""
        for index in range(len(self._parts)):
            after = index + 1
            for other in np.flatnonzero(self._near(index, np.zeros(3))[after:]):
                yield index, after + int(other)

    def _hit(
        self,
        index: int,
        other: int,
    ) -> bool:
        """Whether two parts collide where they are."""
        return self._collide(index, other, np.zeros(3))

    def is_free(
        self,
        group: Iterable[int],
        others: Bools,
        shift: Floats,
    ) -> bool:
        """Whether a group of parts, moved by ``shift``, collides with none of the parts in
        ``others`` [n]."""
        self.queries += 1
        for index in group:
            near = self._near(index, shift) & others
            if any(self._collide(index, int(other), shift) for other in np.flatnonzero(near)):
                return False
        return True

    def _near(
        self,
        index: int,
        shift: Floats,
    ) -> Bools:
        """Parts with bounds that overlap those of a moved part [n]."""
        low = self.low[index] + shift + _SKIN
        high = self.high[index] + shift - _SKIN
        overlaps = (low < self.high) & (self.low < high)  # [n, 3]
        return np.asarray(overlaps.all(axis=1))

    def _collide(
        self,
        index: int,
        other: int,
        shift: Floats,
    ) -> bool:
        families = {self._parts[index].part.family, self._parts[other].part.family}
        # Chain links are flexible and lie between teeth, so their overlaps are no collisions.
        if "chains" in families:
            return False
        # A tyre is no obstacle while it moves, because it gives way when it is pulled over its rim.
        if "tyres" in families and shift.any():
            return False
        return self._inside(index, other, shift) or self._inside(other, index, -shift)

    def _inside(
        self,
        index: int,
        other: int,
        shift: Floats,
    ) -> bool:
        """Whether points of a part, moved, lie in another."""
        points = self._parts[index].samples + shift  # [n, 3]
        # Most points are not even in the other part's box, and the test for that is cheap.
        is_in_box = (points > self.low[other]) & (points < self.high[other])
        near = is_in_box.all(axis=1)
        if np.count_nonzero(near) < _MIN_POINTS:
            return False
        target = self._parts[other]
        inner = target.to_part(points[near])
        holes = open_holes(self._parts[index], shift, target)
        # A large overlap needs no precise count, so a few of its points are enough.
        few = inner[::23]
        for sample in (few, inner):
            blocked = target.part.blocks(sample, _MARGIN, holes)
            if np.count_nonzero(blocked) >= _MIN_POINTS:
                return True
        return False


_PATH_LDU = (5.0, 11.0, 17.0, 24.0, 34.0, 46.0, 70.0, 110.0, 170.0)
"""Distances at which a path is checked; 5 LDU is more than the tolerance of the collision test."""


class Fault(enum.Enum):
    """Reasons why a step fails, and what to do."""

    UNCONNECTED = "is not connected to the assembly; connect it, or add it later"
    BLOCKED = "has no free path to its place; add it in an earlier step"
    UNCHECKED = "and the others are too many to check; split the step"


class StepFault(NamedTuple):
    """Parts of a step that cannot be placed."""

    step: Step
    parts: tuple[int, ...]
    kind: Fault


_Links = Mapping[int, list[tuple[int, Floats]]]
"""The connections of each part: the other part, and the direction [3] in which the part is drawn
out of it, or off it."""


class Move(NamedTuple):
    """Items of a step that are put in place together: new parts, one each, and the parts of
    sub-assemblies.

    Attributes:
        outward: free direction [3] away from their place; zero for what lies on the table, and
            where none is known.
    """

    items: tuple[tuple[int, ...], ...]
    outward: Floats

    @property
    def parts(self) -> list[int]:
        """Indices of all parts of the items."""
        return [part for item in self.items for part in item]


def links_of(parts: Sequence[Placed], connections: Iterable[Connection]) -> _Links:
    """The connections of each part. A pin is drawn out to the side where most of it is, because it
    has a collar there."""
    links: dict[int, list[tuple[int, Floats]]] = defaultdict(list)
    for link in connections:
        middle = np.mean(parts[link.male].bounds, axis=0)
        is_behind = float((middle - link.point) @ link.axis) < 0.0
        outward = link.axis * (-1.0 if is_behind else 1.0)
        links[link.male].append((link.female, outward))
        links[link.female].append((link.male, -outward))
    return links


def step_faults(
    plan: Plan,
    connections: Sequence[Connection],
    occupancy: Occupancy,
    groups: Sequence[frozenset[int]] = (),
) -> Iterator[StepFault]:
    """All steps that fail. Parts with unmodelled connections count as connected, and so do groups
    around unknown parts."""
    graph = neighbours(connections, groups)
    links = links_of(plan.parts, connections)
    built: dict[tuple[str, ...], set[int]] = defaultdict(set)
    for step in plan.steps:
        before = built[step.assembly]
        items = [step.new, *step.joined]
        new = [part for item in items for part in item]
        after = before | set(new)
        built[step.assembly] = after
        # In the first step nothing stands yet, so all of its parts must hang on its main part.
        starts = before or [_main_part(plan, new)]
        # Groups are nodes below 0 (see `neighbours`). They are always included, because they hold
        # their parts at all times.
        nodes = after | set(range(-len(groups), 0))
        graph_now = {node: [other for other in graph[node] if other in nodes] for node in nodes}
        held = reached(starts, graph_now)
        unheld = [part for part in new if part not in held]
        loose = tuple(part for part in unheld if not plan.parts[part].part.is_loose)
        if loose:
            yield StepFault(step, loose, Fault.UNCONNECTED)
        is_too_large = len(step.new) + len(step.joined) > _MAX_ITEMS
        if is_too_large or occupancy.queries > occupancy.most_queries:
            yield StepFault(step, (step.new or step.joined[0])[:1], Fault.UNCHECKED)
            continue
        _, blocked = moves_of(step, after, occupancy, links)
        if blocked:
            yield StepFault(step, blocked, Fault.BLOCKED)


def _main_part(plan: Plan, parts: Sequence[int]) -> int:
    """The heaviest part; one whose connections are not modelled, such as a ball in its cup, only if
    there is no other."""

    def rank(index: int) -> tuple[bool, float]:
        part = plan.parts[index].part
        return not part.is_loose, part.mass_g

    return max(parts, key=rank)


def moves_of(
    step: Step,
    after: set[int],
    occupancy: Occupancy,
    links: _Links,
) -> tuple[list[Move], tuple[int, ...]]:
    """The moves of a step in building order, and its parts without a free straight path, which come
    first.

    Args:
        after: parts of the assembly after the step.
    """
    items = [(part,) for part in step.new] + list(step.joined)
    present = np.zeros(len(occupancy.low), dtype=bool)
    present[list(after)] = True
    is_first = sum(len(item) for item in items) == len(after)
    # In the first step, the first item lies on the table and the others are put on it.
    on_table = items[:1] if is_first else []
    remaining = list(items[1:] if is_first else items)
    removed: list[Move] = []
    while remaining and occupancy.queries <= occupancy.most_queries:
        for group in _groups(remaining, links):
            parts = [part for item in group for part in item]
            others = present.copy()
            others[parts] = False
            outward = _free_direction(
                parts,
                others,
                occupancy,
                links,
            )
            if outward is not None:
                removed.append(Move(tuple(group), outward))
                present = others
                remaining = [item for item in remaining if item not in group]
                break
        else:
            # Nothing that is left can be removed.
            break
    unmoved = [Move((item,), np.zeros(3)) for item in on_table + remaining]
    blocked = tuple(part for item in remaining for part in item)
    # What was removed last is put in place first.
    return unmoved + removed[::-1], blocked


def _free_direction(
    parts: Sequence[int],
    others: Bools,
    occupancy: Occupancy,
    links: _Links,
) -> Floats | None:
    """The first direction [3] in which parts can be removed from others."""
    for direction in _directions(parts, links):
        # Distances are tried from near to far, so the search ends at the first one that is blocked.
        shifts = (direction * distance for distance in _PATH_LDU)
        if all(occupancy.is_free(parts, others, shift) for shift in shifts):
            return direction
    return None


def _groups(remaining: Sequence[tuple[int, ...]], links: _Links) -> Iterator[list[tuple[int, ...]]]:
    """Groups to remove together: each item, each with the new items that it touches, all items."""
    # The author's order is one way to build the model, so its reverse is the best guess for taking
    # it apart.
    for item in reversed(remaining):
        yield [item]
    for item in reversed(remaining):
        touched: set[int] = set()
        for part in item:
            touched.update(other for other, _ in links[part])
        group = [other for other in remaining if other == item or touched & set(other)]
        if 1 < len(group) < len(remaining):
            yield group
    if len(remaining) > 1:
        yield list(remaining)


def _directions(parts: Sequence[int], links: _Links) -> list[Floats]:
    """Directions to try: along the connections, then along the plan's axes."""
    axes: list[Floats] = []
    for part in parts:
        axes += [axis for other, axis in links[part] if other not in parts]
    axes += list(np.eye(3))
    # Most connections of a part are parallel and each trial costs queries, so each line is tried
    # once.
    directions: list[Floats] = []
    for axis in axes:
        if not any(abs(float(axis @ direction)) > 0.999 for direction in directions):
            directions.append(axis)
    return [sign * direction for direction in directions for sign in (1.0, -1.0)]
