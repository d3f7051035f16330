"""Datasets of LeRobot, the paper, Minari and the hub."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import test_lerobot
import torch
from test_files_of_datasets import TWO
from test_lerobot import edit as edit_column
from test_lerobot import info as edit_info
from test_lerobot import lerobot
from toy_data import SEEING, TOY, record

from bricksrl.data import About, Recorder, load, share
from bricksrl.data.formats import _minari_environment, _policy_of, _task_of, export_minari
from bricksrl.data.lerobot import read_lerobot
from bricksrl.envs import get_task
from bricksrl.errors import DataError


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
