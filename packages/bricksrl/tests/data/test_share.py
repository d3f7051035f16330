from __future__ import annotations

import errno
import json
import os
import socket
from pathlib import Path

import numpy as np
import pytest
import torch
from hub_server import TOKEN, Hub, serving
from toy_data import SEEING, record

import bricksrl
from brickhub.errors import TwinError
from brickhub.files import writing
from bricksrl.agents import preset
from bricksrl.cli import main
from bricksrl.data import load
from bricksrl.data.share import hub_client, pull_dataset, push_dataset, push_log
from bricksrl.errors import CheckpointError, DataError, RunError, WriteError
from bricksrl.policies import load_policy, sharing
from bricksrl.policies.sharing import export_policy, is_policy, pull_policy, push_policy
from bricksrl.training import TrainConfig, train
from bricktwin.measure.session import Row, SessionLog, write_log


@pytest.fixture
def hub(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setenv("HF_TOKEN", TOKEN)
    monkeypatch.setenv("HF_HUB_DISABLE_XET", "1")
    with serving() as server:
        monkeypatch.setenv("HF_ENDPOINT", server.address)
        yield server


def test_dataset_hub_round_trip(hub: Hub, tmp_path: Path) -> None:
    root = record(tmp_path / "set", (3, 4), SEEING)
    for folder in (root / ".idea", root / "data/.ipynb_checkpoints"):
        folder.mkdir()
        (folder / "secret.txt").write_text("mine")
    assert push_dataset(root, "me/toy", licence="cc-by-4.0") == f"{hub.address}/datasets/me/toy"
    files = hub.files["datasets/me/toy"]
    assert {
        "meta/info.json",
        "meta/bricksrl.json",
        "data/chunk-000/file-001.parquet",
        "README.md",
    } <= files.keys()
    assert not any("/." in f"/{name}" for name in files) and hub.tags == ["v3.0"]
    card = files["README.md"].decode()
    assert (
        "license: cc-by-4.0\n" in card
        and "- LeRobot" in card
        and "| transitions | 7 |" in card
        and "observation.state`: angle, distance" in card
    )
    pull_dataset("me/toy", tmp_path / "fetched")
    ours, theirs = load(root), load(tmp_path / "fetched")
    assert np.array_equal(ours.observation, theirs.observation) and np.array_equal(
        ours.image, theirs.image
    )
    with pytest.raises(DataError, match="exists already"):
        pull_dataset("me/toy", tmp_path / "fetched")


def test_damaged_download_is_discarded(hub: Hub, tmp_path: Path) -> None:
    push_dataset(record(tmp_path / "set"), "me/toy")
    name = "data/chunk-000/file-001.parquet"
    hub.files["datasets/me/toy"][name] = hub.files["datasets/me/toy"][name][::-1]
    with pytest.raises(DataError, match="me/toy is not sound"):
        pull_dataset("me/toy", tmp_path / "fetched")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["set"]


def test_refusals_print_one_line(hub: Hub, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = record(tmp_path / "set")
    with pytest.raises(DataError, match="shows no me/nothing"):
        pull_dataset("me/nothing", tmp_path / "out")
    with pytest.raises(DataError, match="not a name on the hub"):
        pull_dataset("a name/of/three", tmp_path / "out")
    monkeypatch.setenv("HF_TOKEN", "hf_unknown")
    with pytest.raises(DataError, match="hf auth login"):
        push_dataset(root, "me/toy")
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        monkeypatch.setenv("HF_ENDPOINT", f"http://127.0.0.1:{nobody.getsockname()[1]}")
        with pytest.raises(DataError, match="cannot be reached"):
            push_dataset(root, "me/toy")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("pull", [pull_dataset, pull_policy])
def test_full_disk_is_told(hub: Hub, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pull) -> None:
    hub.files["datasets/me/toy"] = hub.files["models/me/toy"] = {"README.md": b"about"}

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("huggingface_hub.file_download.http_get", full)
    with pytest.raises(
        WriteError,
        match=r"cannot write .*new/toy \(No space left on device\); make room on that disk",
    ):
        pull("me/toy", tmp_path / "new" / "toy")
    assert not (tmp_path / "new").exists()


def test_policy_hub_round_trip(hub: Hub, tmp_path: Path) -> None:
    run = tmp_path / "run"
    train(
        TrainConfig(
            "WalkerSim-v0", episodes=1, run_dir=run, settings=preset("default", "sac"), record=False
        )
    )
    push_policy(run, "me/policy", licence="apache-2.0")
    files = hub.files["models/me/policy"]
    assert b"license: apache-2.0\n" in files["README.md"]
    assert sorted(files) == ["README.md", "policy.json", "policy.safetensors"]
    assert (
        json.loads(files["policy.json"])["config"]["env"] == "WalkerSim-v0"
        and str(tmp_path) not in files["policy.json"].decode()
    )
    pull_policy("me/policy", tmp_path / "policy")
    env = bricksrl.make("WalkerSim-v0", seed=0)
    observation = env.reset()["observation"]
    actions = [
        load_policy(path, env).act(observation)
        for path in (run, tmp_path / "policy", str(tmp_path / "policy"))
    ]
    assert torch.equal(actions[0], actions[1]) and torch.equal(actions[0], actions[2])
    with pytest.raises(CheckpointError, match="observes or acts otherwise"):
        load_policy(tmp_path / "policy", bricksrl.make("RoboArmSim-v0", seed=0))
    about = json.loads(files["policy.json"])
    own_task = {**about, "config": {**about["config"], "env": "my_task.py"}}
    files["policy.json"] = json.dumps(own_task).encode()
    pull_policy("me/policy", tmp_path / "with_code")  # to be read, and then trusted
    with pytest.raises(
        RunError, match=r"would run code \(my_task.py\) .* `bricksrl trust \S*with_code`$"
    ):
        load_policy(tmp_path / "with_code")
    for content in (b"\x80\x04cos\nsystem\n.", b"", files["policy.safetensors"][:-9]):
        files["policy.safetensors"] = content
        with pytest.raises(CheckpointError, match="not a valid safetensors"):
            pull_policy("me/policy", tmp_path / "bad")
    assert not (tmp_path / "bad").exists()


@pytest.mark.parametrize("written", [0, 1, 2])
def test_policy_export_is_atomic(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, written: int
) -> None:
    """A killed process leaves no file with the policy's name; a full disk leaves no file."""
    run, out = tmp_path / "run", tmp_path / "new" / "policy"
    train(TrainConfig("WalkerSim-v0", "random", episodes=1, run_dir=run, record=False))
    write, names = sharing.write_durably, []

    def write_while_there_is_room(path: Path, data: bytes) -> None:
        assert not out.exists()
        if len(names) == written:
            with writing(path):
                raise OSError(errno.ENOSPC, "No space left on device")
        write(path, data)
        names.append(path.name)

    monkeypatch.setattr(sharing, "write_durably", write_while_there_is_room)
    with pytest.raises(
        WriteError, match=r"cannot write .*new/policy \(No space left on device\); make room"
    ):
        export_policy(run, out)
    assert len(names) == written and not out.parent.exists()
    monkeypatch.setattr(sharing, "write_durably", write)
    assert is_policy(export_policy(run, out))


def test_log_of_a_measured_robot_goes_to_the_hub(
    hub: Hub, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "log.jsonl"
    write_log(
        path, SessionLog("two-wheeler", {"hub": "ble"}, (Row("rest", 5, 90.0, {"heading": 0.1}),))
    )
    assert main(("data", "push", str(path), "me/logs", "--licence", "cc0-1.0")) == 0
    assert capsys.readouterr().out.strip() == f"{hub.address}/datasets/me/logs"
    files = hub.files["datasets/me/logs"]
    assert files["log.jsonl"] == path.read_bytes() and sorted(files) == ["README.md", "log.jsonl"]
    card = files["README.md"].decode()
    assert (
        "license: cc0-1.0\n" in card
        and "| robot | two-wheeler |" in card
        and "| hub | ble |" in card
    )
    path.write_text("secrets\n")
    with pytest.raises(TwinError, match="it is another file"):
        push_log(path, "me/logs")


@pytest.mark.parametrize(
    ("error", "is_of_network"),
    [
        (OSError("no route to host"), True),
        (ConnectionResetError(errno.ECONNRESET, "reset by peer"), True),
        (OSError(errno.ENOSPC, "no space left on device"), False),
        (FileNotFoundError(errno.ENOENT, "no such file", "data.parquet"), False),
    ],
)
def test_error_of_a_file_is_none_of_the_network(error: OSError, is_of_network: bool) -> None:
    with pytest.raises(DataError if is_of_network else OSError) as caught, hub_client("me/mine"):
        raise error
    if is_of_network:
        assert "cannot be reached" in str(caught.value) and "with a network" in str(caught.value)
    else:
        assert caught.value is error
