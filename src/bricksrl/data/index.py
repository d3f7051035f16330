"""A dataset as its index has it: the description and the rows of all episodes that were committed."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bricksrl.data.description import Description
from bricksrl.data.episode import EpisodeRow
from bricksrl.data.files import write_durably
from bricksrl.data.layout import CODEBASE_VERSION, DATA_PATH, FileIndex, Layout, features, info
from bricksrl.data.rows import read_rows
from bricksrl.data.tables import join_statistics
from bricksrl.errors import DataError


@dataclass(frozen=True)
class Index:
    """What a dataset holds.

    Attributes:
        rows: of its episodes, in order; they lie one after the other.
        last_file: of the files with rows; ``None`` where there is none.
    """

    layout: Layout
    description: Description
    rows: tuple[EpisodeRow, ...]
    last_file: FileIndex | None

    @property
    def steps(self) -> int:
        """Of all episodes."""
        return sum(row.length for row in self.rows)


def is_dataset(root: Path) -> bool:
    """Whether one was begun there."""
    return Layout(root).description.exists() or Layout(root).info.exists()


def read_index(root: Path) -> Index:
    """The index of the dataset in the folder ``root``.

    Raises:
        DataError: there is none, it is damaged, or it was made by something else.
    """
    layout = Layout(root)
    if not layout.info.exists():
        raise DataError(f"there is no dataset in {root}; choose a folder with a meta/info.json")
    if not layout.description.exists():
        raise DataError(f"the dataset in {root} was not made by BricksRL: it has no meta/bricksrl.json; choose another")
    description = read_description(layout)
    episodes = read_episode_count(layout, description)
    rows, last = read_all_rows(layout, description)
    rows = rows[:episodes]  # what lies behind was on its way when its writer was killed
    check_order(rows, episodes, layout)
    return Index(layout, description, tuple(rows), last)


def read_description(layout: Layout) -> Description:
    """What ``meta/bricksrl.json`` says."""
    try:
        return Description.from_json(layout.description.read_bytes(), str(layout.description))
    except OSError as error:
        raise DataError(f"cannot read {layout.description} ({error.strerror}); restore it from a copy") from None


def read_episode_count(layout: Layout, description: Description) -> int:
    """Number of episodes that were committed."""
    try:
        found = json.loads(layout.info.read_bytes())
    except OSError as error:
        raise DataError(f"cannot read {layout.info} ({error.strerror}); restore it from a copy") from None
    except (ValueError, RecursionError):
        raise DataError(f"{layout.info} is no JSON; restore it, or run `bricksrl data repair {layout.root}`") from None
    if not isinstance(found, dict) or found.get("codebase_version") != CODEBASE_VERSION:
        raise DataError(f"{layout.info} is of no dataset in LeRobot's format {CODEBASE_VERSION}; choose another")
    if found.get("features") != features(description) or found.get("data_path") != DATA_PATH:
        raise DataError(f"{layout.info} and {layout.description.name} disagree about the columns; restore both from one copy")
    episodes = found.get("total_episodes")
    if type(episodes) is not int or episodes < 0:
        raise DataError(f"{layout.info} does not say how many episodes there are; run `bricksrl data repair {layout.root}`")
    return episodes


def read_all_rows(layout: Layout, description: Description) -> tuple[list[EpisodeRow], FileIndex | None]:
    """The rows of all files in a row, those of an unfinished commit included, and the last of the files."""
    rows: list[EpisodeRow] = []
    at, last = FileIndex(), None
    while layout.episodes(at).exists():
        rows += read_rows(layout.episodes(at), description)
        at, last = at.next(), at
    return rows, last


def left_over(layout: Layout, description: Description, last: FileIndex | None) -> list[Path]:
    """Files of an episode that no row tells of: its writer was killed before that."""
    at = FileIndex() if last is None else last.next()
    if layout.data(at.next()).exists() or layout.episodes(at.next()).exists():
        return []  # a writer leaves one at most: here something else is missing
    paths = [layout.data(at)] if description.image_key is None else [layout.data(at), layout.video(description.image_key, at)]
    return [path for path in paths if path.exists()]


def check_order(rows: Sequence[EpisodeRow], episodes: int, layout: Layout) -> None:
    """Raise DataError unless the rows are those of ``episodes`` episodes, one after the other."""
    start = 0
    for number, row in enumerate(rows):
        if row.episode != number or row.start != start:
            raise DataError(f"the rows in {layout.root / 'meta/episodes'} are not in order at episode {number}; restore them")
        start += row.length
    if len(rows) != episodes:
        raise DataError(
            f"{layout.info} counts {episodes} episodes and meta/episodes holds {len(rows)}; "
            f"restore it from a copy, or run `bricksrl data repair {layout.root}`"
        )


def write_index(layout: Layout, description: Description, rows: Sequence[EpisodeRow]) -> None:
    """Write what counts and joins all episodes; the count comes last, and with it the newest episode exists."""
    write_durably(layout.stats, to_json(join_statistics([row.statistics for row in rows])))
    write_durably(layout.info, to_json(info(description, len(rows), sum(row.length for row in rows))))


def to_json(value: Any) -> bytes:
    """As LeRobot writes it."""
    return (json.dumps(value, indent=4) + "\n").encode()
