"""The card of a shared policy, to the letter, and what goes to the hub."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bricksrl.errors import CheckpointError, RunError
from bricksrl.policies import config_of, load_policy, sharing
from bricksrl.policies.sharing import ABOUT, CARD, TENSORS, is_policy, push_policy
from bricksrl.training import RunFolder, TrainConfig


@pytest.mark.parametrize(
    ("evaluation", "result"),
    [
        (None, "It has not been evaluated yet."),
        (
            {"return_mean": 12.3456, "return_std": 0.5, "episodes": 1},
            "Return 12.35 ± 0.5 in 1 episode of evaluation.",
        ),
        (
            {"return_mean": -3.0, "return_std": 0.0, "episodes": 20},
            "Return -3 ± 0 in 20 episodes of evaluation.",
        ),
    ],
)
def test_card_says_what_the_policy_has_learned(
    evaluation: dict[str, Any] | None, result: str
) -> None:
    assert sharing._card("Walker-v0", "sac", 40, evaluation, "cc-by-4.0") == (
        "---\n"
        "license: cc-by-4.0\n"
        "library_name: bricksrl\n"
        "pipeline_tag: reinforcement-learning\n"
        "tags:\n"
        "- BricksRL\n"
        "- reinforcement-learning\n"
        "- robotics\n"
        "---\n"
        "\n"
        "# sac for Walker-v0\n"
        "\n"
        f'Trained with BricksRL on "Walker-v0" for 40 episodes. {result}\n'
        "\n"
        "`policy.safetensors` holds the tensors that the policy acts with, `policy.json` what they "
        "belong to.\n"
        "\n"
        "```\n"
        "bricksrl data pull <this repository> --policy --out policy\n"
        "bricksrl record Walker-v0 --policy policy --out dataset\n"
        "```\n"
    )


def test_shared_policy_has_both_of_its_files(tmp_path: Path) -> None:
    assert not is_policy(tmp_path)
    (tmp_path / ABOUT).touch()
    assert not is_policy(tmp_path)
    (tmp_path / TENSORS).touch()
    assert is_policy(tmp_path)
    (tmp_path / ABOUT).unlink()
    assert not is_policy(tmp_path)


class Hub:
    """A hub that notes what is sent to it."""

    endpoint = "https://hub"

    def __init__(self) -> None:
        self.asked: list[Any] = []

    def create_repo(self, repo: str, **named: Any) -> None:
        self.asked.append(("create", repo, named))

    def upload_folder(self, **named: Any) -> None:
        self.asked.append(("upload", named))


@pytest.mark.parametrize("is_shared", [False, True])
def test_policy_is_pushed_as_it_is_or_made_of_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_shared: bool
) -> None:
    hub = Hub()
    exported: list[Any] = []

    @contextmanager
    def hub_client(repo: str) -> Iterator[Hub]:
        assert repo == "me/walker"
        yield hub

    def export_policy(run: Path, out: Path, *, licence: str) -> Path:
        exported.append((run, licence))
        return out

    monkeypatch.setattr(sharing, "hub_client", hub_client)
    monkeypatch.setattr(sharing, "export_policy", export_policy)
    monkeypatch.setattr(sharing, "is_policy", lambda path: is_shared)
    assert push_policy(tmp_path, "me/walker", private=True, licence="mit") == (
        "https://hub/me/walker"
    )
    (create, upload) = hub.asked
    assert create == (
        "create",
        "me/walker",
        {"repo_type": "model", "private": True, "exist_ok": True},
    )
    _, named = upload
    assert (named["repo_id"], named["repo_type"]) == ("me/walker", "model")
    assert named["allow_patterns"] == [TENSORS, ABOUT, CARD], "and nothing else of the folder"
    assert (named["folder_path"] == str(tmp_path)) is is_shared
    assert exported == ([] if is_shared else [(tmp_path, "mit")])
    push_policy(tmp_path, "me/walker")
    assert hub.asked[2][2]["private"] is False


def test_policy_on_a_base_is_not_shared(tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    RunFolder(run).write_config(TrainConfig("WalkerSim-v0", base="scripted"))
    with pytest.raises(RunError) as raised:
        sharing.export_policy(run, tmp_path / "out")
    assert str(raised.value) == (
        "a shared policy comes without the run of its base; `bricksrl export RUN --out FILE` "
        "writes both to one file"
    )
    assert not (tmp_path / "out").exists()


def test_shared_policy_is_of_one_checkpoint(tmp_path: Path) -> None:
    for name in (ABOUT, TENSORS):
        (tmp_path / name).touch()
    with pytest.raises(RunError) as raised:
        load_policy(tmp_path, which="best")
    assert str(raised.value) == f"{tmp_path} holds the policy of one checkpoint; take the last one"


def test_policy_of_another_version_is_refused(tmp_path: Path) -> None:
    (tmp_path / TENSORS).touch()
    (tmp_path / ABOUT).write_text('{"config": {}, "bricksrl_policy": 2}')
    with pytest.raises(CheckpointError) as raised:
        config_of(tmp_path)
    assert str(raised.value) == (
        f"{tmp_path / ABOUT} describes no policy of this version of BricksRL; choose another"
    )
    (tmp_path / ABOUT).write_text('{"config": {"env": 3}, "bricksrl_policy": 1}')
    with pytest.raises(CheckpointError, match="is damaged|is not a valid safetensors"):
        config_of(tmp_path)


def test_policy_of_another_robot_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import torch

    loaded: list[Any] = []
    learner = SimpleNamespace(
        policy_state=lambda: {"weight": torch.zeros(2, 3)},
        policy=SimpleNamespace(load_state_dict=loaded.append),
    )
    tensors = {"weight": torch.ones(2, 3)}
    monkeypatch.setattr(sharing, "make_learner_for", lambda config, env, device: learner)
    monkeypatch.setattr(sharing, "read_policy", lambda path: (None, tensors))
    env: Any = None
    assert sharing.load_shared(tmp_path, env) is learner and loaded == [tensors]
    for other in ({"weight": torch.ones(2, 4)}, {"bias": torch.ones(2, 3)}, {}):
        tensors = other
        with pytest.raises(CheckpointError) as raised:
            sharing.load_shared(tmp_path, env)
        assert str(raised.value) == (
            f"the policy in {tmp_path} observes or acts otherwise than this environment; use the "
            "one it is for"
        )
