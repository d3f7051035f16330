"""Processes that others have started, as each system lists them."""

from __future__ import annotations

import os
import signal
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from brickhub.cli import descendants

TABLE = {10: (1, "S"), 20: (10, "S"), 21: (20, "T"), 22: (10, "t"), 23: (20, "R"), 30: (1, "T")}
"""Parent and state of each process, by its number."""


@pytest.fixture
def killed(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    sent: list[tuple[int, int]] = []

    def kill(pid: int, number: int) -> None:
        sent.append((pid, number))
        if pid == 21:
            raise ProcessLookupError

    monkeypatch.setattr(os, "kill", kill)
    return sent


def rows(table: dict[int, tuple[int, str]]) -> list[tuple[int, int, str]]:
    return [(pid, parent, state) for pid, (parent, state) in table.items()]


@pytest.mark.parametrize(
    ("pid", "frozen"), [(10, [21, 22]), (20, [21]), (1, [21, 22, 30]), (21, []), (99, [])]
)
def test_only_frozen_descendants_are_killed(
    pid: int, frozen: list[int], killed: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(descendants, "_processes", lambda: rows(TABLE))
    descendants.kill_frozen(pid)
    assert killed == [(one, signal.SIGKILL) for one in frozen]


def test_numbers_that_were_given_again_make_no_endless_way(
    killed: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(descendants, "_processes", lambda: [(5, 6, "T"), (6, 5, "S")])
    descendants.kill_frozen(1)
    assert killed == []
    descendants.kill_frozen(6)
    assert killed == [(5, signal.SIGKILL)]


def test_linux_lists_processes_in_files_whatever_their_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = {
        "self": "7 (python) R 1 7",
        "7": "7 (python) R 1 7",
        "21": "21 (a (bad) name) 3) T 20 21",
    }
    for name, line in lines.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "stat").write_text(line)
    # One that has ended, and what is no process.
    (tmp_path / "33").mkdir()
    (tmp_path / "sys").mkdir()
    monkeypatch.setattr(descendants, "_PROC", tmp_path)
    assert sorted(descendants._processes()) == [(7, 1, "R"), (21, 20, "T")]


def test_a_mac_lists_processes_by_a_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def listed(command: Any, **options: Any) -> Any:
        assert options["timeout"] <= 5 and options["text"]
        return SimpleNamespace(stdout="    1     0 Ss\n   21    20 T+\n")

    monkeypatch.setattr(descendants, "_PROC", tmp_path)
    monkeypatch.setattr(subprocess, "run", listed)
    assert list(descendants._processes()) == [(1, 0, "S"), (21, 20, "T")]

    def fails(*_command: Any, **_options: Any) -> Any:
        raise subprocess.TimeoutExpired("ps", 1.0)

    monkeypatch.setattr(subprocess, "run", fails)
    assert list(descendants._processes()) == []
