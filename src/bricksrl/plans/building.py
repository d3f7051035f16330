"""Check of building steps: each new part connects to the assembly and has a free path to its place.

A step is tried backwards: its parts are removed one after the other, each along a straight line.
"""

from __future__ import annotations

import enum
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from bricksrl.plans.connections import Connection
from bricksrl.plans.contact import Occupancy
from bricksrl.plans.geometry import Bools, Floats
from bricksrl.plans.plan import Plan, Step

_MAX_QUERIES, _MAX_ITEMS = 6000, 60
"""Limits of the search: collision queries per plan, parts per step."""
_PATH_LDU = (5.0, 11.0, 17.0, 24.0, 34.0, 46.0, 70.0, 110.0, 170.0)
"""Distances at which a path is checked; 5 LDU is more than the tolerance of the collision test."""


class Trouble(enum.Enum):
    """Reasons why a step fails."""

    UNCONNECTED = "is not connected to the assembly"
    BLOCKED = "has no free path to its place"
    UNCHECKED = "and the others are too many to check"


@dataclass(frozen=True)
class StepTrouble:
    """Parts of a step that cannot be placed."""

    step: Step
    parts: tuple[int, ...]
    kind: Trouble


def step_troubles(plan: Plan, found: Sequence[Connection], room: Occupancy) -> list[StepTrouble]:
    """All steps that fail. Parts with unmodelled connections, such as tyres, count as connected."""
    beside: dict[int, set[int]] = defaultdict(set)
    axes: dict[int, list[Floats]] = defaultdict(list)
    for link in found:
        beside[link.male].add(link.female)
        beside[link.female].add(link.male)
        axes[link.male].append(link.axis)
        axes[link.female].append(link.axis)
    troubles: list[StepTrouble] = []
    built: dict[tuple[str, ...], set[int]] = defaultdict(set)
    for step in plan.steps:
        before = set(built[step.assembly])
        items = [(part,) for part in step.new] + list(step.joined)
        now = before | {part for item in items for part in item}
        built[step.assembly] = now
        troubles += _unconnected(plan, step, items, before, now, beside)
        if len(items) > _MAX_ITEMS or room.queries > _MAX_QUERIES:
            troubles.append(StepTrouble(step, items[0][:1], Trouble.UNCHECKED))
            continue
        stuck = _blocked(items, now, room, axes, beside, len(plan.parts))
        if stuck:
            troubles.append(StepTrouble(step, stuck, Trouble.BLOCKED))
    return troubles


def _unconnected(
    plan: Plan, step: Step, items: Sequence[tuple[int, ...]], before: set[int], now: set[int], beside: dict[int, set[int]]
) -> list[StepTrouble]:
    """Parts that are not connected to the rest after the step."""
    start = (
        min(before) if before else max((part for item in items for part in item), key=lambda part: plan.parts[part].part.mass_g)
    )
    seen, waiting = {start}, [start]
    while waiting:
        fresh = (beside[waiting.pop()] & now) - seen
        seen |= fresh
        waiting += fresh
    lost = tuple(part for item in items for part in item if part not in seen and not plan.parts[part].part.is_loose)
    return [StepTrouble(step, lost, Trouble.UNCONNECTED)] if lost else []


def _blocked(
    items: Sequence[tuple[int, ...]],
    now: set[int],
    room: Occupancy,
    axes: dict[int, list[Floats]],
    beside: dict[int, set[int]],
    count: int,
) -> tuple[int, ...]:
    """Parts of a step without a free straight path."""
    present = np.zeros(count, dtype=bool)
    present[list(now)] = True
    left = list(items)
    if len(left) == len(now):  # the first step: its first item lies on the table
        left = left[1:]
    moved = True
    while left and moved and room.queries <= _MAX_QUERIES:
        moved = False
        for group in _groups(left, beside):
            parts = [part for item in group for part in item]
            if _is_removable(parts, present, room, _directions(parts, axes)):
                present[parts] = False
                left = [item for item in left if item not in group]
                moved = True
                break
    return tuple(part for item in left for part in item)


def _groups(left: Sequence[tuple[int, ...]], beside: dict[int, set[int]]) -> Iterable[list[tuple[int, ...]]]:
    """Groups to remove together: each item, each with the new items that it touches, all items."""
    for item in reversed(left):
        yield [item]
    for item in reversed(left):
        touched = {other for part in item for other in beside[part]}
        together = [other for other in left if other == item or touched & set(other)]
        if 1 < len(together) < len(left):
            yield together
    if len(left) > 1:
        yield list(left)


def _directions(parts: Sequence[int], axes: dict[int, list[Floats]]) -> list[Floats]:
    """Directions to try: along the connections, then along the plan's axes."""
    ways: list[Floats] = []
    for axis in [axis for part in parts for axis in axes[part]] + list(np.eye(3)):
        if not any(abs(float(axis @ way)) > 0.999 for way in ways):
            ways.append(axis)
    return [sign * way for way in ways for sign in (1.0, -1.0)]


def _is_removable(parts: Sequence[int], present: Bools, room: Occupancy, ways: Sequence[Floats]) -> bool:
    others = present.copy()
    others[list(parts)] = False
    return any(all(room.is_free(parts, others, way * far) for far in _PATH_LDU) for way in ways)
