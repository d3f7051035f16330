"""Which checkpoints a run goes on from, and what is said of others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from toys import Cart

from bricksrl.agents import make_learner
from bricksrl.agents.sac import SACSettings
from bricksrl.errors import CheckpointError
from bricksrl.training import Episode, Phase, RunFolder, TrainConfig
from bricksrl.training.checkpoint import MAGIC, load_checkpoint, save_checkpoint
from bricksrl.training.restore import identity_of, load_state, run_state

CONFIG = TrainConfig("Cart", seed=3, settings=SACSettings(hidden=(8,), batch_size=4))
EPISODE = Episode(1, Phase.TRAIN, 8, 8, 2.0, None)


def state_of(config: TrainConfig = CONFIG) -> dict[str, Any]:
    """State of a run after an episode."""
    env = Cart()
    learner = make_learner("sac", env, config.settings)
    agent = {"agent": learner.state_dict(), "pace": {"asked": 8, "done": 8}, "collected": []}
    return agent | run_state(env, identity_of(config, env), [EPISODE])


def saved(path: Path, change: Callable[[dict[str, Any]], object] = dict) -> RunFolder:
    """Folder of a run with a changed checkpoint."""
    folder = RunFolder(path)
    state = state_of()
    change(state)
    save_checkpoint(folder.checkpoint_path, state)
    return folder


def test_identity_is_what_the_weights_depend_on() -> None:
    identity = identity_of(CONFIG, Cart())
    assert set(identity) == {"env", "agent", "seed", "settings", "layout", "action_size"}
    assert (identity["env"], identity["agent"], identity["seed"]) == ("Cart", "sac", 3)
    assert identity["settings"] == CONFIG.to_dict()["settings"]
    assert identity["action_size"] == 1
    assert "names" not in identity["layout"] and identity["layout"]["low"] == (0.0, -1.0)


def test_new_run_has_a_state_that_is_restored(tmp_path: Path) -> None:
    state = load_state(saved(tmp_path), CONFIG, Cart())
    assert state["episodes"] == [EPISODE.to_dict()]
    assert (state["best"], state["is_evaluation_due"], state["recorded"]) == (None, False, 0)
    assert state["pace"] == {"asked": 8, "done": 8}
    more = replace(CONFIG, episodes=99, device="cpu", log="none", name="Anna")
    load_state(RunFolder(tmp_path), more, Cart())


def test_missing_best_checkpoint_is_told(tmp_path: Path) -> None:
    folder = saved(tmp_path)
    with pytest.raises(CheckpointError) as raised:
        load_state(folder, CONFIG, Cart(), which="best")
    assert str(raised.value) == (
        f"the run in {tmp_path} has no best checkpoint; train with evaluations, or take the last "
        "one"
    )
    save_checkpoint(folder.best_path, state_of() | {"best": 7.5})
    assert load_state(folder, CONFIG, Cart(), which="best")["best"] == 7.5
    assert load_state(folder, CONFIG, Cart())["best"] is None


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 4},
        {"agent": "td3", "settings": None},
        {"settings": SACSettings(hidden=(8,), batch_size=5)},
        {"env": "Wagon"},
    ],
)
def test_checkpoint_of_another_config_is_refused(tmp_path: Path, change: dict[str, Any]) -> None:
    folder = saved(tmp_path)
    with pytest.raises(CheckpointError) as raised:
        load_state(folder, replace(CONFIG, **change), Cart())
    assert str(raised.value) == (
        f"{folder.checkpoint_path} belongs to another config; restore the run's own config.json"
    )


class Wide(Cart):
    """A cart on a longer line."""

    def __init__(self) -> None:
        super().__init__()
        self.observation_spec["observation"].space.high.mul_(2.0)


class Agile(Cart):
    """A cart that is commanded by two numbers."""

    def __init__(self) -> None:
        super().__init__()
        self.action_spec = self.action_spec.expand(2).clone()


@pytest.mark.parametrize("make", [Wide, Agile])
def test_other_observations_and_actions_are_refused(
    tmp_path: Path, make: Callable[[], Cart]
) -> None:
    with pytest.raises(CheckpointError) as raised:
        load_state(saved(tmp_path), CONFIG, make())
    assert str(raised.value) == (
        f"{tmp_path} learned in Cart; choose an environment with its observations and actions"
    )


def without(*names: str) -> Callable[[dict[str, Any]], object]:
    """A change that takes a part out of a state."""

    def change(state: dict[str, Any]) -> None:
        *folders, last = names
        for name in folders:
            state = state[name]
        del state[last]

    return change


def with_part(name: str, value: Any) -> Callable[[dict[str, Any]], object]:
    return lambda state: state.update({name: value})


def with_rows(rows: dict[str, Any]) -> Callable[[dict[str, Any]], object]:
    return lambda state: state["agent"].update({"memory": {"rows": rows}})


@pytest.mark.parametrize(
    "change",
    [
        without("identity"),
        without("identity", "seed"),
        without("episodes"),
        without("best"),
        without("is_evaluation_due"),
        without("recorded"),
        without("pace", "asked"),
        without("pace", "done"),
        without("collected"),
        without("generator"),
        with_part("best", "high"),
        with_part("recorded", "all"),
        with_part("episodes", [{"episode": 1}]),
        with_part("episodes", [EPISODE.to_dict() | {"length": "long"}]),
        with_part("collected", [{"next": {}}]),
        with_part("generator", torch.zeros(3, dtype=torch.uint8)),
        with_rows({"observation": torch.zeros(4, 3)}),
        with_rows({"action": torch.zeros(4, 2)}),
        with_rows({"observation": torch.zeros(4)}),
    ],
)
def test_state_that_lacks_a_part_is_refused(
    tmp_path: Path, change: Callable[[dict[str, Any]], object]
) -> None:
    folder = saved(tmp_path, change)
    with pytest.raises(CheckpointError) as raised:
        load_state(folder, CONFIG, Cart())
    assert str(raised.value) == (
        f"{folder.checkpoint_path} lacks a part of a run's state; restore a copy or train again"
    )


def test_rows_of_this_robot_are_taken(tmp_path: Path) -> None:
    rows = {"observation": torch.zeros(4, 2), "action": torch.zeros(4, 1)}
    load_state(saved(tmp_path, with_rows(rows)), CONFIG, Cart())


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (
            b"something",
            "is not a checkpoint of this version of BricksRL; choose another or train again",
        ),
        (MAGIC, "is damaged; restore a copy or train again"),
        (MAGIC + bytes(40), "is damaged; restore a copy or train again"),
    ],
)
def test_other_files_are_no_checkpoints(tmp_path: Path, data: bytes, says: str) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(data)
    with pytest.raises(CheckpointError) as raised:
        load_checkpoint(path)
    assert str(raised.value).removeprefix("the checkpoint ") == f"{path} {says}"


def test_checkpoint_without_a_state_is_refused(tmp_path: Path) -> None:
    state: Any = [1, 2]
    save_checkpoint(tmp_path / "a.bin", state)
    with pytest.raises(CheckpointError) as raised:
        load_checkpoint(tmp_path / "a.bin")
    assert str(raised.value) == (
        f"the checkpoint {tmp_path / 'a.bin'} has no training state; train again"
    )
    whole = (tmp_path / "a.bin").read_bytes()
    for place in (len(MAGIC), len(MAGIC) + 32, len(whole) - 1):
        changed = bytearray(whole)
        changed[place] ^= 1
        (tmp_path / "b.bin").write_bytes(bytes(changed))
        with pytest.raises(CheckpointError, match="is damaged; restore a copy or train again"):
            load_checkpoint(tmp_path / "b.bin")
