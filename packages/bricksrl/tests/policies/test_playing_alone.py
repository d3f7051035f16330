"""How an episode of a program that acts by itself is read, with lines made by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from brickhub.hub.program.generate import Goals
from bricksrl.envs.reference_returns import REFERENCES
from bricksrl.envs.registry import get_task
from bricksrl.envs.task import SampledEntry
from bricksrl.errors import RunError
from bricksrl.policies import hub_export
from bricksrl.policies import policy as policies
from bricksrl.policies.by_name import TRAINED, scores_to_beat
from bricksrl.policies.hub_export import Alone, goals_of, place_of, world_file
from bricksrl.policies.policy import Player, array_player, named_policies


@pytest.mark.parametrize(
    ("ends_s", "step_ms", "age_ms"),
    [
        ([0.0, 0.31, 0.62, 1.62], 250, 60),
        ([5.0, 5.3, 5.6], 250, 50),
        ([0.0, 0.2, 0.4], 250, 0),
        ([0.0, 0.31], None, 0),
        ([0.31], 250, 0),
        ([], 250, 0),
    ],
)
def test_age_is_what_a_usual_step_takes_beyond_its_time(
    ends_s: list[float], step_ms: int | None, age_ms: int
) -> None:
    assert hub_export._age_ms(ends_s, step_ms) == age_ms


def test_goals_that_are_whole_stay_whole() -> None:
    assert goals_of(get_task("RunAway-v0")) is None
    task: Any = SimpleNamespace(
        sampled_entries=(
            SampledEntry("turn", 0.0, 3.0, whole=True),
            SampledEntry("far_goal", -2.5, 7.0),
        ),
        max_steps=50,
    )
    goals = goals_of(task)
    assert goals == Goals(((0, 3), (-2.5, 7.0)), 50)
    assert [type(end) for end in goals.ranges[0]] == [int, int]
    assert [type(end) for end in goals.ranges[1]] == [float, float]


def test_place_is_reckoned_from_the_middle_of_the_starts() -> None:
    task = get_task("Park-v0")
    scene = replace(task.scene, start_mm=((-100.0, 300.0), (10.0, 20.0)), heading_deg=(-90.0, 30.0))
    place = place_of(replace(task, scene=scene))
    assert place is not None and task.target is not None
    assert place.start == (100.0, 15.0, -30.0)
    wanted = task.target.place
    assert place.place == (wanted.x_mm, wanted.y_mm, wanted.heading_deg)
    base = task.robot.drive_base
    assert base is not None
    assert place.wheels == (base.left, base.right)
    # A wheel of this circumference turns once on its way.
    assert place.deg_per_mm == pytest.approx(360.0 / (np.pi * base.wheel_diameter_mm))
    assert place.track_mm == base.axle_track_mm
    assert place_of(replace(task, target=None)) is None
    assert place_of(get_task("RunAway-v0")) is None


def test_world_lies_beside_the_program() -> None:
    assert world_file(Path("runs") / "walk.py") == Path("runs") / "walk.json"


class Rewards:
    """Rewards of a task, and what they were computed from."""

    def __init__(self) -> None:
        self.asked: list[list[list[float]]] = []

    def __call__(self, *parts: torch.Tensor) -> torch.Tensor:
        self.asked.append([part.tolist() for part in parts])
        return torch.tensor([float(len(self.asked))])


def alone(rewards: Rewards, **changes: Any) -> Alone:
    """An episode with one channel and a command of -50 to 150, sent in tenths."""
    command = SimpleNamespace(low=-50.0, high=150.0, scale=10.0)
    usual = {
        "interface": SimpleNamespace(commands=(command,)),
        "observed_channels": ("distance",),
        "sampled_entries": (),
        "measured_entries": (),
        "command_entries": (),
        "entries": ("distance",),
        "target": None,
        "max_steps": 10,
        "reward": rewards,
        "terminated": lambda observation: observation[..., :1] > 100.0,
    }
    task: Any = SimpleNamespace(**usual | changes)
    machine: Any = SimpleNamespace(body_ms=2500)
    odometer: Any = SimpleNamespace(forward_mm=lambda time_s, seen: 1000.0 * time_s + seen[0])
    heap = iter((300, 700, 500, 100))
    return Alone(task, machine, odometer, heap=lambda: next(heap))


def test_lines_of_a_program_are_steps() -> None:
    """The first line has no step before it. 700 tenths are 70, of -50 to 150 a fifth above 50."""
    rewards = Rewards()
    episode = alone(rewards)
    episode.write(b"5 1.5 70")
    assert episode.seen is None, "a line ends with its end"
    episode.write(b"0\r\n9 2.5 -500\r\n3 3.5 15")
    assert (episode.length, episode.return_) == (1, 1.0)
    episode.write(b"00\r\n")
    assert (episode.length, episode.return_) == (2, 3.0)
    assert (episode.computing_ms, episode.heap_bytes) == (9, 700), "the most of each"
    assert rewards.asked == [
        [[1.5], pytest.approx([0.2]), [2.5]],
        [[2.5], [-1.0], [3.5]],
    ]
    assert episode.seen is not None
    assert [part.tolist() for part in episode.seen] == [[3.5], [1.0]]


def test_reward_sees_the_way_and_the_last_commands_where_its_task_does() -> None:
    rewards = Rewards()
    episode = alone(rewards, measured_entries=("forward",), command_entries=("command",))
    episode.write(b"5 1.5 700\r\n5 2.5 1500\r\n")
    (before, _, after) = rewards.asked[0]
    assert before == [1.5, 2501.5, 0.0], "nothing was commanded yet"
    assert after == [2.5, 2502.5, 70.0]


def test_hub_that_reckons_a_place_tells_all_that_its_task_observes() -> None:
    rewards = Rewards()
    entries = ("distance", "x", "command")
    episode = alone(rewards, target="a place", entries=entries, command_entries=("command",))
    episode.write(b"5 1.5 8 0.5 700\r\n5 2.5 9 0.25 700\r\n")
    assert rewards.asked == [[[1.5, 8.0, 0.5], pytest.approx([0.2]), [2.5, 9.0, 0.25]]]


@pytest.mark.parametrize(
    ("lines", "length"),
    [(b"5 1 0\r\n5 2 0\r\n5 101 0\r\n", 2), (b"5 1 0\r\n" * 11, 10)],
)
def test_episode_ends_with_its_task(lines: bytes, length: int) -> None:
    episode = alone(Rewards())
    episode.heap = lambda: 0
    with pytest.raises(hub_export._Over):
        episode.write(lines)
    assert episode.length == length


def test_goals_are_told_in_turn() -> None:
    told = hub_export._told([3.0, 0.5])
    assert [told.randint(0, 9), told.uniform(0, 1), told.uniform(0, 1)] == [3, 0.5, 3.0]
    assert type(told.randint(0, 9)) is int


def test_console_of_a_program_types_nothing() -> None:
    episode = alone(Rewards())
    assert episode.available() == 0
    with pytest.raises(EOFError):
        episode.read(1)


@pytest.mark.parametrize(
    "changes",
    [
        {"images": True},
        {"sensors": True},
        {"client": True},
        {"target": "a place", "measured_entries": True},
    ],
)
def test_hub_by_itself_acts_on_what_it_can_know(
    monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any]
) -> None:
    usual = dict.fromkeys(("images", "sensors", "client", "measured_entries"), False)
    usual |= {"target": None}
    known = SimpleNamespace(task=SimpleNamespace(**usual))
    monkeypatch.setattr(hub_export, "interface_of", lambda env: env)
    assert hub_export._task_of(known) is known.task
    known.task.measured_entries = True
    assert hub_export._task_of(known) is known.task, "without a target a hub needs no measure"
    for task in (SimpleNamespace(**usual | changes), None):
        with pytest.raises(RunError) as raised:
            hub_export._task_of(SimpleNamespace(task=task))
        assert str(raised.value) == (
            "a hub by itself sees no images and nothing that this computer senses; export the "
            "policy of another task"
        )


def test_scores_to_beat_are_those_of_others_and_ours() -> None:
    env = "Walker-v1"
    ours = {"ours": float(TRAINED[env]["return"])}
    assert scores_to_beat(env) == REFERENCES[env] | ours
    assert scores_to_beat("Nobodys-v0") == {}
    assert "ours" not in REFERENCES[env], "what is known is not changed"


def test_policies_of_a_run_are_made_when_they_are_wanted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded: list[str] = []

    def load_policy(_path: Path, _env: Any, *, which: str = "last") -> Any:
        loaded.append(which)
        return SimpleNamespace(reset="forget")

    monkeypatch.setattr(policies, "load_policy", load_policy)
    monkeypatch.setattr(policies, "random_player", lambda env, seed: (env, seed))
    monkeypatch.setattr(policies, "untrained_learner", lambda path, env: SimpleNamespace(policy=7))
    monkeypatch.setattr(policies, "Policy", lambda module, env: SimpleNamespace(reset=module))
    env: Any = "the env"
    named = named_policies(tmp_path, env, 5)
    assert list(named) == ["random", "first", "last"] and loaded == []
    (tmp_path / "best.bin").touch()
    named = named_policies(tmp_path, env, 5)
    assert list(named) == ["random", "first", "best", "last"]
    assert named["random"]() == ("the env", 5)
    assert named["first"]().reset == 7
    assert [named[name]().reset for name in ("best", "last")] == ["forget"] * 2
    assert loaded == ["best", "last"]
    monkeypatch.setattr(policies, "is_policy", lambda path: True)
    assert list(named_policies(tmp_path, env, 5)) == ["random", "last"], "a shared one has no past"


def test_policy_of_arrays_plays_on_copies() -> None:
    given: list[dict[str, Any]] = []

    def act(state: dict[str, Any]) -> Any:
        given.append(state)
        state["observation"] += 100.0
        return np.array([0.25, -0.5])

    player = array_player(lambda: act)
    observation = torch.tensor([1.0, 2.0])
    state = TensorDict({"observation": observation, "other": torch.zeros(1)}, [])
    acted = player.act(state)
    assert acted["action"].tolist() == [0.25, -0.5]
    assert acted["action"].dtype is torch.float32
    assert observation.tolist() == [1.0, 2.0]
    assert list(given[0]) == ["observation"]
    state["image"] = torch.zeros(2, 2, 3, dtype=torch.uint8)
    player.act(state)
    assert list(given[1]) == ["observation", "image"]
    assert Player(player.act).reset() is None  # type: ignore[func-returns-value]
