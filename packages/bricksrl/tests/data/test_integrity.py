"""Faults of a dataset are told one by one, and what a killed recording left is counted."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from toy_data import TOY, record

from brickhub.files import quoted
from bricksrl.cli.data import CheckData, Repair
from bricksrl.data import load
from bricksrl.data.dataset import read_episode_count
from bricksrl.data.integrity import _faults_of_columns, check, recover
from bricksrl.errors import DataError

INFO, STATS, TASKS = "meta/info.json", "meta/stats.json", "meta/tasks.parquet"
ROWS = "meta/episodes/chunk-000/file-00{}.parquet"
DATA = "data/chunk-000/file-00{}.parquet"
NAN = float("nan")


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Episodes of 3, 5 and 4 steps."""
    return record(tmp_path / "set")


def told(root: Path) -> list[str]:
    return [f"{finding.name}: {finding.detail}" for finding in check(root)]


def edit_json(path: Path, **values: Any) -> None:
    """Change values of a file, or remove those that are ``None``."""
    whole = {**json.loads(path.read_text()), **values}
    for name, value in values.items():
        if value is None:
            del whole[name]
    path.write_text(json.dumps(whole))


def edit_steps(root: Path, column: str, change: Callable[[np.ndarray], None]) -> None:
    """Change a column of the second episode, whose digest is then none."""
    for path, name in ((root / DATA.format(1), column), (root / ROWS.format(1), "data/sha256")):
        table = pq.read_table(path)
        place = table.schema.get_field_index(name)
        type_ = table.schema.field(place).type
        if name == column:
            values = np.array(table[name].to_pylist())
            change(values)
            new = pa.array(values.tolist(), type_)
        else:
            new = pa.array([None], type_)
        pq.write_table(table.set_column(place, table.schema.field(place), new), path)


def put(place: int | slice, value: object) -> Callable[[np.ndarray], None]:
    return lambda values: values.__setitem__(place, value)


MOVED = "an observation is not what followed the step before"
ENDS = "its end is marked elsewhere than at its last step"
SUM = "its return is not the sum of its rewards"
NONE = "a number is none"


@pytest.mark.parametrize(
    ("column", "change", "faults"),
    [
        ("observation.state", put(2, 9.0), [MOVED]),
        ("next.observation.state", put(2, 9.0), [MOVED]),
        ("observation.state", put(0, 9.0), []),
        ("next.observation.state", put(4, 9.0), []),
        ("next.done", put(4, False), [ENDS]),
        ("next.done", put(1, True), [ENDS]),
        ("next.truncated", put(1, True), [ENDS]),
        ("next.truncated", put(4, False), [ENDS]),
        ("next.terminated", put(1, True), [ENDS]),
        ("next.terminated", put(4, True), []),
        ("next.reward", put(3, 99.0), [SUM]),
        ("next.reward", put(3, NAN), [SUM, NONE]),
        ("action", put(1, NAN), [NONE]),
        ("observation.state", put(0, NAN), [NONE]),
        ("next.observation.state", put(4, NAN), [NONE]),
        ("age_s", put(2, NAN), []),
        ("hub_time_s", put(2, NAN), []),
    ],
)
def test_steps_of_an_episode_fit_each_other(
    root: Path, column: str, change: Callable[[np.ndarray], None], faults: list[str]
) -> None:
    edit_steps(root, column, change)
    assert told(root) == [f"steps: episode 1: {fault}" for fault in faults]


@pytest.mark.parametrize(
    ("return_", "fits"),
    [(0.0, True), (1e-6, True), (-1e-6, True), (1e-3, False), (float("nan"), False)],
)
def test_a_return_differs_from_the_sum_by_its_last_digits_alone(return_: float, fits: bool) -> None:
    state = np.zeros((2, 1))
    ends = np.array([False, True])
    columns = {
        "observation.state": state,
        "next.observation.state": state,
        "action": state,
        "next.reward": np.array([0.3, -0.3]),
        "next.done": ends,
        "next.terminated": ends,
        "next.truncated": ~ends & False,
    }
    assert list(_faults_of_columns(columns, return_)) == ([] if fits else [SUM])


def test_files_about_all_episodes_are_compared_with_them(root: Path) -> None:
    edit_json(root / INFO, total_frames=13, fps=None)
    stats = json.loads((root / STATS).read_text())
    mean = stats["action"]["mean"]
    remedy = f"run `bricksrl data repair {quoted(root)}`"
    index = [
        f"index: {root / INFO} says 'fps' is None, and it is 4; {remedy}",
        f"index: {root / INFO} says 'total_frames' is 13, and it is 12; {remedy}",
    ]
    assert told(root) == index
    # The last digits of a sum depend on the processor.
    stats["action"]["mean"] = [mean[0] * (1 + 1e-8)]
    (root / STATS).write_text(json.dumps(stats))
    assert told(root) == index
    pq.write_table(pa.table({"task_index": [0], "task": ["Other-v0"]}), root / TASKS)
    wrong = f"{root / TASKS} does not hold the task of the episodes"
    assert told(root) == [*index, f"index: {wrong}; {remedy}"]


@pytest.mark.parametrize(
    "changed",
    [
        {"action": None},
        {"action": [0.0]},
        {"more": {}},
        {"action/mean": None},
        {"action/mean": [0.25]},
        {"action/mean": 0.25},
        {"action/mean": []},
        {"action/mean": ["0.25"]},
        {"action/count": [13]},
        "no JSON",
    ],
)
def test_statistics_of_other_episodes_are_told(root: Path, changed: dict[str, Any] | str) -> None:
    path = root / STATS
    if isinstance(changed, str):
        path.write_text(changed)
    else:
        ((name, value),) = changed.items()
        column, _, stat = name.partition("/")
        action = {**json.loads(path.read_text())["action"], stat: value}
        edit_json(path, **{column: action if stat and value is not None else value})
        if stat and value is None:
            del action[stat]
            edit_json(path, action=action)
    wrong = f"index: {path} does not hold the statistics of the episodes"
    assert told(root) == [f"{wrong}; run `bricksrl data repair {quoted(root)}`"]


def test_files_of_others_are_told_apart_from_those_of_a_killed_recording(root: Path) -> None:
    for name in ("README.md", ".lock", ".git/config", "data/.cache/x"):
        (root / name).parent.mkdir(exist_ok=True)
        (root / name).write_text("of another tool")
    assert told(root) == []
    # The fourth episode has no row: its recording was killed.
    (root / DATA.format(3)).write_bytes(b"half")
    (root / "meta/.part-1").write_bytes(b"half")
    (root / "notes.txt").write_text("ours")
    (root / TASKS).unlink()
    repair = f"run `bricksrl data repair {quoted(root)}`"
    killed = f"was left by a recording that was killed; {repair}"
    assert told(root) == [
        f"files: {root / TASKS} is missing; {repair}",
        f"files: {Path(DATA.format(3))} {killed}",
        f"files: {Path('meta/.part-1')} {killed}",
        "files: notes.txt is not a file of a dataset; it was not opened",
    ]
    dataset, added, removed = recover(root)
    assert (len(dataset.rows), added, removed) == (3, 0, 2)
    (root / "notes.txt").unlink()
    assert told(root) == []


def test_whole_episodes_of_a_killed_recording_are_counted_again(root: Path) -> None:
    info, stats = (root / INFO).read_bytes(), (root / STATS).read_bytes()
    record(root, (2, 2), first_seed=3)
    (root / INFO).write_bytes(info)
    (root / STATS).write_bytes(stats)
    repair = f"run `bricksrl data repair {quoted(root)}`"
    assert told(root) == [f"files: 2 recorded episodes are not in the index; {repair}"]
    assert len(load(root).rows) == 3
    dataset, added, removed = recover(root)
    assert (len(dataset.rows), added, removed) == (5, 2, 0)
    assert told(root) == [] and len(load(root)) == 16
    assert recover(root)[1:] == (0, 0)


def test_an_index_is_rebuilt_only_where_that_is_asked_for(root: Path) -> None:
    intact = (root / INFO).read_bytes(), (root / STATS).read_bytes()
    edit_json(root / INFO, total_episodes=-1)
    edit_json(root / STATS, action=None)
    pq.write_table(pa.table({"task_index": [0], "task": ["Other-v0"]}), root / TASKS)
    with pytest.raises(DataError, match="does not count its episodes"):
        recover(root)
    assert recover(root, rebuild=True)[1:] == (3, 0)
    assert ((root / INFO).read_bytes(), (root / STATS).read_bytes()) == intact
    assert told(root) == []


def test_rows_that_are_lost_or_in_another_order_are_not_repaired_in_place(root: Path) -> None:
    (root / DATA.format(3)).write_bytes(b"half")
    last = (root / ROWS.format(2)).read_bytes()
    (root / ROWS.format(2)).unlink()
    with pytest.raises(DataError, match=r"has lost rows: 2 of 3 episodes are left; .* --out NEW`"):
        recover(root, rebuild=True)
    (root / ROWS.format(2)).write_bytes((root / ROWS.format(1)).read_bytes())
    with pytest.raises(DataError, match="are not in order at episode 2; restore them"):
        recover(root, rebuild=True)
    (root / ROWS.format(2)).write_bytes(last)
    assert (root / DATA.format(3)).exists(), "nothing is removed before the rows are known"
    assert recover(root, rebuild=True)[1:] == (0, 1)


@pytest.mark.parametrize("episodes", [-1, "3", 3.0, True, [3], None])
def test_an_index_counts_its_episodes(tmp_path: Path, episodes: object) -> None:
    path = tmp_path / INFO
    path.parent.mkdir()
    for count in (0, 3):
        path.write_text(json.dumps(TOY.info(count, 4 * count)))
        assert read_episode_count(tmp_path, TOY) == count
    edit_json(path, total_episodes=episodes)
    with pytest.raises(DataError, match="info.json does not count its episodes; run `bricksrl"):
        read_episode_count(tmp_path, TOY)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"codebase_version": "v2.1"}, "is of no dataset in LeRobot's format v3.0"),
        ({"features": {}}, "disagree about the columns"),
        ({"data_path": "data/{episode_index}.parquet"}, "disagree about the columns"),
    ],
)
def test_an_index_of_another_format_is_refused(
    tmp_path: Path, changed: dict[str, Any], says: str
) -> None:
    path = tmp_path / INFO
    path.parent.mkdir()
    path.write_text(json.dumps({**TOY.info(3, 12), **changed}))
    with pytest.raises(DataError, match=says):
        read_episode_count(tmp_path, TOY)


def test_a_repair_says_what_it_did_and_whether_all_is_well(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def lines() -> list[str]:
        return capsys.readouterr().out.splitlines()

    (root / DATA.format(3)).write_bytes(b"half")
    assert Repair(root).execute() == 0
    assert lines() == ["3 episodes; 0 new in the index, 1 unfinished file removed"]
    assert CheckData(root).execute() == 0
    assert lines() == ["all is well"]
    (root / "notes.txt").touch()
    foreign = "notes.txt is not a file of a dataset; it was not opened"
    assert CheckData(root).execute() == 1
    assert lines() == [foreign]
    assert Repair(root).execute() == 1
    save = f"with `bricksrl data repair {quoted(root)} --out DIR`"
    assert lines() == [
        "3 episodes; 0 new in the index, 0 unfinished files removed",
        foreign,
        f"save the intact episodes to a new dataset {save}",
    ]
    with pytest.raises(DataError, match="there is no dataset of ours in"):
        Repair(root.parent).execute()


def test_a_rescue_says_what_was_lost(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (root / DATA.format(1)).write_bytes(b"gone")
    saved = root.parent / "saved"
    assert Repair(root, saved).execute() == 0
    lost, last = capsys.readouterr().out.splitlines()
    assert lost.startswith("lost: episode 1: ") and last == f"2 episodes: {saved}"
    assert told(saved) == []
    for number in (0, 2):
        (root / DATA.format(number)).write_bytes(b"gone")
    with pytest.raises(DataError, match="no episode in .* is whole; restore it from a copy"):
        Repair(root, root.parent / "again").execute()
    assert not (root.parent / "again").exists()
