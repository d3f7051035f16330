"""Datasets as CSV, which spreadsheets read: a row a step, and one more for what was observed after
the last step."""

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from brickhub.files import atomic_folder, write_durably
from bricksrl.data.dataset import Dataset, Episode, EpisodeRow, read_dataset, refuse_target
from bricksrl.data.reader import EpisodeReader
from bricksrl.data.schema import ACTION, NEXT, OBSERVATION
from bricksrl.errors import DataError

Cell = str | int
_ENDING = ".csv"
_AFTER = ("next.reward", "next.terminated", "next.truncated", "intervention")
"""Columns behind observation and action, by their names in the dataset."""
_CLOCK = "hub_time_s"
_STEP_NAMES = ("reward", "terminated", "truncated", "intervention", _CLOCK)


def export_csv(path: Path, out: Path) -> None:
    """Write a dataset as CSV without its images: one file where the name of ``out`` ends in
    ``.csv``, else a folder with a file an episode, ``episode-000.csv``.

    Columns: episode, step, seconds by the rate of the task, each channel of the observation before
    the step, each of the action in -1..1, reward, terminated, truncated, intervention (1 or 0), and
    the hub's clock after the step in seconds, empty without a hub. In an episode's last row the
    columns behind the observation are empty.

    Raises:
        DataError: the dataset cannot be read, or ``out`` exists, or is an ending alone.
    """
    refuse_target(out)
    # A file of that name would be hidden.
    if out.name.lower() == _ENDING:
        raise DataError(f"{out} has an ending and no name; give table{_ENDING}")
    dataset = read_dataset(path)
    read = EpisodeReader(dataset, images=False).read
    header = _header(dataset)
    if is_one_table(out):
        lines: list[Sequence[Cell]] = [header]
        for row in dataset.rows:
            lines += _lines(read(row), row, dataset)
        write_durably(out, _text(lines))
        return
    with atomic_folder(out) as folder:
        for row in dataset.rows:
            lines = [header, *_lines(read(row), row, dataset)]
            path_of_episode = folder / f"episode-{row.episode:03}.csv"
            path_of_episode.write_bytes(_text(lines))


def is_one_table(out: Path) -> bool:
    """Whether the name is that of one CSV file, and not of a folder."""
    return out.name.lower().endswith(_ENDING)


def _header(dataset: Dataset) -> list[str]:
    description = dataset.description
    observed = [f"observation.{entry.name}" for entry in description.observation]
    acted = [f"action.{entry.name}" for entry in description.action]
    return ["episode", "step", "seconds", *observed, *acted, *_STEP_NAMES]


def _lines(episode: Episode, row: EpisodeRow, dataset: Dataset) -> Iterator[list[Cell]]:
    """Rows of an episode, the one after its last step included."""
    columns = episode.columns
    rate_hz = dataset.description.rate_hz
    observed = _rows_of(columns[OBSERVATION])  # [steps, n]
    acted = _rows_of(columns[ACTION])  # [steps, m]
    after = np.stack([columns[name] for name in _AFTER], axis=1)  # [steps, 4]
    for step in range(row.length):
        yield [
            row.episode,
            step,
            _text_of(step / rate_hz),
            *_texts_of(observed[step]),
            *_texts_of(acted[step]),
            *_texts_of(after[step]),
            # A clock has more digits than a float32.
            _text_of(columns[_CLOCK][step], 10),
        ]
    observed_last = _rows_of(columns[NEXT])[-1]
    # Nothing was done there, and nothing followed.
    columns_left = acted.shape[1] + len(_STEP_NAMES)
    yield [
        row.episode,
        row.length,
        _text_of(row.length / rate_hz),
        *_texts_of(observed_last),
        *[""] * columns_left,
    ]


def _texts_of(numbers: Iterable[float]) -> list[str]:
    return [_text_of(number) for number in numbers]


def _rows_of(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """A column as ``[steps, n]``: of vectors of length 1 it holds plain numbers."""
    return values.reshape(len(values), -1)


def _text_of(number: float, digits: int = 7) -> str:
    """A number with the digits that a float32 has, or others; empty where there is none."""
    return "" if np.isnan(number) else f"{float(number):.{digits}g}"


def _text(lines: Iterable[Sequence[Cell]]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(lines)
    return text.getvalue().encode()
