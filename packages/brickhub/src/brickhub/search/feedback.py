"""Linear feedback: actions are a matrix times what is observed, and an offset."""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass

from brickhub.entry import Entry
from brickhub.search.onboard.feed_back import feed_back
from brickhub.search.structure import formula_source

_feed_back: Callable[..., list[float]] = feed_back
_FEATURE_COLUMNS = "index of what is observed, factor, offset, whether it is an angle"


@dataclass(frozen=True)
class Feature:
    """What feedback reads: a number of order one, or the sine and the cosine of an angle.

    Attributes:
        index: of the number among what is observed.
        factor, offset: to -1..1, or to radians.
        is_angle: whether it wraps.
    """

    index: int
    factor: float = 1.0
    offset: float = 0.0
    is_angle: bool = False


def feature_of(entry: Entry, index: int) -> Feature:
    """The feature of an observed number: a bounded one is scaled to -1..1, an unbounded one
    unchanged."""
    if entry.wraps:
        return Feature(index, math.pi / 180.0, is_angle=True)
    span = entry.high - entry.low
    if not math.isfinite(span):
        return Feature(index)
    return Feature(index, 2.0 / span, -(entry.high + entry.low) / span)


class Feedback:
    """Linear feedback on features: the numbers are a matrix, row by row, whose last column is the
    offset.

    Args:
        features: what it reads.
        size: number of actions.
    """

    def __init__(self, features: Sequence[Feature], size: int) -> None:
        self.features = tuple(features)
        self.size = size
        self._rows = [astuple(feature) for feature in features]
        width = 1 + sum(2 if feature.is_angle else 1 for feature in features)
        places = itertools.product(range(size), range(width))
        self.numbers = tuple(Entry(f"weight_{row}_{column}", -1.0, 1.0) for row, column in places)

    def act(
        self,
        observed: Sequence[float],
        numbers: Sequence[float],
    ) -> list[float]:
        """Actions ``[m]`` on an observation ``[n]`` by numbers ``[p]``."""
        return _feed_back(
            self._rows,
            self.size,
            observed,
            numbers,
        )

    def hub_source(self) -> str:
        """MicroPython that defines ``act_by(observed, numbers)``, as `act`."""
        lines = [
            formula_source("feed_back"),
            f"SIZE = {self.size}",
            f"FEATURES = (  # {_FEATURE_COLUMNS}",
        ]
        for feature in self.features:
            lines.append(
                f"    ({feature.index}, {feature.factor:.6g}, {feature.offset:.6g}, "
                f"{feature.is_angle}),"
            )
        lines += [
            ")",
            "",
            "",
            "def act_by(observed, numbers):",
            "    return feed_back(FEATURES, SIZE, observed, numbers)",
        ]
        return "\n".join(lines) + "\n"
