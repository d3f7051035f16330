"""``bricksrl data``: what can be shared is told by its files, before anything is loaded."""

from __future__ import annotations

from pathlib import Path

import pytest

from brickhub.options import check_existing
from bricksrl.cli.data import Push
from bricksrl.data.schema import FILES
from bricksrl.errors import DataError
from bricksrl.training.existing_run import CONFIG, POLICY


def make(path: Path) -> Path:
    """An empty file, with the folders above it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    return path


def test_datasets_runs_policies_and_logs_can_be_shared(tmp_path: Path) -> None:
    make(tmp_path / "set" / FILES["info"])
    make(tmp_path / "run" / CONFIG)
    make(tmp_path / "policy" / POLICY)
    log = make(tmp_path / "log.jsonl")
    for shared in (tmp_path / "set", tmp_path / "run", tmp_path / "policy", log):
        check_existing(Push(shared, "me/mine"))


@pytest.mark.parametrize("name", ["empty", "missing"])
def test_other_folders_cannot(tmp_path: Path, name: str) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError, match=name):
        check_existing(Push(tmp_path / name, "me/mine"))
