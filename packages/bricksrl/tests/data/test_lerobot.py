"""Datasets as LeRobot's own recorder writes them: no file of ours, several chunks and files,
actions in units."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch

from bricksrl.agents import preset
from bricksrl.cli.app import run
from bricksrl.cli.data import CheckData, Import
from bricksrl.data import load
from bricksrl.data.edit import merge
from bricksrl.data.formats import import_lerobot
from bricksrl.data.integrity import check
from bricksrl.envs.registry import get_task
from bricksrl.errors import DataError
from bricksrl.training import TrainConfig, train

TASK = get_task("RunAway-v0")
STATE = [entry.name for entry in TASK.entries]
COMMANDS = [command.name for command in TASK.interface.commands]


def lerobot(
    root: Path,
    lengths: tuple[int, ...] = (6, 4, 5),
    robot: str = "bricksrl_two_wheeler",
    **change: Any,
) -> Path:
    """A dataset in LeRobot's layout, an episode a file and two files a chunk; ``change``: of its
    ``info.json``."""
    rng = np.random.default_rng(0)
    start, episodes = 0, []
    for number, length in enumerate(lengths):
        state = rng.uniform(100.0, 900.0, (length, len(STATE))).astype(np.float32)
        action = rng.uniform(-100.0, 100.0, (length, len(COMMANDS))).astype(np.float32)
        columns = {
            "observation.state": pa.FixedSizeListArray.from_arrays(
                pa.array(state.reshape(-1)), len(STATE)
            ),
            "action": pa.FixedSizeListArray.from_arrays(
                pa.array(action.reshape(-1)), len(COMMANDS)
            ),
            "timestamp": pa.array(np.arange(length, dtype=np.float32) / 4),
            "frame_index": pa.array(np.arange(length)),
            "episode_index": pa.array(np.full(length, number)),
            "index": pa.array(start + np.arange(length)),
            "task_index": pa.array(np.zeros(length, np.int64)),
        }
        place = f"chunk-{number // 2:03d}/file-{number % 2:03d}.parquet"
        write(root / "data" / place, pa.table(columns))
        episodes.append(
            {
                "episode_index": number,
                "length": length,
                "tasks": ["run away"],
                "dataset_from_index": start,
            }
        )
        start += length
    write(root / "meta/episodes/chunk-000/file-000.parquet", pa.Table.from_pylist(episodes))
    write(root / "meta/tasks.parquet", pa.table({"task_index": [0], "task": ["run away"]}))
    numbers = {
        name: {"dtype": "int64", "shape": [1], "names": None}
        for name in ("frame_index", "episode_index", "index")
    }
    features = {
        "observation.state": {"dtype": "float32", "shape": [len(STATE)], "names": STATE},
        "action": {"dtype": "float32", "shape": [len(COMMANDS)], "names": COMMANDS},
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
        **numbers,
    }
    info = {
        "codebase_version": "v3.0",
        "robot_type": robot,
        "total_episodes": len(lengths),
        "total_frames": start,
    }
    info |= {"total_tasks": 1, "chunks_size": 2, "fps": 4, "features": features}
    (root / "meta/info.json").write_text(json.dumps(info | change))
    return root


def write(path: Path, table: pa.Table) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table, path)


def edit(root: Path, number: int, column: str, change: Callable[[pa.Array], Any] | None) -> None:
    """Change a column of an episode, or leave it out."""
    path = root / f"data/chunk-{number // 2:03d}/file-{number % 2:03d}.parquet"
    table = pq.read_table(path)
    at = table.column_names.index(column)
    values = table[column].combine_chunks()
    table = table.remove_column(at)
    write(path, table if change is None else table.append_column(column, change(values)))


def info(root: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    path = root / "meta/info.json"
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


def test_what_lerobot_recorded_is_read(tmp_path: Path) -> None:
    root = lerobot(tmp_path / "set")
    before = {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}
    assert check(root) == []
    episodes = load(root)
    assert len(episodes) == 5 + 3 + 4, "the last frame of each has no outcome"
    table = pq.read_table(root / "data/chunk-001/file-000.parquet")
    states, actions = (np.stack(table[name].to_numpy()) for name in ("observation.state", "action"))
    assert np.array_equal(episodes.observation[-4:], states[:-1]) and np.array_equal(
        episodes.next_observation[-4:], states[1:]
    )
    assert np.allclose(episodes.action[-4:], actions[:-1] / 100.0)
    wanted = TASK.reward(episodes.observation, episodes.action, episodes.next_observation)
    assert torch.equal(episodes.reward, wanted.reshape(-1))
    assert (
        bool((episodes.terminated | episodes.truncated)[-1])
        and episodes.rows[0].about.policy == "lerobot"
    )
    assert {path: path.read_bytes() for path in root.rglob("*") if path.is_file()} == before


def test_images_that_are_not_read_are_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    root = lerobot(tmp_path / "set")
    load(root)
    assert not caplog.messages
    picture = {"dtype": "video", "shape": [48, 64, 3], "names": None}
    info(root, lambda content: content["features"].update({"observation.images.top": picture}))
    assert len(load(root)) == 5 + 3 + 4
    (said,) = caplog.messages
    assert said == f"{root} has images (observation.images.top), which are not read"


def test_a_new_episode_begins_where_the_task_ends(tmp_path: Path) -> None:
    root = lerobot(tmp_path / "set", (6,))
    distances = [500.0, 600.0, 30.0, 700.0, 800.0, 900.0]

    def driven(values: pa.Array) -> pa.Array:
        states = np.stack(values.to_numpy(zero_copy_only=False)).copy()
        states[:, STATE.index("distance")] = distances
        # a list of another kind, as other programs write
        return pa.array(list(states), pa.list_(pa.float32()))

    edit(root, 0, "observation.state", driven)
    episodes = load(root)
    assert [row.length for row in episodes.rows] == [2, 3] and [
        row.terminated for row in episodes.rows
    ] == [True, False]
    assert episodes.episode.tolist() == [0, 0, 1, 1, 1]


def test_what_lerobot_recorded_is_imported_and_learned_from(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = lerobot(tmp_path / "set", (30, 30))
    Import(root, tmp_path / "ours").execute()
    assert "RunAway-v0" in capsys.readouterr().out and check(tmp_path / "ours") == []
    ours, theirs = load(tmp_path / "ours"), load(root)
    for name in (
        "observation",
        "action",
        "reward",
        "next_observation",
        "terminated",
        "truncated",
        "episode",
    ):
        assert torch.equal(getattr(ours, name), getattr(theirs, name)), name
    assert CheckData(root).execute() == 0
    settings = preset("default", "bc")
    config = TrainConfig(
        "RunAway-v0",
        "bc",
        1,
        data=str(root),
        updates=2,
        settings=settings,
        run_dir=tmp_path / "run",
    )
    assert len(train(config).episodes) == 1


REFUSED: dict[str, tuple[Callable[[Path], object], str]] = {
    "no state": (
        lambda root: info(root, lambda i: i["features"].pop("observation.state")),
        "no feature observation.state",
    ),
    "no action": (
        lambda root: info(root, lambda i: i["features"].pop("action")),
        "no feature action",
    ),
    "no names": (
        lambda root: info(root, lambda i: i["features"]["action"].update(names=None)),
        "does not name the numbers of action",
    ),
    "other names": (
        lambda root: info(
            root, lambda i: i["features"]["observation.state"]["names"].__setitem__(-1, "sonar")
        ),
        "has no distance, only",
    ),
    "shape": (
        lambda root: info(root, lambda i: i["features"]["observation.state"].update(shape=[2])),
        "does not name",
    ),
    "a column": (lambda root: edit(root, 1, "action", None), "has not one column action"),
    "an index": (lambda root: edit(root, 1, "index", None), "has not one column index"),
    "a file": (
        lambda root: (root / "data/chunk-000/file-001.parquet").unlink(),
        "has 11 frames, and its info.json counts 15",
    ),
    "all files": (
        lambda root: [path.unlink() for path in root.glob("data/*/*")],
        "has no files data/chunk-000",
    ),
    "a gap in the index": (
        lambda root: edit(root, 1, "index", lambda v: pa.array([6, 7, 9, 10])),
        "gap: frame 8 has the index 9",
    ),
    "a gap in frames": (
        lambda root: edit(root, 1, "frame_index", lambda v: pa.array([0, 1, 3, 4])),
        "episode 1: its frame 2",
    ),
    "an episode": (
        lambda root: edit(root, 1, "episode_index", lambda v: pa.array([2] * 4)),
        "does not have the 3 episodes",
    ),
    "a number": (
        lambda root: edit(
            root,
            1,
            "action",
            lambda v: pa.FixedSizeListArray.from_arrays(pa.array([1.0, np.nan, 1, 1], "f4"), 1),
        ),
        "action in .* is no number in frame 7",
    ),
    "null": (
        lambda root: edit(root, 1, "action", lambda v: pa.array([[1.0], None, [1.0], [1.0]])),
        "does not hold 1 number in each",
    ),
    "text": (
        lambda root: edit(root, 1, "index", lambda v: pa.array(list("abcd"))),
        "holds no numbers",
    ),
    "fps": (lambda root: info(root, lambda i: i.update(fps=0)), "fps is 0"),
    "no fps": (lambda root: info(root, lambda i: i.pop("fps")), "cannot read the index"),
    "version": (
        lambda root: info(root, lambda i: i.update(codebase_version="v2.1")),
        "format v2.1, not v3.0; convert",
    ),
    "empty": (lambda root: info(root, lambda i: i.update(total_episodes=0)), "total_episodes is 0"),
    "robot": (
        lambda root: info(root, lambda i: i.update(robot_type="so100")),
        "robot 'so100', which .* say it: `bricksrl data import",
    ),
    "no json": (lambda root: (root / "meta/info.json").write_text("{"), "cannot read the index"),
    "no parquet": (
        lambda root: (root / "data/chunk-000/file-001.parquet").write_text("x"),
        "not a valid Parquet",
    ),
}


@pytest.mark.parametrize("missing", REFUSED)
def test_each_refusal_says_what_is_missing(tmp_path: Path, missing: str) -> None:
    root = lerobot(tmp_path / "my set")
    spoil, message = REFUSED[missing]
    spoil(root)
    with pytest.raises(DataError, match=message):
        load(root)
    assert [fault.detail for fault in check(root)] and CheckData(root).execute() == 1
    with pytest.raises(DataError, match=message):
        import_lerobot(root, tmp_path / "ours")
    assert not (tmp_path / "ours").exists()


def test_environment_is_said_where_the_robot_does_not_tell_it(tmp_path: Path) -> None:
    root = lerobot(tmp_path / "set", robot="so100")
    assert len(load(root, task="RunAway-v0")) == 12
    assert import_lerobot(root, tmp_path / "ours", env="RunAway-v0").description.env == "RunAway-v0"
    with pytest.raises(DataError, match="has no .*, only .*choose the environment of these data"):
        load(root, task="Walker-v0")
    with pytest.raises(
        DataError, match="RoboArm_mixed-v0: it observes images, which are not read|has no "
    ):
        load(root, task="RoboArm_mixed-v0")


def test_edits_of_foreign_datasets_name_the_way(tmp_path: Path) -> None:
    with pytest.raises(
        DataError,
        match="was not made by BricksRL.*`bricksrl data import '.*my set' --out NEW` makes it ours",
    ):
        merge([lerobot(tmp_path / "my set")], tmp_path / "out")


@pytest.mark.parametrize("command", ["info {}", "plot {} --out x.png", "split {} --out s --rest t"])
def test_commands_on_foreign_datasets_name_the_remedy_in_one_line(
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    root = lerobot(Path("set"))
    assert run(["data", *command.format(root).split()]) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1
    assert "`bricksrl data import set --out NEW` makes it ours" in said.err
    assert [path.name for path in tmp_path.iterdir()] == ["set"]


def test_check_of_a_foreign_dataset_says_how_to_name_its_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The import takes it, and checks; the check of a dataset has no environment of its own."""
    monkeypatch.chdir(tmp_path)
    lerobot(Path("known"))
    lerobot(Path("other"), robot="so100")
    assert run(["data", "check", "known"]) == 0
    assert capsys.readouterr().out == "all is well\n"
    assert run(["data", "check", "other"]) == 1
    assert "`bricksrl data import other --env ENV --out NEW`" in capsys.readouterr().out
    assert run(["data", "import", "other", "--env", "RunAway-v0", "--out", "ours"]) == 0
    assert run(["data", "check", "ours"]) == 0
