"""Lines of chains."""

from __future__ import annotations

import math

import numpy as np

PITCH = 16.0


def chain(first: tuple[float, float, int], second: tuple[float, float, int], y: float) -> list[str]:
    """Chain links around two gears with vertical axes, each given with x, z and its teeth; the
    second lies at a larger z."""
    (x, z, teeth), (x2, z2, teeth2) = first, second
    radius, radius2 = (PITCH / 2 / math.sin(2 * math.pi / count) for count in (teeth, teeth2))
    distance = math.hypot(x2 - x, z2 - z)
    lean = math.acos((radius - radius2) / distance)
    heading = math.atan2(x2 - x, z2 - z)
    steps = np.linspace(0.0, 1.0, 400)
    around = [
        (x, z, radius, heading + lean + steps * 2 * (math.pi - lean)),
        (x2, z2, radius2, heading - lean + steps * 2 * lean),
    ]
    path = np.concatenate(
        [np.stack([a + r * np.sin(ways), b + r * np.cos(ways)], axis=1) for a, b, r, ways in around]
    )
    path = np.concatenate([path, path[:1]])
    covered = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    count = round(covered[-1] / PITCH)
    places = [
        np.interp(covered[-1] * np.arange(count) / count, covered, path[:, axis]) for axis in (0, 1)
    ]
    points = np.stack(places, axis=1)
    ways = np.roll(points, -1, axis=0) - points
    lines = []
    for (a, b), (along, ahead) in zip(
        points, ways / np.linalg.norm(ways, axis=1)[:, None], strict=True
    ):
        # The pin (x) is vertical, the link (z) points to the next one.
        lines.append(
            f"1 0 {a:.3f} {y} {b:.3f} 0 {ahead:.5f} {along:.5f} 1 0 0 0 {-along:.5f} {ahead:.5f} "
            "3711.dat"
        )
    return lines
