"""Whether a dataset is what it says: every file, every digest, every step."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bricksrl.data.edit import read_episodes
from bricksrl.data.files import LOCK, TEMPORARY_PREFIX
from bricksrl.data.index import Index, left_over, read_all_rows, read_index
from bricksrl.data.layout import NEXT, OBSERVATION, FileIndex
from bricksrl.errors import DataError

_CARD = "README.md"


def check(root: Path) -> list[str]:
    """What is wrong with a dataset, a line each; nothing when all is well. Nothing is changed, and no foreign file is opened.

    Raises:
        DataError: there is no dataset of ours.
    """
    index = read_index(root)
    return [*_steps(index), *_files(index)]


def _steps(index: Index) -> Iterator[str]:
    for row in index.rows:
        try:
            columns = next(read_episodes(index, [row])).columns
        except DataError as error:
            yield f"episode {row.episode}: {error}"
            continue
        if not np.array_equal(columns[OBSERVATION][1:], columns[NEXT][:-1], equal_nan=True):
            yield f"episode {row.episode}: an observation is not what followed the step before"
        done = columns["next.terminated"] | columns["next.truncated"]
        if done[:-1].any() or not done[-1] or not np.array_equal(done, columns["next.done"]):
            yield f"episode {row.episode}: its end is marked elsewhere than at its last step"
        if not np.isclose(columns["next.reward"].sum(dtype=np.float64), row.return_, rtol=1e-5, atol=1e-5):
            yield f"episode {row.episode}: its return is not the sum of its rewards"
        if not all(np.isfinite(columns[name]).all() for name in (OBSERVATION, NEXT, "action", "next.reward")):
            yield f"episode {row.episode}: a number is none"


def _files(index: Index) -> Iterator[str]:
    """Files that belong to nothing."""
    layout = index.layout
    known = {layout.info, layout.stats, layout.tasks, layout.description, layout.root / LOCK, layout.root / _CARD}
    key = index.description.image_key
    for row in index.rows:
        known.add(layout.data(row.data_file))
        if key is not None:
            known.add(layout.video(key, row.video_file or FileIndex()))
    at = FileIndex()
    while index.last_file is not None and at <= index.last_file:
        known.add(layout.episodes(at))
        at = at.next()
    for missing in sorted(path for path in (layout.stats, layout.tasks) if not path.exists()):
        yield f"{missing} is missing; run `bricksrl data repair {layout.root}`"
    beyond = len(read_all_rows(layout, index.description)[0]) - len(index.rows)
    unfinished = left_over(layout, index.description, index.last_file)
    if beyond:
        yield f"{beyond} recorded episodes are not in the index; run `bricksrl data repair {layout.root}`"
    for path in sorted(layout.root.rglob("*")):
        inside = path.relative_to(layout.root)
        if path.is_dir() or path in known or any(part.startswith(".") and part != path.name for part in inside.parts):
            continue
        if path.name.startswith(TEMPORARY_PREFIX) or path in unfinished:
            yield f"{inside} was left by a recording that was killed; run `bricksrl data repair {layout.root}`"
        elif not (beyond and inside.parts[0] in ("data", "videos")):
            yield f"{inside} is no file of a dataset; it was not opened"
