"""Runs with manipulated files, digests included: one error, no execution, no writing."""

from __future__ import annotations

import copy
import hashlib
import io
import json
import pickle
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from toys import Cart

from bricksrl.agents import preset
from bricksrl.errors import BricksError, CheckpointError, RunError
from bricksrl.training import TrainConfig, load_learner, resume, train
from bricksrl.training.checkpoint import MAGIC, load_checkpoint, save_checkpoint

WRONG = (
    None,
    True,
    -1,
    0,
    10**30,
    1.5,
    float("nan"),
    "",
    "x",
    "../../x",
    "\0",
    [],
    [1],
    {},
    {"a": 1},
    [[[]]],
)
TENSORS = (torch.zeros(3), torch.zeros(2, 2, dtype=torch.int8), torch.zeros(()))
EXPLODED = Path(__file__).with_name("exploded")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two episodes of four, the second with learning."""
    folder = tmp_path_factory.mktemp("run") / "run"
    small = replace(
        preset("default", "sac"), hidden=(8,), batch_size=4, prefill_episodes=1, n_step=2
    )
    train(TrainConfig("Cart", episodes=2, settings=small, run_dir=folder, record=False), env=Cart())
    return folder


@pytest.fixture
def changed(run: Path, tmp_path: Path) -> Path:
    shutil.copytree(run, tmp_path / "run", dirs_exist_ok=True)
    return tmp_path / "run"


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """All paths in nested dictionaries and lists."""
    yield path
    inside = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    for key, part in inside:
        yield from places(part, (*path, key))


def exchanged(value: Any, path: tuple[Any, ...], new: Any) -> Any:
    if not path:
        return new
    copied = copy.deepcopy(value)
    inside = copied
    for key in path[:-1]:
        inside = inside[key]
    inside[path[-1]] = new
    return copied


def contents(root: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in root.iterdir()}


def is_refused_or_sound(folder: Path, error: type[BricksError]) -> None:
    before = contents(folder)
    refused = None
    try:
        load_learner(folder, Cart())
    except error as caught:
        refused = str(caught)
    if refused is not None:
        assert "\n" not in refused
        with pytest.raises(BricksError):
            resume(folder, env=Cart())
    assert contents(folder) == before


@settings(
    max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)
@given(data=st.data())
def test_config_with_wrong_values_raises(changed: Path, run: Path, data: st.DataObject) -> None:
    said = json.loads((run / "config.json").read_text())
    path, new = data.draw(st.sampled_from(list(places(said)))), data.draw(st.sampled_from(WRONG))
    (changed / "config.json").write_text(json.dumps(exchanged(said, path, new)))
    is_refused_or_sound(changed, BricksError)


@settings(
    max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)
@given(data=st.data())
def test_checkpoint_with_wrong_values_raises(changed: Path, run: Path, data: st.DataObject) -> None:
    state = load_checkpoint(run / "checkpoint.bin")
    path, new = (
        data.draw(st.sampled_from(list(places(state)))),
        data.draw(st.sampled_from((*WRONG, *TENSORS))),
    )
    if path:
        save_checkpoint(changed / "checkpoint.bin", exchanged(state, path, new))
        is_refused_or_sound(changed, CheckpointError)


@pytest.mark.parametrize(
    ("path", "new"),
    [
        (("identity", "settings", "num_qs"), torch.zeros(2, 2)),
        (("agent",), torch.zeros(2, 2)),
        (("agent",), None),
        (("agent", "policy"), 3),
        (("agent", "optimizer"), []),
        (("agent", "optimizer", "state", 0, "step"), "x"),
        (("agent", "updates"), "x"),
        (("agent", "loss"), None),
        (("agent", "due"), "x"),
        (("best",), "x"),
        (("episodes",), None),
        (("episodes",), "x"),
        (("episodes", 0, "seconds"), "x"),
        (("episodes", 0, "phase"), "x"),
        (("episodes", 0, "losses"), {"loss_actor": None}),
        (("generator",), torch.zeros(3)),
        (("generator",), None),
        (("pace",), {"asked": "x"}),
        (("pace",), [1]),
    ],
)
def test_incomplete_checkpoint_raises(
    changed: Path, run: Path, path: tuple[Any, ...], new: Any
) -> None:
    state = load_checkpoint(run / "checkpoint.bin")
    save_checkpoint(changed / "checkpoint.bin", exchanged(state, path, new))
    with pytest.raises(CheckpointError):
        load_learner(changed, Cart())
    is_refused_or_sound(changed, CheckpointError)


@pytest.mark.parametrize(
    ("path", "new"),
    [
        (("agent", "memory"), []),
        (("agent", "memory", "rows"), torch.zeros(())),
        (("agent", "memory", "rows"), "x"),
        (("agent", "memory", "rows", "next.reward"), []),
        (("agent", "memory", "rows", "observation"), torch.zeros(3, 1)),
        (("agent", "memory", "successor"), []),
        (("agent", "memory", "successor"), torch.full((16,), 10**9)),
        (("agent", "memory", "last"), torch.tensor([-2])),
        (("agent", "memory", "writer"), None),
        (("agent", "memory", "writer", "_cursor"), []),
        (("agent", "memory", "writer", "_cursor"), -1),
        (("agent", "memory", "writer", "_cursor"), 10**30),
        (("agent", "memory", "rows", "observation"), torch.zeros(14, 3)),
        (("collected",), "x"),
        (("collected",), [3]),
    ],
)
def test_invalid_buffer_state_raises(
    changed: Path, run: Path, path: tuple[Any, ...], new: Any
) -> None:
    state = load_checkpoint(run / "checkpoint.bin")
    save_checkpoint(changed / "checkpoint.bin", exchanged(state, path, new))
    before = contents(changed)
    with pytest.raises(CheckpointError) as caught:
        resume(changed, episodes=3, env=Cart())
    assert "\n" not in str(caught.value)
    assert contents(changed) == before


@pytest.mark.parametrize(
    "settings",
    [
        {"batch_size": 10**30},
        {"hidden": [10**9, 10**9]},
        {"buffer_size": 10**15},
        {"learning_rate": float("inf")},
        {"tau": None},
    ],
)
def test_huge_settings_raise(changed: Path, run: Path, settings: dict[str, Any]) -> None:
    said = json.loads((run / "config.json").read_text())
    said["config"]["settings"].update(settings)
    (changed / "config.json").write_text(json.dumps(said))
    with pytest.raises(RunError, match=f"{next(iter(settings))}'? is") as caught:
        load_learner(changed, Cart())
    assert "\n" not in str(caught.value)


def test_agent_out_of_memory_raises(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def make(*_: Any) -> None:
        torch.empty(2**60)

    monkeypatch.setattr("bricksrl.training.learners.make_learner", make)
    with pytest.raises(RunError, match="not enough memory for the agent sac"):
        load_learner(run, Cart())


class Bomb:
    def __reduce__(self) -> tuple[Any, ...]:
        return (Path.touch, (EXPLODED,))


def in_a_file_of_torch() -> bytes:
    file = io.BytesIO()
    torch.save({"identity": Bomb()}, file)
    return file.getvalue()


@pytest.mark.parametrize(
    "payload",
    [
        pickle.dumps(Bomb()),
        pickle.dumps(Bomb(), 2),
        in_a_file_of_torch(),
        b"",
        b"PK\3\4" + b"\0" * 99,
    ],
)
def test_pickle_with_valid_digest_raises(changed: Path, payload: bytes) -> None:
    (changed / "checkpoint.bin").write_bytes(MAGIC + hashlib.sha256(payload).digest() + payload)
    with pytest.raises(CheckpointError):
        load_learner(changed, Cart())
    is_refused_or_sound(changed, CheckpointError)
    assert not EXPLODED.exists()
