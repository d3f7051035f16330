"""Dataset on the disk: its description, its episodes, and a row about each (``meta/episodes``).

The rows have LeRobot's columns, and ours with the provenance of an episode.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from brickhub.fields import check_fields
from brickhub.files import folder_with, parsing, quoted, reading, refuse_existing, write_durably
from bricksrl.data.columns import (
    RESTORE,
    STATISTICS,
    Statistics,
    arrow_types,
    column_statistics,
    encode,
    join_statistics,
    read_bytes,
    read_parquet,
    to_parquet,
    to_table,
)
from bricksrl.data.schema import CHUNK_SIZE, CODEBASE_VERSION, FILES, Description
from bricksrl.errors import DataError, counted


@dataclass(frozen=True)
class About:
    """Provenance of an episode: policy, seed, hub, versions, success.

    Attributes:
        policy: source of the actions, such as ``"random"``, ``"sac"``, ``"keyboard"``.
        seed: seed of the episode; ``None`` if none was given.
        success: success by the task; ``None`` if it defines none.
        whole: whether the episode ran to its end; false if it was interrupted.
        started: date and time of its start, with the time zone.
        hub: how the robot was reached.
        robot: name of the robot, if several recorded together.
        program_hash: hash of the program on its hub; ``None`` without a hub.
        versions: versions of the recording packages.
        physics: physics of a virtual robot, as plain values.
    """

    policy: str = ""
    seed: int | None = None
    success: bool | None = None
    whole: bool = True
    started: str = ""
    hub: str = ""
    robot: str = ""
    program_hash: int | None = None
    versions: dict[str, str] = field(default_factory=dict)
    physics: dict[str, float] = field(default_factory=dict)


_TEXT = pa.string()
_INT = pa.int64()
_FLOAT = pa.float64()
_BOOL = pa.bool_()
_TYPES = {"str": _TEXT, "int | None": _INT, "bool": _BOOL, "bool | None": _BOOL}
_ABOUT = {
    attribute.name: _TYPES[str(attribute.type)]
    for attribute in fields(About)
    if attribute.type in _TYPES
}
_ABOUT_JSON = [attribute.name for attribute in fields(About) if attribute.name not in _ABOUT]
"""Attributes of `About`: columns of their own, and dictionaries as texts."""


@dataclass(frozen=True)
class EpisodeRow:
    """Row of an episode in ``meta/episodes``.

    Attributes:
        start: first row of the episode in the dataset.
        data_file: number of the files with its steps and its images.
        data_sha256, video_sha256: digests of the two; ``None`` if none was recorded.
        final_image: raw bytes of the image after the last step, which the video does not have.
        return_: sum of its rewards.
        statistics: statistics of its columns.
    """

    episode: int
    length: int
    start: int
    return_: float
    terminated: bool
    interventions: int
    data_file: int
    data_sha256: str | None
    statistics: dict[str, Statistics]
    about: About
    video_sha256: str | None = None
    final_image: bytes | None = None


# These are the column and the type of each attribute. `{key}` stands for the feature of the images,
# and without images these columns are left out.
_COLUMNS = {
    "episode": ("episode_index", _INT),
    "length": ("length", _INT),
    "start": ("dataset_from_index", _INT),
    "return_": ("return", _FLOAT),
    "terminated": ("terminated", _BOOL),
    "interventions": ("interventions", _INT),
    "data_sha256": ("data/sha256", _TEXT),
    "video_sha256": ("videos/{key}/sha256", _TEXT),
    "final_image": ("final/{key}", pa.binary()),
}


def _columns(key: str | None) -> dict[str, tuple[str, pa.DataType]]:
    """Columns, with their types, of plain attributes of `EpisodeRow`; ``key``: name of the images'
    feature, if any."""
    columns = {}
    for name, (column, type_) in _COLUMNS.items():
        if key is None and "{key}" in column:
            continue
        columns[name] = column.format(key=key), type_
    return columns


Cells = dict[str, tuple[list[Any], pa.DataType]]
"""Columns of ``meta/episodes`` by name: a value for each row, and their type."""


@dataclass(frozen=True)
class Episode:
    """Complete episode: its provenance, and columns ``[length, ...]``.

    Attributes:
        images: before each step and after the last one, ``[length + 1, side, side, 3]``, with a
            camera.
        image_statistics: statistics of the images before the steps.
    """

    about: About
    columns: dict[str, NDArray[Any]]
    images: NDArray[np.uint8] | None = None
    image_statistics: Statistics | None = None


@dataclass(frozen=True)
class Dataset:
    """Dataset in a folder.

    Attributes:
        rows: rows of its committed episodes, in order and contiguous.
        row_files: number of files with rows.
    """

    root: Path
    description: Description
    rows: tuple[EpisodeRow, ...] = ()
    row_files: int = 0

    @property
    def steps(self) -> int:
        """Number of steps of all episodes."""
        return sum(row.length for row in self.rows)

    @property
    def data_files(self) -> int:
        """Number of files with steps, and so the number of the next one; a merged dataset has fewer
        files with rows."""
        return 1 + max((row.data_file for row in self.rows), default=-1)

    def path(
        self,
        kind: str,
        number: int = 0,
    ) -> Path:
        """Path of a file of a kind in ``FILES``, or of that ``number`` with steps, images or
        rows."""
        chunk, file = divmod(number, CHUNK_SIZE)
        return self.root / FILES[kind].format(
            video_key=self.description.image_key,
            chunk_index=chunk,
            file_index=file,
        )

    def unfinished_files(self) -> list[Path]:
        """Files of an episode without a row, because its writer was killed."""
        at = self.data_files
        # A killed writer leaves one file of each kind at most. If there are more, rows have been
        # lost, and what belonged to them must not be taken for rubbish.
        has_more_data = self.path("data", at + 1).exists()
        has_more_rows = self.path("episodes", self.row_files + 1).exists()
        if has_more_data or has_more_rows:
            return []
        return [path for path in (self.path("data", at), self.path("video", at)) if path.exists()]

    def check_order(self, episodes: int) -> None:
        """Raise DataError unless the rows are those of ``episodes`` consecutive episodes."""
        root = self.root
        start = 0
        for number, row in enumerate(self.rows):
            if row.episode != number or row.start != start:
                raise DataError(
                    f"the rows in {root / 'meta/episodes'} are not in order at episode {number}; "
                    "restore them"
                )
            start += row.length
        if len(self.rows) != episodes:
            # Further rows are those of a killed writer, and are removed in place. Missing rows are
            # a loss, so what is left goes into a new dataset.
            out = " --out NEW" if len(self.rows) < episodes else ""
            raise DataError(
                f"{self.path('info')} counts {counted(episodes, 'episode')} and meta/episodes "
                f"holds {len(self.rows)}; "
                f"restore it from a copy, or run `bricksrl data repair {quoted(root)}{out}`"
            )

    def has_task(self) -> bool:
        """True if ``meta/tasks.parquet`` holds the task of the episodes only."""
        expected = [{"task_index": 0, "task": self.description.env}]
        try:
            return bool(read_parquet(self.path("tasks")).to_pylist() == expected)
        except DataError:
            return False

    def write_description(self) -> None:
        """Write the files that do not depend on the episodes."""
        write_durably(self.path("description"), self.description.to_json())
        self.write_task()

    def write_task(self) -> None:
        """Write ``meta/tasks.parquet``: the only instruction is the id of the environment; for
        LeRobot it is pandas' index."""
        # This is what pandas would write for a table whose index is the column "task", by which
        # LeRobot looks tasks up. Importing pandas itself would take a second.
        text = {"pandas_type": "unicode", "numpy_type": "object", "metadata": None}
        number = {"pandas_type": "int64", "numpy_type": "int64", "metadata": None}
        pandas = {
            "index_columns": ["task"],
            "column_indexes": [{"name": None, "field_name": None, **text}],
            "columns": [
                {"name": "task_index", "field_name": "task_index", **number},
                {"name": "task", "field_name": "task", **text},
            ],
            "creator": {"library": "pyarrow", "version": pa.__version__},
            "pandas_version": "2.0.0",
        }
        numbers = pa.array([0], _INT)
        names = pa.array([self.description.env], _TEXT)
        table = pa.table({"task_index": numbers, "task": names})
        table = table.replace_schema_metadata({"pandas": json.dumps(pandas)})
        write_durably(self.path("tasks"), to_parquet(table))

    def write_episodes(self, episodes: Sequence[Episode]) -> Dataset:
        """Write the next data file and, with a camera, the next video file, with these episodes;
        returns the dataset with their rows, which `write_rows` writes."""
        description = self.description
        key = self.description.image_key
        at = self.data_files
        rows = []
        tables = []
        images = []
        start = self.steps
        for number, episode in enumerate(episodes, len(self.rows)):
            length = len(episode.columns["index"])
            # An episode does not know its place in the dataset, so it is given one here.
            given = episode.columns | {
                "episode_index": np.full(length, number),
                "index": np.arange(start, start + length),
            }
            columns = {name: given[name] for name in arrow_types(description)}
            tables.append(to_table(columns, description))
            row = EpisodeRow(
                episode=number,
                length=length,
                start=start,
                return_=float(columns["next.reward"].sum(dtype=np.float64)),
                terminated=bool(columns["next.terminated"][-1]),
                interventions=int(columns["intervention"].sum()),
                data_file=at,
                data_sha256=None,
                statistics={name: column_statistics(values) for name, values in columns.items()},
                about=episode.about,
            )
            if (
                key is not None
                and episode.images is not None
                and episode.image_statistics is not None
            ):
                # A video has an image for each step, as LeRobot expects. The one after the last
                # step is one more, and goes into the row.
                images.append(episode.images[:-1])
                row.statistics[key] = episode.image_statistics
                row = replace(row, final_image=episode.images[-1].tobytes())
            rows.append(row)
            start += length
        # The digests are computed from the files as they are written, so that a row reveals any
        # damage.
        data = to_parquet(pa.concat_tables(tables))
        write_durably(self.path("data", at), data)
        rows = [replace(row, data_sha256=hashlib.sha256(data).hexdigest()) for row in rows]
        if images:
            video = encode(np.concatenate(images), description.rate_hz)
            write_durably(self.path("video", at), video)
            rows = [replace(row, video_sha256=hashlib.sha256(video).hexdigest()) for row in rows]
        return replace(self, rows=(*self.rows, *rows))

    def write_rows(self, first: int) -> Dataset:
        """Write the rows from episode ``first`` on into the next file of rows; returns the dataset
        with it."""
        rows = self.rows[first:]
        at = self.row_files
        cells = {
            **self._place_cells(rows, at),
            **_provenance_cells(rows),
            **self._statistics_cells(rows),
        }
        table = pa.table({name: pa.array(values, type_) for name, (values, type_) in cells.items()})
        write_durably(self.path("episodes", at), to_parquet(table))
        return replace(self, row_files=at + 1)

    def _place_cells(
        self,
        rows: Sequence[EpisodeRow],
        row_file: int,
    ) -> Cells:
        """Columns with the episodes' numbers and lengths, and the files in which they stand."""
        key = self.description.image_key
        cells: Cells = {}
        for name, (column, type_) in _columns(key).items():
            cells[column] = [getattr(row, name) for row in rows], type_
        files = {"data": [row.data_file for row in rows], "meta/episodes": [row_file] * len(rows)}
        if key is not None:
            files[f"videos/{key}"] = files["data"]
        for place, numbers in files.items():
            cells[f"{place}/chunk_index"] = [number // CHUNK_SIZE for number in numbers], _INT
            cells[f"{place}/file_index"] = [number % CHUNK_SIZE for number in numbers], _INT
        cells["tasks"] = [[self.description.env]] * len(rows), pa.list_(_TEXT)
        cells["dataset_to_index"] = [row.start + row.length for row in rows], _INT
        if key is not None:
            # LeRobot finds an episode's images by their time in the video, which begins anew in
            # each file. The rows are reversed, so that the first row of a file has the last word.
            file_starts = {row.data_file: row.start for row in reversed(self.rows)}
            from_steps = [row.start - file_starts[row.data_file] for row in rows]
            to_steps = [
                from_step + row.length for from_step, row in zip(from_steps, rows, strict=True)
            ]
            rate_hz = self.description.rate_hz
            for name, steps in (("from", from_steps), ("to", to_steps)):
                times_s = [step / rate_hz for step in steps]
                cells[f"videos/{key}/{name}_timestamp"] = times_s, _FLOAT
        return cells

    def _statistics_cells(self, rows: Sequence[EpisodeRow]) -> Cells:
        """Statistics of each episode, in LeRobot's columns."""
        cells: Cells = {}
        for name, feature in self.description.features.items():
            type_ = pa.list_(_FLOAT)
            if feature["dtype"] == "video":
                # LeRobot keeps the statistics of images as [channels, 1, 1].
                type_ = pa.list_(pa.list_(type_))
            of_rows = [row.statistics[name] for row in rows]
            for number, stat in enumerate(STATISTICS):
                cells[f"stats/{name}/{stat}"] = (
                    [values[number].tolist() for values, _ in of_rows],
                    type_,
                )
            cells[f"stats/{name}/count"] = [[count] for _, count in of_rows], pa.list_(_INT)
        return cells

    def write_index(self) -> None:
        """Write the joint statistics and the number of episodes; the latter comes last, and commits
        the newest episode."""
        statistics = join_statistics([row.statistics for row in self.rows])
        write_durably(self.path("stats"), to_json(statistics))
        # Readers take as many episodes as this file counts. If a writer is killed before this line,
        # nobody sees what it has written.
        info = self.description.info(len(self.rows), self.steps)
        write_durably(self.path("info"), to_json(info))


def _provenance_cells(rows: Sequence[EpisodeRow]) -> Cells:
    """Columns with the origin of the episodes, which LeRobot does not have and lets be."""
    cells: Cells = {}
    for name, type_ in _ABOUT.items():
        cells[name] = [getattr(row.about, name) for row in rows], type_
    for name in _ABOUT_JSON:
        cells[name] = [json.dumps(getattr(row.about, name)) for row in rows], _TEXT
    return cells


def is_dataset(root: Path) -> bool:
    """True if the folder has a dataset, even an empty one."""
    return any((root / FILES[kind]).exists() for kind in ("description", "info"))


def refuse_target(out: Path) -> None:
    """Raise DataError if there is a file or folder at ``out``, or it is in the folder of a dataset,
    whose files it would join."""
    refuse_existing(out, DataError)
    refuse_within_dataset(out)


def refuse_within_dataset(path: Path) -> None:
    """Raise DataError if ``path`` is in the folder of a dataset, also by a link."""
    for folder in Path(os.path.realpath(path)).parents:
        if is_dataset(folder):
            raise DataError(
                f"{path} is in the folder of the dataset {folder}, which holds nothing else; name "
                "another place"
            )


def dataset_folder(path: Path | str) -> Path:
    """Folder of the dataset: the given one, or ``data`` in the folder of a run."""
    path = Path(path)
    info = FILES["info"]
    # A dataset has a folder `data` as well, for its steps. Only a folder `data` with an index
    # belongs to a run.
    is_run = (path / "data" / info).exists() and not (path / info).exists()
    return path / "data" if is_run else path


def existing_dataset(path: Path | str) -> Path:
    """Folder of the dataset, as `dataset_folder`, without reading it. Raises DataError if there is
    none."""
    root = dataset_folder(path)
    info = FILES["info"]
    if not (root / info).exists():
        raise DataError(
            f"there is no dataset in {root}; choose {folder_with(root, info, f'data/{info}')}"
        )
    return root


def read_dataset(path: Path | str) -> Dataset:
    """Read the dataset in a folder, or in the folder of a run, without its steps. Raises DataError
    if there is no dataset, it is damaged, or it was not made by BricksRL."""
    root = existing_dataset(path)
    description = read_description(root)
    episodes = read_episode_count(root, description)
    dataset = read_all_rows(root, description)
    # Rows beyond the index belong to an unfinished commit of a killed writer, and do not count.
    dataset = replace(dataset, rows=dataset.rows[:episodes])
    dataset.check_order(episodes)
    return dataset


def read_description(root: Path) -> Description:
    """Read the description in ``meta/bricksrl.json``. Raises DataError if it is damaged or
    missing."""
    path = root / FILES["description"]
    if not path.exists():
        way = (
            f"`bricksrl data import {quoted(root)} --out NEW` makes it ours, if LeRobot recorded it"
        )
        raise DataError(
            f"the dataset in {root} was not made by BricksRL: it has no meta/bricksrl.json; {way}"
        )
    return Description.from_json(read_bytes(path), str(path))


def read_episode_count(root: Path, description: Description) -> int:
    """Read the number of committed episodes. Raises DataError if the file is damaged, or of another
    dataset."""
    path = root / FILES["info"]
    repair = f"run `bricksrl data repair {quoted(root)}`"
    with reading(
        "the index",
        path,
        DataError,
        f"restore it, or {repair}",
    ):
        data = dict(json.loads(path.read_bytes()))
    if data.get("codebase_version") != CODEBASE_VERSION:
        raise DataError(
            f"{path} is of no dataset in LeRobot's format {CODEBASE_VERSION}; choose another"
        )
    if data.get("features") != description.features or data.get("data_path") != FILES["data"]:
        raise DataError(
            f"{path} and bricksrl.json disagree about the columns; restore both from one copy"
        )
    episodes = data.get("total_episodes")
    if type(episodes) is not int or episodes < 0:
        raise DataError(f"{path} does not count its episodes; {repair}")
    return episodes


def read_all_rows(root: Path, description: Description) -> Dataset:
    """Read the rows of all consecutive files, including those of an unfinished commit."""
    dataset = Dataset(root, description)
    rows = []
    while (path := dataset.path("episodes", dataset.row_files)).exists():
        rows += read_rows(path, description)
        dataset = replace(dataset, row_files=dataset.row_files + 1)
    return replace(dataset, rows=tuple(rows))


def to_json(value: Any) -> bytes:
    """JSON in LeRobot's formatting."""
    return (json.dumps(value, indent=4) + "\n").encode()


def read_rows(path: Path, description: Description) -> list[EpisodeRow]:
    """Read the rows in a file. Raises DataError if the file is missing, damaged or not of such a
    dataset."""
    records = read_parquet(path).to_pylist()
    with parsing(DataError(f"{path} holds rows that are not ours; {RESTORE}")):
        return [_row(record, description) for record in records]


def _row(record: dict[str, Any], description: Description) -> EpisodeRow:
    key = description.image_key
    values = {name: record[column] for name, (column, _) in _columns(key).items()}
    values["data_file"] = _file(record, "data")
    about = {name: record[name] for name in _ABOUT}
    about |= {name: json.loads(record[name]) for name in _ABOUT_JSON}
    # The file may come from anywhere, so each value is checked against the annotation of its field.
    check_fields(About, about)
    check_fields(EpisodeRow, values)
    row = EpisodeRow(
        **values,
        statistics=_statistics(record, description),
        about=About(**about),
    )
    if row.length < 1 or row.start < 0 or row.episode < 0:
        raise ValueError("an episode without steps")
    return row


def _file(record: dict[str, Any], prefix: str) -> int:
    """Number of a file, from its chunk folder and its number in it."""
    chunk = int(record[f"{prefix}/chunk_index"])
    file = int(record[f"{prefix}/file_index"])
    if chunk < 0 or not 0 <= file < CHUNK_SIZE:
        raise ValueError("a file with an impossible number")
    return chunk * CHUNK_SIZE + file


def _statistics(record: dict[str, Any], description: Description) -> dict[str, Statistics]:
    statistics = {}
    for name, feature in description.features.items():
        values = np.array([record[f"stats/{name}/{stat}"] for stat in STATISTICS], np.float64)
        [count] = record[f"stats/{name}/count"]
        expected = (3, 1, 1) if feature["dtype"] == "video" else tuple(feature["shape"])
        if values.shape != (4, *expected) or type(count) is not int or count < 1:
            raise ValueError("statistics of something else")
        statistics[name] = values, count
    return statistics
