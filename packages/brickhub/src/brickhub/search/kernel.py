"""Kernel: how much the scores of two trials are expected to have in common.

It is the squared exponential of the distance, for angles the periodic kernel (MacKay, 1998). All
worlds share the process of the first one, 0; a later one has a level and a process of its own on
top, which varies faster.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from brickhub.entry import Entry

REACH = 0.3
"""Lengths of what is peculiar to a later world, as a share of those that all worlds share."""
LEVEL = 0.5
"""Level of a later world, as a share of the amplitude."""
_SHARPER = 1.0 / REACH**2
"""Power of an exponential whose length is `REACH` times as long."""
_LEAST_NOISE = 1e-8
"""Variance that keeps equal rows apart: those of a trial that was repeated."""

Point = tuple[float, ...]
"""Numbers as a place: of an angle that wraps its cosine and sine, of others -1..1."""


def place_of(numbers: Sequence[float], entries: Sequence[Entry]) -> Point:
    """Place of numbers ``[p]``."""
    place: list[float] = []
    for number, entry in zip(numbers, entries, strict=True):
        share = 2.0 * (number - entry.low) / (entry.high - entry.low) - 1.0
        if entry.wraps:
            place += [math.cos(math.pi * share), math.sin(math.pi * share)]
        else:
            place.append(share)
    return tuple(place)


@dataclass(frozen=True)
class Scales:
    """Scales of the kernel, for scores of variance 1.

    Attributes:
        lengths: of each number, in half ranges or in radians: trials that are this far apart have
            little in common.
        peculiar: amplitude of what is peculiar to a later world, as a share of ``amplitude``.
        amplitude: standard deviation of the process.
        noise: standard deviation of a trial's score.
    """

    lengths: tuple[float, ...]
    peculiar: float
    amplitude: float
    noise: float

    @classmethod
    def of_logarithms(cls, logarithms: Sequence[float]) -> "Scales":
        """Scales of their logarithms ``[p + 3]``, in the order of the attributes."""
        *lengths, peculiar, amplitude, noise = map(math.exp, logarithms)
        return cls(
            tuple(lengths),
            peculiar,
            amplitude,
            noise,
        )

    @property
    def noise_variance(self) -> float:
        """Variance of a trial's score, from noise."""
        return self.noise**2 + _LEAST_NOISE

    def variance(self, world: int) -> float:
        """Variance of the process in a world, without noise."""
        own = LEVEL**2 + self.peculiar**2 if world > 0 else 0.0
        return self.amplitude * self.amplitude * (1.0 + own)

    def covariance(self, near: float, is_same_later_world: bool) -> float:
        """Covariance of two trials, ``near`` of which is the exponential of their distance."""
        if is_same_later_world:
            near += LEVEL**2 + self.peculiar**2 * math.pow(near, _SHARPER)
        return self.amplitude**2 * near

    def slope(self, near: float, is_same_later_world: bool) -> float:
        """Change of `covariance` with half of the squared distance, the other way round."""
        if is_same_later_world:
            near += _SHARPER * self.peculiar**2 * math.pow(near, _SHARPER)
        return self.amplitude**2 * near

    def peculiar_part(self, near: float) -> float:
        """Covariance of two trials by what is peculiar to their later world."""
        part = self.amplitude * self.peculiar
        return part * part * math.pow(near, _SHARPER)


def stretched(point: Point, entries: Sequence[Entry], scales: Scales) -> Point:
    """A place in units of the lengths."""
    stretches: list[float] = []
    for entry, length in zip(entries, scales.lengths, strict=True):
        # An angle has two coordinates, of one length.
        stretches += [1.0 / length] * (2 if entry.wraps else 1)
    return tuple(map(float.__mul__, point, stretches))


def nearness(first: Point, second: Point) -> float:
    """Exponential of the distance of two places, 1 for one place."""
    return math.exp(-0.5 * math.dist(first, second) ** 2)
