"""Selection of episodes of a dataset: by number, success, return and length."""

import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from bricksrl.data.dataset import EpisodeRow
from bricksrl.errors import DataError, counted


@dataclass(frozen=True)
class Selection:
    """Conditions on episodes; an episode is selected if it meets all that are given.

    Attributes:
        episodes: numbers from 0, as in `bricksrl data info` and LeRobot, with ranges: ``0-9,12``;
            empty for all.
        success: whether the task was solved; an episode of a task without success meets neither.
        whole: whether it ran to its end, and was not broken off.
        return_min, return_max: bounds of the return, included.
        steps_min, steps_max: bounds of the length, included.
    """

    episodes: str = ""
    success: bool | None = None
    whole: bool | None = None
    return_min: float = -math.inf
    return_max: float = math.inf
    steps_min: int = 0
    steps_max: int | None = None

    def choose(self, rows: Iterable[EpisodeRow]) -> set[int]:
        """Numbers of the episodes that meet the conditions. Raises DataError if a number is none of
        the dataset's, a range is none, or no condition is given."""
        if self == Selection():
            raise DataError(
                "no condition is given; name --episodes, --success, --whole, or bounds of the "
                "return or the steps"
            )
        all_rows = list(rows)
        named = set(_numbers_of(self.episodes, len(all_rows)))
        return {
            row.episode
            for row in all_rows
            if (not self.episodes or row.episode in named) and self._meets(row)
        }

    def _meets(self, row: EpisodeRow) -> bool:
        if self.success is not None and row.about.success is not self.success:
            return False
        if self.whole is not None and row.about.whole is not self.whole:
            return False
        longest = math.inf if self.steps_max is None else self.steps_max
        is_long_enough = self.steps_min <= row.length <= longest
        return is_long_enough and self.return_min <= row.return_ <= self.return_max


def _numbers_of(text: str, count: int) -> Iterator[int]:
    """Numbers in a text like ``0-9,12``. Raises DataError."""
    for part in text.split(",") if text else ():
        found = re.fullmatch(r"\s*([0-9]{1,9})(?:\s*-\s*([0-9]{1,9}))?\s*", part)
        if found is None:
            raise DataError(f"'{part.strip()}' is no episode; write numbers and ranges: 0-9,12")
        first = int(found[1])
        last = int(found[2] or first)
        if last < first:
            raise DataError(f"{first}-{last} runs backwards; write {last}-{first}")
        # A number too many is a slip that would silently keep too little.
        if last >= count:
            raise DataError(
                f"there is no episode {last} among {counted(count, 'episode')}, which begin at 0; "
                "`bricksrl data info` counts them"
            )
        yield from range(first, last + 1)
