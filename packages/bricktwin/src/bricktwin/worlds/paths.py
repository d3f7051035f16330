"""Paths on the floor: polylines whose corners are arcs."""

import itertools
import math

from bricktwin.twin.objects import Point

_STEP_DEG = 7.5
"""Turn between two points of an arc: on one of 250 mm the line is 0.5 mm off."""


def rounded(
    corners: tuple[Point, ...],
    radius_mm: float,
    *,
    closed: bool = False,
) -> tuple[Point, ...]:
    """Points of a path through corners, each replaced by an arc of this radius, or of the largest
    that fits. The first and the last corner of an open path stay."""
    if closed:
        ring = (corners[-1], *corners, corners[0])
        inner = list(
            zip(
                ring,
                ring[1:],
                ring[2:],
                strict=False,
            )
        )
        points: list[Point] = []
    else:
        inner = list(
            zip(
                corners,
                corners[1:],
                corners[2:],
                strict=False,
            )
        )
        points = [corners[0]]
    for before, corner, after in inner:
        points += _arc(
            before,
            corner,
            after,
            radius_mm,
        )
    if not closed:
        points.append(corners[-1])
    return tuple(points)


def _arc(
    before: Point,
    corner: Point,
    after: Point,
    radius_mm: float,
) -> list[Point]:
    """Points of the arc that replaces a corner."""
    way_in = math.dist(before, corner)
    way_out = math.dist(corner, after)
    angle_in = math.atan2(corner[1] - before[1], corner[0] - before[0])
    angle_out = math.atan2(after[1] - corner[1], after[0] - corner[0])
    turn = (angle_out - angle_in + math.pi) % math.tau - math.pi
    # The arc touches both sides at this distance from the corner; a side is shared by two.
    reach = min(radius_mm * math.tan(abs(turn) / 2), way_in / 2, way_out / 2)
    if reach < 1e-6:
        return [corner]
    radius = reach / math.tan(abs(turn) / 2)
    side = math.copysign(1.0, turn)
    start_x = corner[0] - reach * math.cos(angle_in)
    start_y = corner[1] - reach * math.sin(angle_in)
    middle_x = start_x - side * radius * math.sin(angle_in)
    middle_y = start_y + side * radius * math.cos(angle_in)
    steps = max(2, math.ceil(math.degrees(abs(turn)) / _STEP_DEG))
    points = []
    for step in range(steps + 1):
        angle = angle_in + turn * step / steps
        x = middle_x + side * radius * math.sin(angle)
        y = middle_y - side * radius * math.cos(angle)
        points.append((round(x, 2), round(y, 2)))
    return points


def pieces(points: tuple[Point, ...], gaps_mm: tuple[Point, ...]) -> list[tuple[Point, ...]]:
    """Pieces of an open path between gaps, given by where each begins and ends along the path, in
    order."""
    made: list[tuple[Point, ...]] = []
    current = [points[0]]
    way_mm = 0.0
    # The ends of gaps in turn: a piece ends at the first, the next begins at the second.
    ends_mm = [end for gap in gaps_mm for end in gap]
    for start, end in itertools.pairwise(points):
        length = math.dist(start, end)
        while ends_mm and ends_mm[0] <= way_mm + length:
            share = (ends_mm.pop(0) - way_mm) / length
            x = start[0] + share * (end[0] - start[0])
            y = start[1] + share * (end[1] - start[1])
            place = (round(x, 2), round(y, 2))
            if len(ends_mm) % 2 == 1:
                made.append((*current, place))
            current = [place]
        current.append(end)
        way_mm += length
    made.append(tuple(current))
    return made
