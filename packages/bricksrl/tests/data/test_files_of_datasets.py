"""Files of a dataset, letter by letter: what LeRobot, spreadsheets and readers find in them."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch
from tensordict import TensorDict
from toy_data import SEEING, TOY, record
from toys import Cart

from brickhub.entry import Entry
from bricksrl.data import About, Recorder, load
from bricksrl.data import collect as collecting
from bricksrl.data.collect import about, collect, random_policy, step_of
from bricksrl.data.csv_files import export_csv
from bricksrl.data.dataset import Dataset, dataset_folder, existing_dataset
from bricksrl.data.edit import merge
from bricksrl.data.schema import describe, describe_task
from bricksrl.data.steps import Step, new_episode
from bricksrl.envs import get_task
from bricksrl.envs.env_interface import BricksEnv
from bricksrl.errors import DataError

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
