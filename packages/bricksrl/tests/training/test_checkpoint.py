from __future__ import annotations

import contextlib
import hashlib
import pickle
from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from brickhub import files
from bricksrl.errors import CheckpointError
from bricksrl.training.checkpoint import MAGIC, load_checkpoint, save_checkpoint

STATE: dict[str, Any] = {
    "numbers": [1, 2.5, "three", None, True],
    "tensor": torch.arange(6.0).view(2, 3),
}


def test_checkpoint_round_trip(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint.bin"
    save_checkpoint(path, STATE)
    state = load_checkpoint(path)
    assert state["numbers"] == STATE["numbers"]
    assert torch.equal(state["tensor"], STATE["tensor"])
    assert [entry.name for entry in tmp_path.iterdir()] == ["checkpoint.bin"]


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
@given(st.data())
def test_damaged_checkpoint_raises(tmp_path: Path, data: st.DataObject) -> None:
    path = tmp_path / "checkpoint.bin"
    save_checkpoint(path, STATE)
    content = bytearray(path.read_bytes())
    if data.draw(st.booleans()):
        content[data.draw(st.integers(0, len(content) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    else:
        content = content[: data.draw(st.integers(0, len(content) - 1))]
    path.write_bytes(content)
    with pytest.raises(CheckpointError) as caught:
        load_checkpoint(path)
    assert "\n" not in str(caught.value)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
@given(st.data())
def test_strangers_checkpoint_with_a_right_digest_raises_or_loads(
    tmp_path: Path, data: st.DataObject
) -> None:
    path = tmp_path / "checkpoint.bin"
    save_checkpoint(path, STATE)
    payload = bytearray(path.read_bytes().removeprefix(MAGIC)[32:])
    for _ in range(data.draw(st.integers(1, 8))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(MAGIC + hashlib.sha256(payload).digest() + payload)
    with contextlib.suppress(CheckpointError):
        assert isinstance(load_checkpoint(path), dict)


def test_missing_file_or_folder_raises(tmp_path: Path) -> None:
    for path in (tmp_path / "none.bin", tmp_path):
        with pytest.raises(CheckpointError, match="cannot read"):
            load_checkpoint(path)


class Evil:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return (Path.touch, (self.path,))


def test_nothing_in_a_checkpoint_is_executed(tmp_path: Path) -> None:
    path, trace = tmp_path / "checkpoint.bin", tmp_path / "trace"
    for payload in (pickle.dumps(Evil(trace), protocol=2), b"", b"junk"):
        path.write_bytes(MAGIC + hashlib.sha256(payload).digest() + payload)
        with pytest.raises(CheckpointError, match="no training state"):
            load_checkpoint(path)
    save_checkpoint(path, {"evil": Evil(trace)})
    with pytest.raises(CheckpointError, match="no training state"):
        load_checkpoint(path)
    assert not trace.exists()


def test_failed_write_keeps_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "checkpoint.bin"
    save_checkpoint(path, STATE)

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files.os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        save_checkpoint(path, {"new": 1})
    assert "tensor" in load_checkpoint(path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["checkpoint.bin"]
