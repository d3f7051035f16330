"""Files of a dataset, letter by letter: what LeRobot, spreadsheets and readers find in them."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import test_lerobot
import torch
from tensordict import TensorDict
from test_lerobot import edit as edit_column
from test_lerobot import info as edit_info
from test_lerobot import lerobot
from toy_data import SEEING, TOY, record
from toys import Cart

from brickhub.entry import Entry
from bricksrl.data import About, Recorder, load, share, summary
from bricksrl.data import collect as collecting
from bricksrl.data.collect import about, collect, random_policy, step_of
from bricksrl.data.csv_files import export_csv
from bricksrl.data.dataset import Dataset, dataset_folder, existing_dataset
from bricksrl.data.edit import merge
from bricksrl.data.formats import _minari_environment, _policy_of, _task_of, export_minari
from bricksrl.data.lerobot import read_lerobot
from bricksrl.data.schema import describe, describe_task
from bricksrl.data.steps import Step, new_episode
from bricksrl.data.summary import Summary, plot
from bricksrl.envs import get_task
from bricksrl.envs.env_interface import BricksEnv
from bricksrl.errors import DataError
from bricksrl.plotting import INK, MUTED

VECTOR = {
    "observation.state": (2, ["angle", "distance"]),
    "action": (1, ["motor"]),
    "next.observation.state": (2, ["angle", "distance"]),
}
NUMBERS = {
    "next.reward": "float32",
    "next.done": "bool",
    "next.terminated": "bool",
    "next.truncated": "bool",
    "intervention": "bool",
    "age_s": "float32",
    "hub_time_s": "float64",
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
WEBCAM = "observation.images.webcam"


def features(*, sees: bool) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, (size, names) in VECTOR.items():
        found[name] = {"dtype": "float32", "shape": [size], "names": names}
    for name, dtype in NUMBERS.items():
        found[name] = {"dtype": dtype, "shape": [1], "names": None}
    if sees:
        about_video = {
            "video.height": 16,
            "video.width": 16,
            "video.codec": "h264",
            "video.pix_fmt": "gbrp",
            "video.is_depth_map": False,
            "video.fps": 4,
            "video.channels": 3,
            "has_audio": False,
        }
        found[WEBCAM] = {
            "dtype": "video",
            "shape": [16, 16, 3],
            "names": ["height", "width", "channels"],
            "info": about_video,
        }
    return found


@pytest.mark.parametrize("description", [TOY, SEEING])
def test_index_says_what_lerobot_asks_for(description: Any) -> None:
    sees = description is SEEING
    video_path = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
    assert description.info(2, 8) == {
        "codebase_version": "v3.0",
        "robot_type": "toy",
        "total_episodes": 2,
        "total_frames": 8,
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": 4,
        "splits": {"train": "0:2"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": video_path if sees else None,
        "features": features(sees=sees),
    }


def test_description_is_one_object_of_json() -> None:
    free = replace(TOY, observation=(Entry("wind"),), options={"sparse": True})
    values = json.loads(free.to_json())
    assert len(values.pop("sha256")) == 64
    assert values == {
        "bricksrl_dataset": 1,
        "env": "Toy-v0",
        "rate_hz": 4.0,
        "observation": [{"name": "wind", "unit": "", "low": None, "high": None, "wraps": False}],
        "action": [{"name": "motor", "unit": "deg", "low": -100.0, "high": 100.0, "wraps": False}],
        "robot": {"name": "toy", "motors": ["motor"]},
        "options": {"sparse": True},
        "camera": None,
        "image_px": 0,
    }
    assert free.to_json().endswith(b"\n}\n")


def test_differences_of_cameras_options_and_robots_are_said() -> None:
    other = replace(SEEING, options={"sparse": True}, robot={}, image_px=32)
    assert TOY.differences(other) == [
        "camera webcam instead of None",
        "image_px 32 instead of 0",
        "options {'sparse': True} instead of {}",
        "robot none instead of toy",
    ]
    assert other.differences(TOY)[-1] == "robot toy instead of none"
    farther = replace(TOY, observation=(TOY.observation[0], Entry("distance", 0.0, 100.0, "mm")))
    assert TOY.differences(farther) == ["observation with another unit or range of distance"]


def test_rows_of_episodes_have_lerobot_s_columns_and_ours(tmp_path: Path) -> None:
    """Each recorded episode has a video of its own, whose time begins anew."""
    root = record(tmp_path / "set", (3, 5), SEEING)
    table = pq.read_table(root / "meta/episodes/chunk-000/file-001.parquet")
    (row,) = table.to_pylist()
    for name in ("data/sha256", f"videos/{WEBCAM}/sha256"):
        assert len(row.pop(name)) == 64
    last = load(root)
    assert row.pop(f"final/{WEBCAM}") == last.next_image[-1].numpy().tobytes()  # type: ignore[index]
    assert row.pop("return") == pytest.approx(float(last.reward[3:].sum()), abs=1e-5)
    statistics = {name: row.pop(name) for name in list(row) if name.startswith("stats/")}
    assert row == {
        "episode_index": 1,
        "length": 5,
        "dataset_from_index": 3,
        "dataset_to_index": 8,
        "terminated": False,
        "interventions": 2,
        "data/chunk_index": 0,
        "data/file_index": 1,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 1,
        f"videos/{WEBCAM}/chunk_index": 0,
        f"videos/{WEBCAM}/file_index": 1,
        f"videos/{WEBCAM}/from_timestamp": 0.0,
        f"videos/{WEBCAM}/to_timestamp": 1.25,
        "tasks": ["Toy-v0"],
        "policy": "random",
        "seed": 1,
        "success": False,
        "whole": True,
        "started": "",
        "hub": "virtual",
        "robot": "",
        "program_hash": None,
        "versions": '{"bricksrl": "0"}',
        "physics": "{}",
    }
    assert len(statistics) == 5 * len(features(sees=True))
    image = last.image[3:].numpy() / 255.0  # type: ignore[index]
    for number, (stat, of) in enumerate((("min", np.min), ("max", np.max), ("mean", np.mean))):
        found = np.array(statistics[f"stats/{WEBCAM}/{stat}"])
        assert found.shape == (3, 1, 1), number
        assert found[:, 0, 0] == pytest.approx(of(image, axis=(0, 1, 2)))
    deviation = np.array(statistics[f"stats/{WEBCAM}/std"])[:, 0, 0]
    assert deviation == pytest.approx(image.std((0, 1, 2)))
    assert statistics[f"stats/{WEBCAM}/count"] == statistics["stats/action/count"] == [5]
    # In one file, the second episode begins where the first one ends.
    merge([root], tmp_path / "merged")
    rows = pq.read_table(tmp_path / "merged/meta/episodes/chunk-000/file-000.parquet").to_pylist()
    times = [
        (row[f"videos/{WEBCAM}/from_timestamp"], row[f"videos/{WEBCAM}/to_timestamp"])
        for row in rows
    ]
    assert times == [(0.0, 0.75), (0.75, 2.0)]


def test_only_instruction_is_the_environment_in_pandas_own_layout(tmp_path: Path) -> None:
    root = record(tmp_path / "set", (2,))
    table = pq.read_table(root / "meta/tasks.parquet")
    assert table.to_pylist() == [{"task_index": 0, "task": "Toy-v0"}]
    pandas = json.loads(table.schema.metadata[b"pandas"])
    assert pandas["index_columns"] == ["task"]
    assert pandas["columns"] == [
        {
            "name": "task_index",
            "field_name": "task_index",
            "pandas_type": "int64",
            "numpy_type": "int64",
            "metadata": None,
        },
        {
            "name": "task",
            "field_name": "task",
            "pandas_type": "unicode",
            "numpy_type": "object",
            "metadata": None,
        },
    ]
    (index,) = pandas["column_indexes"]
    assert (index["name"], index["field_name"], index["numpy_type"]) == (None, None, "object")
    assert (pandas["creator"]["library"], pandas["pandas_version"]) == ("pyarrow", "2.0.0")


def test_a_folder_has_a_thousand_files_at_most(tmp_path: Path) -> None:
    dataset = Dataset(tmp_path, SEEING)
    for number, place in (
        (0, "chunk-000/file-000"),
        (999, "chunk-000/file-999"),
        (1000, "chunk-001/file-000"),
        (2345, "chunk-002/file-345"),
    ):
        assert dataset.path("data", number) == tmp_path / f"data/{place}.parquet"
        assert dataset.path("episodes", number) == tmp_path / f"meta/episodes/{place}.parquet"
        assert dataset.path("video", number) == tmp_path / f"videos/{WEBCAM}/{place}.mp4"
    assert (dataset.steps, dataset.data_files) == (0, 0)


def test_a_dataset_is_found_in_its_folder_and_in_that_of_a_run(tmp_path: Path) -> None:
    run = record(tmp_path / "run/data", (2,)).parent
    assert dataset_folder(run) == existing_dataset(run) == run / "data"
    assert dataset_folder(run / "data") == run / "data"
    for nothing in (tmp_path, tmp_path / "nowhere"):
        assert dataset_folder(nothing) == nothing
        with pytest.raises(DataError, match="there is no dataset in "):
            existing_dataset(nothing)


@pytest.mark.parametrize(("most", "files"), [(3, 3), (4, 2), (8, 2), (9, 1), (12, 1), (13, 1)])
def test_a_file_is_full_with_its_steps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most: int, files: int
) -> None:
    monkeypatch.setattr("bricksrl.data.edit.STEPS_PER_FILE", most)
    whole = merge([record(tmp_path / "set", (3, 5, 4))], tmp_path / "merged")
    assert len(list((tmp_path / "merged/data").rglob("*.parquet"))) == files
    assert [row.length for row in whole.rows] == [3, 5, 4] and whole.root == tmp_path / "merged"
    assert (whole.steps, whole.data_files, whole.row_files) == (12, files, 1)
    assert torch.equal(load(tmp_path / "merged").action, load(tmp_path / "set").action)


def test_some_entries_of_the_observations_are_taken_in_their_order(tmp_path: Path) -> None:
    whole = load(record(tmp_path / "set", (3, 2)))
    assert len(whole) == 5
    part = whole.observing(["distance"])
    assert [entry.name for entry in part.description.observation] == ["distance"]
    assert torch.equal(part.observation, whole.observation[:, 1:])
    assert torch.equal(part.next_observation, whole.next_observation[:, 1:])
    turned = whole.observing(["distance", "angle"])
    assert torch.equal(turned.observation, whole.observation.flip(-1))
    assert [entry.name for entry in turned.description.observation] == ["distance", "angle"]
    assert whole.observing([]).observation.shape == (5, 0)
    steps = whole.to_tensordict()
    assert steps["intervention"].tolist() == [True, False, False, True, False]
    assert steps["next", "truncated"][:, 0].tolist() == [False, False, True, False, True]
    assert not bool(steps["next", "terminated"].any())


# ---------------------------------------------------------------- steps and CSV


def told(**changes: Any) -> Step:
    known = {
        "observation": [10.0, 200.0],
        "action": [0.5],
        "reward": 1.5,
        "next_observation": [20.0, 1234.5678],
        "terminated": False,
        "truncated": False,
    }
    return Step(**{**known, **changes})


TWO = (
    told(hub_time_s=12345.678901, intervention=True),
    told(observation=[20.0, 1234.5678], next_observation=[30.0, 0.1], reward=-0.1, terminated=True),
)


def test_steps_have_nominal_times_and_places() -> None:
    episode = new_episode([*TWO, told(truncated=True)], About(), TOY)
    columns = episode.columns
    assert columns["timestamp"].tolist() == [0.0, 0.25, 0.5]
    assert columns["timestamp"].dtype == np.float32
    for name in ("frame_index", "index"):
        assert columns[name].tolist() == [0, 1, 2] and columns[name].dtype == np.int64
    for name in ("episode_index", "task_index"):
        assert columns[name].tolist() == [0, 0, 0] and columns[name].dtype == np.int64
    assert columns["next.done"].reshape(-1).tolist() == [False, True, True]
    assert columns["next.terminated"].reshape(-1).tolist() == [False, True, False]
    assert columns["intervention"].reshape(-1).tolist() == [True, False, False]
    assert columns["hub_time_s"].reshape(-1)[0] == 12345.678901
    assert np.isnan(columns["hub_time_s"].reshape(-1)[1:]).all()
    assert columns["age_s"].reshape(-1).tolist() == [0.0, 0.0, 0.0]
    assert columns["observation.state"].shape == (3, 2)
    assert episode.images is None and episode.image_statistics is None


def test_table_of_an_episode_is_what_a_spreadsheet_shows(tmp_path: Path) -> None:
    with Recorder(tmp_path / "set", TOY) as recorder:
        recorder.write(TWO, About())
    export_csv(tmp_path / "set", tmp_path / "all.csv")
    names = "observation.angle,observation.distance,action.motor,reward,terminated,truncated"
    lines = [
        f"episode,step,seconds,{names},intervention,hub_time_s",
        "0,0,0,10,200,0.5,1.5,0,0,1,12345.6789",
        "0,1,0.25,20,1234.568,0.5,-0.1,1,0,0,",
        "0,2,0.5,30,0.1,,,,,,",
    ]
    assert (tmp_path / "all.csv").read_bytes().decode() == "".join(f"{line}\n" for line in lines)


# ---------------------------------------------------------------- descriptions and provenance


def test_task_is_described_with_its_robot_but_without_its_model() -> None:
    task = get_task("RunAway-v0")
    found = describe_task(task, {"ends_at_wall": False})
    assert (found.env, found.rate_hz, found.options) == ("RunAway-v0", 1.0, {"ends_at_wall": False})
    assert [(entry.name, entry.unit, entry.wraps) for entry in found.observation] == [
        ("left_angle", "deg", True),
        ("right_angle", "deg", True),
        ("pitch", "deg", False),
        ("roll", "deg", False),
        ("distance", "mm", False),
    ]
    assert all(entry.limits is None for entry in found.observation)
    assert "model" not in found.robot and "plan" not in found.robot
    assert found.robot["hub"] == "prime"
    assert [motor["name"] for motor in found.robot["motors"]] == ["left", "right"]
    assert (found.camera, found.image_px, found.image_key) == (None, 0, None)
    seeing = describe_task(get_task("RoboArm_mixed-v0"))
    assert (seeing.camera, seeing.image_px) == ("webcam", 64)
    assert describe_task(get_task("Walker-v0")).rate_hz == 4.0


def test_environment_without_a_task_is_described_by_its_specs() -> None:
    found = describe(Cart(), {"size": (1, 2)})
    assert (found.env, found.rate_hz, found.options) == ("Cart", 1.0, {"size": [1, 2]})
    assert [(entry.name, entry.low, entry.high) for entry in found.observation] == [
        ("observation_0", 0.0, 1000.0),
        ("observation_1", -1.0, 1.0),
    ]
    assert [(entry.name, entry.low, entry.high) for entry in found.action] == [
        ("action_0", -1.0, 1.0)
    ]
    assert describe(Cart(), name="Mine-v0").env == "Mine-v0"


class Machine(BricksEnv):
    """An environment whose robot has known physics."""

    def __init__(self, robots: int, twin: Any = None, runs_programs: bool = True) -> None:
        self.robots = robots
        self._twin = twin
        model = SimpleNamespace(runs_programs=runs_programs)
        robot = SimpleNamespace(hub=SimpleNamespace(model=model))
        self.task: Any = SimpleNamespace(robot=robot, hub_program=SimpleNamespace(hash=77))

    @property
    def twin(self) -> Any:
        return self._twin


def test_provenance_is_that_of_the_robot_that_moved(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(collecting.dataclasses, "asdict", lambda physics: {"battery_v": physics})
    physics = SimpleNamespace(with_link=lambda link: (7.4, link))
    twin = SimpleNamespace(body=SimpleNamespace(physics=physics), link="slow")
    before = datetime.now().astimezone()
    virtual = about(Machine(1, twin), "sac", seed=3)  # type: ignore[arg-type]
    assert (virtual.policy, virtual.seed, virtual.hub) == ("sac", 3, "virtual")
    assert virtual.program_hash == 77 and virtual.physics == {"battery_v": (7.4, "slow")}
    assert (virtual.success, virtual.whole) == (None, True)
    started = datetime.fromisoformat(virtual.started)
    assert started.tzinfo is not None and abs((started - before).total_seconds()) < 60.0
    assert len(virtual.started.partition(".")[2]) == len("000+00:00"), "milliseconds"
    assert {"brickhub", "bricktwin", "bricksrl", "torch", "torchrl", "mujoco"} == set(
        virtual.versions
    )
    real = about(Machine(1, twin), "sac", hub="ble")  # type: ignore[arg-type]
    assert (real.hub, real.physics, real.seed) == ("ble", {}, None)
    bodiless = SimpleNamespace(body=SimpleNamespace(), link="slow")
    assert about(Machine(1, bodiless), "sac").physics == {}  # type: ignore[arg-type]
    kit = about(Machine(1, twin, runs_programs=False), "sac")  # type: ignore[arg-type]
    assert kit.program_hash is None
    simulated = about(Machine(0, twin), "sac")  # type: ignore[arg-type]
    assert (simulated.hub, simulated.program_hash, simulated.physics) == ("", None, {})


def frame(*, done: bool, terminated: bool) -> TensorDict:
    after = {
        "observation": torch.tensor([3.0, 4.0]),
        "reward": torch.tensor([0.5]),
        "done": torch.tensor([done]),
        "terminated": torch.tensor([terminated]),
        "image": torch.zeros(1),
    }
    return TensorDict(
        {
            "observation": torch.tensor([1.0, 2.0]),
            "action": torch.tensor([0.25]),
            "next": TensorDict(after, []),
        },
        [],
    )


@pytest.mark.parametrize(
    ("done", "terminated", "ends"),
    [
        (False, False, (False, False)),
        (True, True, (True, False)),
        (True, False, (False, True)),
    ],
)
def test_step_ends_by_the_task_or_by_anything_else(
    done: bool, terminated: bool, ends: tuple[bool, bool]
) -> None:
    given = frame(done=done, terminated=terminated)
    step = step_of(given, Cart())
    assert (step.terminated, step.truncated) == ends
    given["observation"].fill_(9.0)
    assert np.asarray(step.observation).tolist() == [1.0, 2.0], "copied"
    assert np.asarray(step.next_observation).tolist() == [3.0, 4.0]
    assert (np.asarray(step.action).tolist(), step.reward) == ([0.25], 0.5)
    assert step.intervention is False and step.image is None and step.age_s == 0.0
    assert math.isnan(step.hub_time_s)
    given["intervention"] = torch.tensor(True)
    assert step_of(given, Cart()).intervention is True


def test_random_actions_are_uniform_and_their_own() -> None:
    act = random_policy(Cart(), 3)
    torch.manual_seed(0)
    shares = torch.cat([act(TensorDict({}, []))["action"] for _ in range(2000)])
    assert shares.min() >= -1.0 and shares.max() <= 1.0
    quarters = torch.histc(shares, 4, -1.0, 1.0) / 2000
    assert quarters.tolist() == pytest.approx([0.25] * 4, abs=0.04)
    torch.manual_seed(1)
    again = random_policy(Cart(), 3)
    assert torch.equal(torch.cat([again(TensorDict({}, []))["action"]]), shares[:1])


def test_recording_that_goes_on_another_day_equals_one_in_a_single_piece(tmp_path: Path) -> None:
    def recorded(root: Path, *parts: int, seed: int = 3) -> Any:
        for episodes in parts:
            cart = Cart()
            with Recorder(root, describe(cart)) as recorder:
                rows = collect(
                    cart,
                    lambda state: state.set("action", torch.tensor([0.5])),
                    recorder,
                    episodes,
                    name="ahead",
                    seed=seed,
                )
                assert len(rows) == episodes
        return load(root)

    whole = recorded(tmp_path / "whole", 3)
    parts = recorded(tmp_path / "parts", 2, 1)
    assert torch.equal(whole.observation, parts.observation)
    seeds = [row.about.seed for row in whole.rows]
    assert seeds == [row.about.seed for row in parts.rows] and len(set(seeds)) == 3
    assert all(seed is not None and 0 <= seed < 2**31 for seed in seeds)
    other = recorded(tmp_path / "other", 1, seed=4)
    assert other.rows[0].about.seed != seeds[0]
    assert all((row.about.policy, row.about.hub) == ("ahead", "") for row in whole.rows)


# ---------------------------------------------------------------- other formats


def test_commands_of_lerobot_are_mapped_from_their_ranges(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Legs of Walker-v0 turn backwards alone, by 100 to 0 degrees."""
    task = get_task("Walker-v0")
    monkeypatch.setattr(test_lerobot, "STATE", [entry.name for entry in task.entries])
    commands = [command.name for command in task.interface.commands]
    monkeypatch.setattr(test_lerobot, "COMMANDS", commands)
    root = lerobot(tmp_path / "set", (30,), robot="bricksrl_walker")
    description, episodes = read_lerobot(root)
    assert description.env == "Walker-v0"
    table = pq.read_table(root / "data/chunk-000/file-000.parquet")
    given_deg = np.stack(table["action"].to_numpy())[:-1]
    wanted = np.clip(1.0 + given_deg / 50.0, -1.0, 1.0)
    found = np.concatenate([episode.columns["action"] for episode in episodes])
    assert found == pytest.approx(wanted, abs=1e-5)
    assert (wanted == 1.0).any() and (wanted < 0.0).any()


def test_names_in_groups_and_more_than_is_observed_are_read(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    root = lerobot(tmp_path / "set")
    names = test_lerobot.STATE

    def group(content: dict[str, Any]) -> None:
        content["features"]["observation.state"]["names"] = {
            "motors": names[:2],
            "hub": names[2:4],
            "distance": names[4],
        }

    before = load(root).observation
    edit_info(root, group)
    assert torch.equal(load(root).observation, before) and not caplog.messages
    task = replace(get_task("Spinning-v0"), id="Rolling-v0", sampled_entries=())
    channels = task.interface.channels[:2]
    commands = get_task("RunAway-v0").interface.commands
    interface = replace(task.interface, channels=channels, commands=commands)
    fewer = replace(
        get_task("RunAway-v0"),
        id="Rolling-v0",
        doc="Rolls.",
        interface=interface,
        reward=lambda previous, action, observation: observation[..., :1],
        terminated=get_task("Spinning-v0").terminated,
        success=lambda observations: observations[..., -1, 0] > 0.0,
        metrics=lambda observations: {},
    )
    _, episodes = read_lerobot(root, fewer)
    found = np.concatenate([episode.columns["observation.state"] for episode in episodes])
    assert np.array_equal(found, before[:, :2])
    assert caplog.messages == [
        f"{root} has pitch, roll, distance, which is not observed; it is left out"
    ]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"total_frames": 0}, "total_frames is 0; record at least one episode"),
        ({"total_episodes": True}, "total_episodes is True; record at least"),
        ({"fps": True}, "fps is True; restore it from a copy"),
        ({"fps": -1}, "fps is -1; restore it from a copy"),
    ],
)
def test_numbers_of_an_index_of_lerobot_are_looked_at(
    tmp_path: Path, change: dict[str, Any], says: str
) -> None:
    with pytest.raises(DataError, match=says):
        read_lerobot(lerobot(tmp_path / "set", **change))


@pytest.mark.parametrize(
    "change",
    [
        lambda values: values.flatten(),
        lambda values: pa.array(values.to_pylist(), pa.list_(pa.float32())),
        lambda values: pa.array(values.to_pylist(), pa.large_list(pa.float64())),
    ],
)
def test_numbers_of_lerobot_are_read_from_lists_of_any_kind(tmp_path: Path, change: Any) -> None:
    root = lerobot(tmp_path / "set")
    before = load(root).action
    edit_column(root, 1, "action", change)
    assert torch.equal(load(root).action, before)


@pytest.mark.parametrize(
    ("column", "change", "says"),
    [
        ("action", lambda values: pa.array([1, 2, 3, 4]), None),
        ("action", lambda values: pa.array([[1], [2], [3], [4]]), "1 number"),
        ("action", lambda values: pa.array([[1.0, 2.0]] * 4), "1 number"),
        ("action", lambda values: pa.array([[1.0]] * 3 + [[None]]), "1 number"),
        ("observation.state", lambda values: pa.array([1.0] * 4), "5 numbers"),
        ("index", lambda values: pa.array([[6], [7], [8], [9]]), "1 number"),
    ],
)
def test_columns_of_lerobot_that_hold_something_else_are_told(
    tmp_path: Path, column: str, change: Any, says: str | None
) -> None:
    root = lerobot(tmp_path / "set")
    edit_column(root, 1, column, change)
    if says is None:
        assert load(root).action[5:8, 0].tolist() == pytest.approx([0.01, 0.02, 0.03])
        return
    path = root / "data/chunk-000/file-001.parquet"
    with pytest.raises(DataError) as caught:
        load(root)
    assert str(caught.value) == (
        f"{path}: the column {column} does not hold {says} in each frame; restore it"
    )


@pytest.mark.parametrize(
    ("folder", "env", "policy"),
    [
        ("Walker/expert_data", "Walker-v0", "expert"),
        ("roboarm_random", "RoboArm-v0", "random"),
        ("data/SPINNING/buffer", "Spinning-v0", "buffer"),
        ("walker/runaway-expert-random", "RunAway-v0", "expert"),
    ],
)
def test_names_of_the_paper_s_folders_tell_task_and_policy(
    folder: str, env: str, policy: str
) -> None:
    # The innermost name that tells a task counts.
    assert _task_of(Path("/") / folder) == env
    assert _policy_of(Path(folder)) == policy


def test_spaces_of_an_export_to_minari_are_those_of_the_numbers(tmp_path: Path) -> None:
    found = _minari_environment(load(record(tmp_path / "set", (2,))))
    assert found["env"] is None
    space = found["observation_space"]
    assert space.shape == (2,) and np.isinf(space.low).all() and np.isinf(space.high).all()
    assert (found["action_space"].low, found["action_space"].high) == (-1.0, 1.0)
    seeing = _minari_environment(load(record(tmp_path / "seeing", (2,), SEEING)))
    parts = seeing["observation_space"].spaces
    assert set(parts) == {"observation", "image"}
    image = parts["image"]
    assert (image.shape, image.dtype) == ((16, 16, 3), np.uint8)
    assert (image.low.min(), image.high.max()) == (0, 255)


class Minari:
    """Minari's writer, which notes what it is given and writes as Minari does."""

    def __init__(self) -> None:
        self.given: list[Any] = []

    def create(self, name: str, buffers: list[Any], **about: Any) -> None:
        self.given.append((name, buffers, about))
        folder = Path(os.environ["MINARI_DATASETS_PATH"]) / name / "data"
        folder.mkdir(parents=True)
        (folder / "main_data.hdf5").write_bytes(b"data")
        (folder.parent.parent / "namespace.json").write_text("{}")


@pytest.fixture
def minari(monkeypatch: pytest.MonkeyPatch) -> Minari:
    made = Minari()
    module = SimpleNamespace(create_dataset_from_buffers=made.create)
    collector = SimpleNamespace(EpisodeBuffer=dict)
    namespace = SimpleNamespace(NAMESPACE_METADATA_FILENAME="namespace.json")
    monkeypatch.setitem(sys.modules, "minari", module)
    monkeypatch.setitem(sys.modules, "minari.data_collector", collector)
    monkeypatch.setitem(sys.modules, "minari.namespace", namespace)
    monkeypatch.delenv("MINARI_DATASETS_PATH", raising=False)
    return made


def test_episodes_go_to_minari_with_one_observation_more_than_steps(
    tmp_path: Path, minari: Minari
) -> None:
    root = tmp_path / "set"
    with Recorder(root, TOY) as recorder:
        recorder.write(TWO, About(policy="sac", seed=3))
        recorder.write(TWO[:1], About(policy="random"))
        recorder.write(TWO[:1], About(policy="sac"))
    out = tmp_path / "all" / "toys" / "mine-v2"
    export_minari(root, out)
    ((name, buffers, about_all),) = minari.given
    assert name == "toys/mine-v2"
    for left_out in ("env", "observation_space", "action_space"):
        about_all.pop(left_out)
    assert about_all == {
        "algorithm_name": "sac, random",
        "description": "Toy-v0, recorded with BricksRL",
        "data_format": "hdf5",
        "jpeg_encoding": False,
    }
    first = buffers[0]
    assert (first["id"], first["seed"]) == (0, 3)
    observed = [[10.0, 200.0], [20.0, 1234.5678], [30.0, 0.1]]
    assert first["observations"] == pytest.approx(np.array(observed, np.float32))
    assert first["actions"].tolist() == [[0.5], [0.5]]
    assert first["rewards"] == pytest.approx([1.5, -0.1])
    assert (first["terminations"], first["truncations"]) == ([False, True], [False, False])
    assert first["infos"] == {"intervention": [False, True, False]}
    assert [buffer["id"] for buffer in buffers] == [0, 1, 2]
    # Only the dataset itself stands where it was asked for, beside the file of its namespace.
    assert (out / "data" / "main_data.hdf5").read_bytes() == b"data"
    assert sorted(path.name for path in out.parent.iterdir()) == ["mine-v2", "namespace.json"]
    assert "MINARI_DATASETS_PATH" not in os.environ


def test_name_that_minari_refuses_is_told(
    tmp_path: Path, minari: Minari, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any, **__: Any) -> None:
        raise ValueError("a bad name")

    sys.modules["minari"].create_dataset_from_buffers = refuse  # type: ignore[attr-defined]
    monkeypatch.setenv("MINARI_DATASETS_PATH", "before")
    out = tmp_path / "my toys" / "mine-v2"
    with pytest.raises(DataError) as caught:
        export_minari(record(tmp_path / "set", (2,)), out)
    assert str(caught.value) == (
        "Minari refuses the name my toys/mine-v2 (a bad name); end the path like bricksrl/walker-v0"
    )
    assert os.environ["MINARI_DATASETS_PATH"] == "before" and not out.exists()


class HubApi:
    """The hub's client, which notes its calls."""

    endpoint = "https://hub"

    def __init__(self) -> None:
        self.calls: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = []

    def __getattr__(self, name: str) -> Any:
        return lambda *about, **named: self.calls.append((name, about, named))


@pytest.fixture
def hub(monkeypatch: pytest.MonkeyPatch) -> HubApi:
    api = HubApi()

    @contextmanager
    def client(_repo: str) -> Iterator[HubApi]:
        yield api

    monkeypatch.setattr(share, "hub_client", client)
    return api


@pytest.mark.parametrize("private", [False, True])
def test_dataset_goes_to_the_hub_with_its_card_and_its_tag(
    tmp_path: Path, hub: HubApi, private: bool
) -> None:
    root = record(tmp_path / "set", (2,))
    assert share.push_dataset(root, "me/toy", private=private) == "https://hub/datasets/me/toy"
    create, card, folder, tag = hub.calls
    kind = {"repo_type": "dataset"}
    assert create == ("create_repo", ("me/toy",), {**kind, "private": private, "exist_ok": True})
    text = card[2].pop("path_or_fileobj").decode()
    named = {"path_in_repo": "README.md", "repo_id": "me/toy", **kind}
    assert (card[0], card[2]) == ("upload_file", named)
    assert "\n# Toy-v0 on toy\n" in text and text.startswith("---\nlicense: mit\n")
    assert "- LeRobot\n- BricksRL\n- reinforcement-learning\n" in text
    assert "Recorded with BricksRL, in LeRobot's dataset format v3.0." in text
    assert "data_files: data/*/*.parquet" in text and "- `action`, in -1..1: motor" in text
    named = {
        "repo_id": "me/toy",
        "folder_path": str(root),
        "allow_patterns": ["meta/**", "data/**", "videos/**"],
        "ignore_patterns": "*/.*",
        **kind,
    }
    assert folder == ("upload_folder", (), named)
    assert tag == ("create_tag", ("me/toy",), {"tag": "v3.0", "exist_ok": True, **kind})


def test_dataset_comes_from_the_hub_in_the_revision_that_is_asked_for(
    tmp_path: Path, hub: HubApi
) -> None:
    out = tmp_path / "fetched"
    with share.downloaded("me/toy", "dataset", out, ["a", "b"], "main") as folder:
        assert not out.exists() and folder.is_dir()
    ((name, about_repo, named),) = hub.calls
    assert (name, about_repo) == ("snapshot_download", ("me/toy",))
    assert named == {
        "repo_type": "dataset",
        "revision": "main",
        "local_dir": str(folder),
        "allow_patterns": ["a", "b"],
        "max_workers": 2,
    }
    assert out.is_dir()


# ---------------------------------------------------------------- summaries

SUMMARY = Summary(
    env="Toy-v0",
    robot=None,
    episodes=3,
    transitions=12,
    return_mean=1.23456,
    return_std=0.5,
    return_min=-2.0,
    return_max=1000.04,
    length_mean=4.0,
    success_rate=0.5,
    broken_off=1,
    interventions=6,
    age_mean_s=0.02,
    policies={"sac": 2, "random": 1},
    rate_hz=2.5,
    observation=("angle", "distance"),
    action=("motor",),
    camera="webcam",
)


def test_card_of_a_dataset_says_what_is_in_it() -> None:
    card = share._card(
        title="Toy-v0 on no robot",
        about="Recorded.",
        rows=SUMMARY.rows(),
        tags=("LeRobot", "BricksRL"),
        files="data/*/*.parquet",
        licence="mit",
    )
    assert card == (
        "---\nlicense: mit\ntask_categories:\n- robotics\ntags:\n- LeRobot\n- BricksRL\n"
        "configs:\n- config_name: default\n  data_files: data/*/*.parquet\n---\n\n"
        "# Toy-v0 on no robot\n\nRecorded.\n\n| | |\n|---|---|\n"
        "| environment | Toy-v0 |\n| robot | no robot |\n| steps a second | 2.5 |\n"
        "| episodes | 3, broken off 1 |\n| transitions | 12 |\n| steps an episode | 4.0 |\n"
        "| return | 1.235 \u00b1 0.5  (from -2 to 1000) |\n| success | 50 % |\n"
        "| policy | sac (2), random (1) |\n| steps by hand | 6 |\n"
    )
    columns = share._about_columns(SUMMARY)
    assert columns.startswith(
        "\n- `observation.state`: angle, distance\n- `action`, in -1..1: motor\n"
    )
    camera = "\nImages of the camera `webcam` are in `videos`, without loss.\n"
    assert camera in columns
    without = share._about_columns(replace(SUMMARY, camera=None))
    assert columns.replace(camera, "") == without


@pytest.mark.parametrize(
    ("episodes", "bars"), [(1, 5), (15, 5), (18, 6), (90, 30), (93, 30), (200, 30)]
)
def test_returns_are_in_some_bars_of_three_episodes(episodes: int, bars: int) -> None:
    left, right = summary.new_figure(4.0, 2.0).subplots(1, 2)
    returns = np.linspace(-5.0, 7.0, episodes)
    summary._plot_returns(left, right, returns)
    assert len(left.patches) == bars
    (mean,) = left.lines
    assert mean.get_xdata() == pytest.approx([returns.mean()] * 2)
    assert (left.get_ylabel(), right.get_xlabel()) == ("episodes", "episode")


@pytest.mark.parametrize(("steps", "bins"), [(7, 7), (100, 100), (250, 100)])
def test_densities_have_a_hundred_bins_of_steps_at_most(steps: int, bins: int) -> None:
    axes = summary.new_figure(4.0, 2.0).subplots()
    summary._plot_density(axes, "angle", np.arange(steps), np.linspace(-3.0, 9.0, steps))
    counts = axes.collections[0].get_array()
    assert counts.size == bins * 40 and counts.sum() == steps
    assert (axes.get_xlim(), axes.get_ylim()) == ((0.0, float(steps)), (-3.0, 9.0))
    assert axes.get_xlabel() == "step"
    # What never occurs has no colour.
    assert np.ma.getmaskarray(counts).any() and counts.min() >= 1


@pytest.mark.parametrize(("observed", "rows", "empty"), [(2, 2, 2), (4, 2, 0), (5, 3, 3)])
def test_plots_are_in_rows_of_four(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, observed: int, rows: int, empty: int
) -> None:
    entries = tuple(Entry(f"entry_{number}", 0.0, 1.0) for number in range(observed))
    root = record(tmp_path / "set", (2, 1), replace(TOY, observation=entries))
    figures: list[Any] = []
    monkeypatch.setattr(summary, "save", lambda figure, _out, dpi: figures.append((figure, dpi)))
    plot(root, tmp_path / "toy.png")
    ((figure, dpi),) = figures
    assert figure.get_size_inches().tolist() == pytest.approx([16.0, 2.6 * rows])
    assert dpi == 100 and len(figure.axes) == 4 * rows
    visible = [axes.get_visible() for axes in figure.axes]
    assert visible == [True] * (4 * rows - empty) + [False] * empty
    title = figure._suptitle
    assert (title.get_position()[0], title.get_ha()) == (0.01, "left")
    assert (title.get_fontsize(), title.get_fontweight(), title.get_color()) == (13, "bold", INK)
    for axes in figure.axes[: 4 * rows - empty]:
        (name,) = [one for one in (axes._left_title, axes.title) if one.get_text()]
        assert (name.get_fontsize(), name.get_color()) == (10, INK)
        (label, *_) = axes.get_xticklabels()
        assert (label.get_fontsize(), label.get_color()) == (8, MUTED)
    for label in (figure.axes[0].yaxis.label, *(one.xaxis.label for one in figure.axes[1:3])):
        assert (label.get_fontsize(), label.get_color()) == (8, MUTED)
    assert figure.axes[2].get_title(loc="left") == "entry_0", "without a unit"
    for axes in figure.axes:
        assert not axes.spines["top"].get_visible() and not axes.spines["right"].get_visible()
