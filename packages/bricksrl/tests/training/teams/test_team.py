"""Teams: MAPPO, IPPO and independent SAC."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import pytest
import torch
from tensordict import TensorDict

from bricksrl.envs.arenas import make_arena
from bricksrl.envs.arenas.arena_task import ArenaState
from bricksrl.envs.arenas.carry import CARRY
from bricksrl.errors import CheckpointError, DescriptionError, RunError
from bricksrl.training.teams.groups import SACGroup, TeamAgent, TeamSettings, alternating
from bricksrl.training.teams.team import (
    TeamConfig,
    TeamProgress,
    _learn,
    _new_team,
    load_team,
    play_team,
    train_team,
)

SMALL = TeamSettings(hidden=(16,), steps=8, passes=2, updates_per_step=0.5)


@pytest.mark.parametrize("agent", get_args(TeamAgent))
def test_team_training_is_reproducible_and_saved(tmp_path: Path, agent: str) -> None:
    config = TeamConfig("Tag-v0", {"catcher": agent, "runner": agent}, frames=256, copies=8, seed=4)
    told: list[TeamProgress] = []
    team, again = train_team(config, SMALL, told.append), train_team(config, SMALL)
    assert told[-1].frames == 256
    for group in ("catcher", "runner"):
        one, other = (found.learners[group].policy.state_dict() for found in (team, again))
        assert all(torch.equal(one[name], other[name]) for name in one)
    team.save(f"{tmp_path}/team.bin")
    loaded = load_team(f"{tmp_path}/team.bin")
    state = make_arena("Tag-v0", seed=1, batch_size=4).reset()
    assert torch.equal(
        *(found.policy(state.clone())["catcher", "observation"] for found in (team, loaded))
    )


@pytest.mark.parametrize(("agent", "by_default"), [("ippo", 4096), ("mappo", 4096), ("sac", 256)])
def test_batches_have_the_size_of_the_settings(agent: str, by_default: int) -> None:
    config = TeamConfig("Tag-v0", {"catcher": agent}, {"runner": "random"}, frames=5120, copies=640)
    for settings, size in ((SMALL, by_default), (replace(SMALL, batch_size=64), 64)):
        env, sizes = make_arena("Tag-v0", seed=0, batch_size=640), []
        team = _new_team(env, config, settings)
        learner = team.learners["catcher"]
        loss = learner._learner.loss if isinstance(learner, SACGroup) else learner.loss
        loss.register_forward_pre_hook(lambda _, batch, sizes=sizes: sizes.append(len(batch[0])))
        _learn(env, team, lambda _: None, threading.Event())
        assert max(sizes) == sizes[0] == size


@pytest.mark.parametrize("agent", ["mappo", "sac"])
def test_team_learns_in_arena(agent: str) -> None:
    team = train_team(TeamConfig("Carry-v0", {"agents": agent}, frames=16, copies=0), SMALL)
    played = play_team(make_arena("Carry-v0"), team.policy, 1, seed=3)
    assert played[0].length >= 1 and set(played[0].returns) == {"agents"}


@pytest.mark.parametrize("agent", ["mappo", "sac"])
def test_team_that_tells_numbers_learns_and_is_loaded(tmp_path: Path, agent: str) -> None:
    config = TeamConfig("Guide-v0", {"agents": agent}, frames=16, copies=4, deaf=True)
    train_team(config, SMALL).save(tmp_path / "team.bin")
    team = load_team(tmp_path / "team.bin")
    assert team.config == config
    state = make_arena("Guide-v0", seed=1, batch_size=2).reset()
    assert team.policy(state)["agents", "action"].shape == (2, 2, 4)


def test_deaf_team_learns_with_the_air_taken_away() -> None:
    teams = []
    for deaf in (False, True):
        config = TeamConfig("Guide-v0", {"agents": "mappo"}, frames=64, copies=4, deaf=deaf)
        teams.append(train_team(config, SMALL).learners["agents"].policy.state_dict())
    assert any(not torch.equal(teams[0][name], teams[1][name]) for name in teams[0])


def test_failure_that_ends_an_episode_is_no_success(monkeypatch: pytest.MonkeyPatch) -> None:
    def turned(state: ArenaState) -> torch.Tensor:
        return state.poses[..., 0, 2:].abs() < 9.0

    told: list[TeamProgress] = []
    failing = replace(CARRY, terminated=turned)  # as when the beam turns too far
    monkeypatch.setattr("bricksrl.envs.arenas.carry.CARRY", failing)
    train_team(TeamConfig("Carry-v0", {"agents": "ippo"}, frames=8, copies=0), SMALL, told.append)
    assert (told[-1].episodes, told[-1].success) == (8, 0.0)


def test_catcher_learns_to_catch() -> None:
    settings = TeamSettings(hidden=(32,), steps=32, passes=6, learning_rate=2e-3)
    told: list[TeamProgress] = []
    train_team(
        TeamConfig("Tag-v0", {"catcher": "ippo"}, {"runner": "random"}, frames=80_000, copies=128),
        settings,
        told.append,
    )
    assert told[-1].success > 0.8 > 0.5 > told[2].success, (
        "by then all episodes of the start have ended"
    )


def test_copies_alternate_scripts() -> None:
    act = alternating([lambda seen: seen[..., :2] * 0.0, lambda seen: seen[..., :2] * 0.0 + 1.0])
    assert act(torch.zeros(5, 1, 10))[:, 0, 0].tolist() == [0.0, 1.0, 0.0, 1.0, 0.0]
    assert act(torch.zeros(1, 10)).tolist() == [[0.0, 0.0]], "one environment has no copies"
    train_team(
        TeamConfig("Tag-v0", {"catcher": "ippo"}, {"runner": "flee,random"}, frames=64, copies=8),
        SMALL,
    )
    with pytest.raises(DescriptionError, match="no script 'hide'"):
        train_team(
            TeamConfig("Tag-v0", {"catcher": "ippo"}, {"runner": "flee,hide"}, frames=8, copies=1),
            SMALL,
        )


def test_invalid_team_raises(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match="batch_size is 0; give 1 or more"):
        TeamSettings(batch_size=0)
    with pytest.raises(RunError, match="a learning group"):
        TeamConfig("Tag-v0", {})
    with pytest.raises(DescriptionError, match="no script 'hide'"):
        train_team(
            TeamConfig("Tag-v0", {"catcher": "ippo"}, {"runner": "hide"}, frames=8, copies=1), SMALL
        )
    with pytest.raises(DescriptionError, match="no group 'cat'"):
        train_team(TeamConfig("Tag-v0", {"cat": "ippo"}, frames=8, copies=1), SMALL)
    with pytest.raises(DescriptionError, match="agent is 'dqn'; choose mappo, ippo or sac"):
        train_team(
            TeamConfig("Tag-v0", {"catcher": "dqn"}, {"runner": "flee"}, frames=8, copies=1), SMALL
        )
    (tmp_path / "team.bin").write_bytes(b"nothing")
    with pytest.raises(CheckpointError):
        load_team(tmp_path / "team.bin")


def test_each_robot_of_a_group_is_a_copy_of_its_own() -> None:
    """In the order of time, with the arena's ends for each of them."""
    group: Any = SACGroup.__new__(SACGroup)
    group._group, group._robots = "agents", 2
    copies, time = 3, 4
    batch = [copies, time]
    numbers = torch.arange(copies * time * 2.0).view(copies, time, 2, 1)
    done = torch.zeros(copies, time, 1, dtype=torch.bool)
    done[1, 3] = True
    after = {
        "agents": {"observation": numbers + 0.5, "reward": -numbers},
        "terminated": done,
        "done": done,
        "link_lost": ~done,
    }
    frames = TensorDict(
        {"agents": {"observation": numbers, "action": numbers * 2}, "next": after}, batch
    )
    rows = group._as_copies(frames)
    assert rows.batch_size == torch.Size([6, 4])
    for copy in range(copies):
        for robot in range(2):
            one = rows[2 * copy + robot]
            assert torch.equal(one["observation"], numbers[copy, :, robot])
            assert torch.equal(one["action"], 2 * numbers[copy, :, robot])
            assert torch.equal(one["next", "reward"], -numbers[copy, :, robot])
            assert torch.equal(one["next", "done"], done[copy])
            assert torch.equal(one["next", "link_lost"], ~done[copy])
