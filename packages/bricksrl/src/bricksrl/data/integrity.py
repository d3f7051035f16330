"""Integrity of a dataset: check of every file, digest and step, and repair after its writer was
killed."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from brickhub.files import LOCK, TEMPORARY_PREFIX, quoted, remove_unfinished
from brickhub.finding import Finding, Outcome
from bricksrl.data.columns import join_statistics
from bricksrl.data.dataset import (
    Dataset,
    dataset_folder,
    read_all_rows,
    read_dataset,
    read_description,
    read_episode_count,
)
from bricksrl.data.lerobot import is_lerobot, read_lerobot
from bricksrl.data.reader import EpisodeReader
from bricksrl.data.schema import FILES, NEXT, OBSERVATION
from bricksrl.errors import DataError


def check(root: Path, task: str | None = None) -> list[Finding]:
    """Faults of a dataset; empty if it is intact. Nothing is changed, and no foreign file is
    opened. Of one that LeRobot recorded the first fault is told. Raises DataError if there is no
    dataset."""
    root = dataset_folder(root)
    if is_lerobot(root):
        try:
            read_lerobot(root, task)
        except DataError as error:
            return [Finding("steps", Outcome.ERROR, str(error))]
        return []
    dataset = read_dataset(root)
    faults = {
        "steps": _faults_of_steps(dataset),
        "files": _faults_of_files(dataset),
        "index": _faults_of_index(dataset),
    }
    findings = []
    for name, texts in faults.items():
        findings += [Finding(name, Outcome.ERROR, text) for text in texts]
    return findings


def _faults_of_steps(dataset: Dataset) -> Iterator[str]:
    """Faults of the steps of each episode."""
    reader = EpisodeReader(dataset)
    for row in dataset.rows:
        try:
            columns = reader.read(row).columns
        except DataError as error:
            yield f"episode {row.episode}: {error}"
            continue
        for fault in _faults_of_columns(columns, row.return_):
            yield f"episode {row.episode}: {fault}"


def _faults_of_columns(columns: Mapping[str, Any], return_: float) -> Iterator[str]:
    """Faults of the columns ``[steps, ...]`` of an episode with a return."""
    # Each observation stands twice, after a step and before the next one, so that a row can be
    # learned from alone; a shifted column would spoil what is learned and look right.
    before = columns[OBSERVATION][1:]
    after_previous = columns[NEXT][:-1]
    if not np.array_equal(before, after_previous, equal_nan=True):
        yield "an observation is not what followed the step before"
    done = columns["next.terminated"] | columns["next.truncated"]
    ends_once = done[-1] and not done[:-1].any()
    if not ends_once or not np.array_equal(done, columns["next.done"]):
        yield "its end is marked elsewhere than at its last step"
    # Rewards are float32, and a sum depends on its order: the last digits may differ.
    total = columns["next.reward"].sum(dtype=np.float64)
    if not np.isclose(total, return_, rtol=1e-5, atol=1e-5):
        yield "its return is not the sum of its rewards"
    learned = (OBSERVATION, NEXT, "action", "next.reward")
    if not all(np.isfinite(columns[name]).all() for name in learned):
        yield "a number is none"


def _faults_of_index(dataset: Dataset) -> Iterator[str]:
    """Faults of the files on all episodes (info, statistics, tasks), compared with the rows of the
    episodes."""
    info = dataset.path("info")
    stats = dataset.path("stats")
    tasks = dataset.path("tasks")
    remedy = f"run `bricksrl data repair {quoted(dataset.root)}`"
    expected = dataset.description.info(len(dataset.rows), dataset.steps)
    # It is JSON, as `read_dataset` has parsed it.
    stored = json.loads(info.read_bytes())
    wrong = [key for key in expected if key not in stored or stored[key] != expected[key]]
    for key in sorted(wrong):
        yield (
            f"{info} says '{key}' is {stored.get(key)!r:.60}, and it is {expected[key]!r:.60}; "
            f"{remedy}"
        )
    if stats.exists() and dataset.rows:
        try:
            statistics = json.loads(stats.read_bytes())
        except (ValueError, RecursionError, OSError):
            statistics = None
        expected_statistics = join_statistics([row.statistics for row in dataset.rows])
        if not _same(statistics, expected_statistics):
            yield f"{stats} does not hold the statistics of the episodes; {remedy}"
    if tasks.exists() and not dataset.has_task():
        yield f"{tasks} does not hold the task of the episodes; {remedy}"


def _same(value: Any, expected: Any) -> bool:
    """True if two JSON values are equal up to the last digits of numbers."""
    if isinstance(expected, dict):
        if not isinstance(value, dict) or value.keys() != expected.keys():
            return False
        return all(_same(value[key], expected[key]) for key in expected)
    if isinstance(expected, list):
        if not isinstance(value, list) or len(value) != len(expected):
            return False
        return all(map(_same, value, expected))
    if isinstance(expected, float | int) and not isinstance(expected, bool):
        if not isinstance(value, float | int):
            return False
        # A sum over all episodes depends on the processor's order of additions.
        return bool(np.isclose(value, expected, rtol=1e-6, atol=1e-9, equal_nan=True))
    return bool(value == expected)


def _known_files(dataset: Dataset) -> set[Path]:
    """Paths of all files that a dataset may have."""
    known = {dataset.root / LOCK, dataset.root / "README.md"}
    for kind in ("info", "stats", "tasks", "description"):
        known.add(dataset.path(kind))
    for number in range(dataset.row_files):
        known.add(dataset.path("episodes", number))
    for row in dataset.rows:
        known.add(dataset.path("data", row.data_file))
        known.add(dataset.path("video", row.data_file))
    return known


def _faults_of_files(dataset: Dataset) -> Iterator[str]:
    """Missing, unfinished and foreign files."""
    root = dataset.root
    repair = f"run `bricksrl data repair {quoted(dataset.root)}`"
    known = _known_files(dataset)
    for path in (dataset.path("stats"), dataset.path("tasks")):
        if not path.exists():
            yield f"{path} is missing; {repair}"
    recorded = read_all_rows(root, dataset.description)
    uncounted = len(recorded.rows) - len(dataset.rows)
    unfinished = recorded.unfinished_files()
    if uncounted:
        yield f"{uncounted} recorded episodes are not in the index; {repair}"
    for path in sorted(root.rglob("*")):
        relative = path.relative_to(root)
        # Folders such as `.git` and `.cache` are of other tools, which have their own checks.
        is_of_a_tool = any(part.startswith(".") for part in relative.parts[:-1])
        if path.is_dir() or path in known or is_of_a_tool:
            continue
        if path.name.startswith(TEMPORARY_PREFIX) or path in unfinished:
            yield f"{relative} was left by a recording that was killed; {repair}"
        # It may belong to an episode that was counted above as not in the index.
        elif not (uncounted and relative.parts[0] in ("data", "videos")):
            yield f"{relative} is not a file of a dataset; it was not opened"


def recover(root: Path, *, rebuild: bool = False) -> tuple[Dataset, int, int]:
    """Update the index of a dataset whose writer was killed from the files on the disk. The caller
    must hold the write lock. Raises DataError if the dataset has damage that a killed writer cannot
    cause.

    A row is written after all other files of its episode, so a row that the index does not count is
    a complete episode.

    Args:
        rebuild: rebuild a damaged index too.

    Returns:
        The dataset, the number of intact episodes that were added to its index, and that of
        unfinished files that were removed.
    """
    description = read_description(root)
    committed = 0
    if (root / FILES["info"]).exists():
        try:
            committed = read_episode_count(root, description)
        except DataError:
            if not rebuild:
                raise
    removed = remove_unfinished(root)
    dataset = read_all_rows(root, description)
    episodes = len(dataset.rows)
    if episodes < committed:
        left = f"{episodes} of {committed} episodes are left"
        save = f"save them with `bricksrl data repair {quoted(root)} --out NEW`"
        raise DataError(f"{root} has lost rows: {left}; restore it from a copy, or {save}")
    dataset.check_order(episodes)
    # Only now, as nothing is removed from a dataset whose rows are not in order.
    unfinished = dataset.unfinished_files()
    for path in unfinished:
        path.unlink()
    has_wrong_task = rebuild and not dataset.has_task()
    if has_wrong_task or not dataset.path("tasks").exists():
        dataset.write_task()
    is_behind = episodes > committed or not dataset.path("stats").exists()
    if episodes and (rebuild or is_behind):
        dataset.write_index()
    return dataset, episodes - committed, removed + len(unfinished)
