"""Chains: closed loops of links around gears, which turn them at the ratio of their teeth. LDraw units, plan frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from bricktwin.plans.connections import Mesh
from bricktwin.plans.geometry import Floats
from bricktwin.plans.part import Gear, GearForm
from bricktwin.plans.plan import Placed

PITCH = 16.0
"""Length of a link, along its z axis; it spans two teeth."""
_TOLERANCE = 1.5
"""Offset of a link from the previous one, and from the circle on which it lies around a gear."""


def chain_meshes(parts: Sequence[Placed]) -> list[Mesh]:
    """The gears in each closed chain, in pairs."""
    gears = [(placed, gear) for placed in parts for gear in placed.part.gears if gear.form is GearForm.SPUR]
    meshes = []
    for points, axis in _loops(parts):
        driven = [(placed, gear) for placed, gear in gears if _is_driven(placed, gear, points, axis)]
        pairs = (_mesh(*first, *second, axis) for first, second in pairwise(driven))
        meshes += [mesh for mesh in pairs if mesh is not None]
    return meshes


def _loops(parts: Sequence[Placed]) -> list[tuple[Floats, Floats]]:
    """Points [n, 3] of each closed chain, one a link, and the direction of its pins [3]."""
    links = [placed for placed in parts if placed.part.family == "chains"]
    starts = np.array([link.position for link in links])
    next_link = {}
    for number, link in enumerate(links):
        distances = np.linalg.norm(starts - link.to_plan(np.array([[0.0, 0.0, PITCH]])), axis=1)
        if distances.min() < _TOLERANCE:
            next_link[number] = int(distances.argmin())
    remaining, loops = dict.fromkeys(range(len(links))), []
    while remaining:
        loop = [next(iter(remaining))]
        while loop[-1] in remaining:
            del remaining[loop[-1]]
            loop.append(next_link.get(loop[-1], -1))
        if loop[-1] == loop[0]:
            loops.append((starts[loop[:-1]], links[loop[0]].rotation[:, 0]))
    return loops


def _is_driven(placed: Placed, gear: Gear, points: Floats, axis: Floats) -> bool:
    """Whether a gear is inside a chain, and links lie on its teeth."""
    offset = points - placed.point(gear.centre)
    projected = offset - np.outer(offset @ axis, axis)
    radius = PITCH / 2 / math.sin(2 * math.pi / gear.teeth)  # a link is the chord of two teeth
    touching = np.abs(np.linalg.norm(projected, axis=1) - radius) < _TOLERANCE
    is_level = np.abs(offset @ axis).max() < gear.width / 2 and abs(placed.rotation @ np.array(gear.axis) @ axis) > 0.999
    after = np.roll(projected, -1, axis=0)
    winding = np.arctan2(np.cross(projected, after) @ axis, np.einsum("ij,ij->i", projected, after)).sum()
    return bool(is_level and np.count_nonzero(touching) >= 2 and abs(winding) > math.pi)


def _mesh(first: Placed, gear: Gear, second: Placed, other: Gear, axis: Floats) -> Mesh | None:
    """Two gears in a chain: where its straight part touches them, both move equally fast along it; ``None`` if one is inside
    the other."""
    start, end = first.point(gear.centre), second.point(other.centre)
    offset = (end - start) - ((end - start) @ axis) * axis
    distance = float(np.linalg.norm(offset))
    if distance <= abs(gear.pitch_radius - other.pitch_radius) + _TOLERANCE:
        return None
    sine = (gear.pitch_radius - other.pitch_radius) / distance
    outward = sine * offset / distance + math.sqrt(1 - sine**2) * np.cross(axis, offset / distance)
    tangent = np.cross(axis, outward)
    points = (start + gear.pitch_radius * outward, end + other.pitch_radius * outward)
    rows = [np.concatenate([tangent, np.cross(point, tangent)]) for point in points]
    return Mesh(first.index, second.index, (gear, other), 0.0, 1.0, points[0], np.stack([rows[0], -rows[1]]))
