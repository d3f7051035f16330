"""``bricksrl data``: what can be shared is told by its files, before anything is loaded."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from brickhub.options import check_existing
from bricksrl.cli.data import Pull, Push
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


@pytest.mark.parametrize(
    ("kind", "options"),
    [("push_dataset", {}), ("push_policy", {"policy": True}), ("push_log", {})],
)
def test_what_is_shared_is_pushed_as_it_was_asked_for(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    kind: str,
    options: dict[str, bool],
) -> None:
    shared = make(tmp_path / "log.jsonl") if kind == "push_log" else tmp_path
    pushed: list[tuple[Any, ...]] = []

    def push(folder: Path, repo: str, *, private: bool, licence: str) -> str:
        pushed.append((folder, repo, private, licence))
        return "https://hub/me/mine"

    def other(*_: object, **__: object) -> str:
        raise AssertionError("that is something else")

    monkeypatch.setattr("bricksrl.cli.data.load_learning", lambda: None)
    for module, name in (
        ("data.share", "push_dataset"),
        ("data.share", "push_log"),
        ("policies.sharing", "push_policy"),
    ):
        monkeypatch.setattr(f"bricksrl.{module}.{name}", push if name == kind else other)
    Push(shared, "me/mine", **options).execute()
    Push(shared, "me/mine", private=True, licence="cc-by-4.0", **options).execute()
    assert pushed == [
        (shared, "me/mine", False, "mit"),
        (shared, "me/mine", True, "cc-by-4.0"),
    ]
    assert capsys.readouterr().out == "https://hub/me/mine\n" * 2


@pytest.mark.parametrize(("policy", "kind"), [(False, "dataset"), (True, "policy")])
def test_what_is_pulled_is_what_was_asked_for(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    policy: bool,
    kind: str,
) -> None:
    def puller(name: str) -> Callable[..., Path]:
        return lambda repo, out, *, revision: out / name / repo / str(revision)

    monkeypatch.setattr("bricksrl.data.share.pull_dataset", puller("dataset"))
    monkeypatch.setattr("bricksrl.policies.sharing.pull_policy", puller("policy"))
    Pull("me/mine", tmp_path, policy=policy).execute()
    Pull("me/mine", tmp_path, policy=policy, revision="v2").execute()
    place = tmp_path / kind / "me/mine"
    assert capsys.readouterr().out.splitlines() == [f"{place / 'None'}", f"{place / 'v2'}"]
