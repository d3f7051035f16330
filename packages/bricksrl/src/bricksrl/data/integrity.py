"""Integrity check of a dataset: every file, digest and step."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from brickhub.files import LOCK, TEMPORARY_PREFIX, quoted
from bricksrl.data.episode_index import Index, read_all_rows, read_index, task_instruction, to_json, unfinished_files
from bricksrl.data.layout import NEXT, OBSERVATION, FileIndex, info
from bricksrl.data.parquet import has_task, join_statistics
from bricksrl.data.reader import EpisodeReader
from bricksrl.errors import DataError

_CARD = "README.md"


def check(root: Path) -> list[str]:
    """Faults of a dataset, one line each; empty if it is intact. Nothing is changed, and no foreign file is opened. Raises
    DataError if there is no dataset made by BricksRL."""
    index = read_index(root)
    return [*_steps(index), *_files(index), *_joint(index)]


def _steps(index: Index) -> Iterator[str]:
    reader = EpisodeReader(index)
    for row in index.rows:
        try:
            columns = reader.read(row).columns
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


def _joint(index: Index) -> Iterator[str]:
    """Faults of the files on all episodes (info, statistics, tasks), compared with the rows of the episodes."""
    layout, remedy = index.layout, f"run `bricksrl data repair {quoted(index.layout.root)}`"
    expected = info(index.description, len(index.rows), index.steps)
    stored = json.loads(layout.info.read_bytes())  # readable: `read_index` has parsed it
    for key in sorted(key for key in expected if key not in stored or stored[key] != expected[key]):
        yield f"{layout.info} says '{key}' is {stored.get(key)!r:.60}, and it is {expected[key]!r:.60}; {remedy}"
    if layout.stats.exists() and index.rows:
        try:
            statistics = json.loads(layout.stats.read_bytes())
        except (ValueError, RecursionError, OSError):
            statistics = None
        if not _same(statistics, json.loads(to_json(join_statistics([row.statistics for row in index.rows])))):
            yield f"{layout.stats} does not hold the statistics of the episodes; {remedy}"
    if layout.tasks.exists() and not has_task(layout.tasks, task_instruction(index.description)):
        yield f"{layout.tasks} does not hold the task of the episodes; {remedy}"


def _same(value: Any, expected: Any) -> bool:
    """True if two JSON values are equal up to the last digits of numbers."""
    if isinstance(expected, dict):
        return isinstance(value, dict) and value.keys() == expected.keys() and all(_same(value[k], expected[k]) for k in expected)
    if isinstance(expected, list):
        return isinstance(value, list) and len(value) == len(expected) and all(map(_same, value, expected))
    if isinstance(expected, float | int) and not isinstance(expected, bool):
        return isinstance(value, float | int) and bool(np.isclose(value, expected, rtol=1e-6, atol=1e-9, equal_nan=True))
    return bool(value == expected)


def _files(index: Index) -> Iterator[str]:
    """Missing, unfinished and foreign files."""
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
        yield f"{missing} is missing; run `bricksrl data repair {quoted(layout.root)}`"
    uncounted = len(read_all_rows(layout, index.description)[0]) - len(index.rows)
    unfinished = unfinished_files(layout, index.description, index.last_file)
    if uncounted:
        yield f"{uncounted} recorded episodes are not in the index; run `bricksrl data repair {quoted(layout.root)}`"
    for path in sorted(layout.root.rglob("*")):
        relative = path.relative_to(layout.root)
        if path.is_dir() or path in known or any(part.startswith(".") and part != path.name for part in relative.parts):
            continue
        if path.name.startswith(TEMPORARY_PREFIX) or path in unfinished:
            yield f"{relative} was left by a recording that was killed; run `bricksrl data repair {quoted(layout.root)}`"
        elif not (uncounted and relative.parts[0] in ("data", "videos")):
            yield f"{relative} is not a file of a dataset; it was not opened"
