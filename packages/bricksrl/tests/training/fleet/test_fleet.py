"""Fleets: processes that leave and return, one dataset, separate rows."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from tensordict import TensorDict

from bricksrl.agents.replay.buffer import TransitionReplayBuffer
from bricksrl.agents.replay.memory_state import memory_state
from bricksrl.agents.sac import SACSettings
from bricksrl.data import load
from bricksrl.data.dataset import read_dataset
from bricksrl.errors import HubError, RunError
from bricksrl.training import (
    Callback,
    Episode,
    Progress,
    RobotState,
    RunFolder,
    TrainConfig,
    resume,
    train,
)
from bricksrl.training.checkpoint import load_checkpoint, save_checkpoint
from bricksrl.training.fleet import fleet_robots as robots
from bricksrl.training.fleet.fleet_robots import make_fleet
from bricksrl.training.learners import attach_dataset, make_learner_for

pytestmark = [pytest.mark.realtime, pytest.mark.usefixtures("forked_children")]

SMALL = SACSettings(
    hidden=(16,), batch_size=16, prefill_episodes=1, n_step=3, updates_per_step=0.25
)


def config(run_dir: Path, **changes: Any) -> TrainConfig:
    return TrainConfig(
        "RunAway-v0",
        **{"episodes": 5, "robots": 2, "settings": SMALL, "run_dir": run_dir, **changes},
    )


class Harm(Callback):
    """Cuts the first robot's link after three episodes, kills the second one's process after
    four."""

    def __init__(self) -> None:
        self.states: list[tuple[str, RobotState]] = []
        self.fleet: Any = None

    def on_env(self, env: Any) -> None:
        self.fleet = env

    def on_robot(self, robot: str, state: RobotState, reason: str) -> None:
        self.states.append((robot, state))

    def on_episode(self, episode: Episode, progress: Progress) -> None:
        if episode.episode == 3:
            self.fleet.tell(self.fleet.members[0], "cut", 2.0)
        if episode.episode == 4:
            process = self.fleet.members[1].process
            if process is not None:
                process._process.kill()


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Harm]:
    path, harm = tmp_path_factory.mktemp("fleet") / "run", Harm()
    result = train(config(path, episodes=7), harm)
    assert not result.interrupted and len(result.episodes) == 7
    return path, harm


def test_failed_robot_returns(run: tuple[Path, Harm]) -> None:
    _, harm = run
    for robot in ("virtual-1", "virtual-2"):
        states = [state for name, state in harm.states if name == robot]
        assert RobotState.LEFT in states, f"{robot} never left"
        assert RobotState.ACTING in states[: states.index(RobotState.LEFT)], (
            f"{robot} was never there"
        )
    first = [state for name, state in harm.states if name == "virtual-1"]
    assert RobotState.ACTING in first[first.index(RobotState.LEFT) :], "its link came back"


def test_dataset_has_all_frames_and_robot_names(run: tuple[Path, Harm]) -> None:
    path, _ = run
    rows = read_dataset(path / "data").rows
    with (path / "metrics.csv").open() as file:
        metrics = list(csv.DictReader(file))
    assert {row.about.robot for row in rows} == {"virtual-1", "virtual-2"}
    ended = rows[: len(metrics)]  # after these come those that the end of the run broke off
    assert [(row.about.robot, row.length) for row in ended] == [
        (one["robot"], int(one["length"])) for one in metrics
    ]
    assert [row.about.whole for row in ended] == [one["link_lost"] == "0" for one in metrics]
    assert len({row.about.seed for row in rows}) == len(rows), "each episode has a start of its own"

    memory = load_checkpoint(path / "checkpoint.bin")["agent"]["memory"]["rows"]
    data = load(path / "data")
    recorded = set(
        map(_key, zip(data.observation, data.action, data.next_observation, strict=True))
    )
    held = zip(memory["observation"], memory["action"], memory["next.observation"], strict=True)
    assert not [key for key in map(_key, held) if key not in recorded]


def _key(parts: tuple[torch.Tensor, ...]) -> tuple[float, ...]:
    return tuple(torch.cat(parts).tolist())


def check_successors(path: Path) -> None:
    """Assert that the stored transitions are linked within an episode of one robot."""
    memory = load_checkpoint(path / "checkpoint.bin")["agent"]["memory"]
    rows, successor = memory["rows"], memory["successor"]
    linked = [
        (place, int(after)) for place, after in enumerate(successor) if after < SMALL.buffer_size
    ]
    assert len(linked) >= len(successor) // 2
    for place, after in linked:
        assert torch.equal(rows["next.observation"][place], rows["observation"][after])


def test_successors_stay_within_robot_and_episode(run: tuple[Path, Harm]) -> None:
    check_successors(run[0])


def test_fleet_resumes_and_stops_without_robots(run: tuple[Path, Harm]) -> None:
    path, _ = run
    folder = RunFolder(path)
    folder.write_config(replace(folder.read_config(), patience_s=0.5))
    state = load_checkpoint(folder.checkpoint_path)
    unlinked = state["agent"]["memory"]["successor"] >= SMALL.buffer_size
    # as if the first robot's episode had been running
    state["agent"]["memory"]["last"] = unlinked.nonzero()[-1]
    save_checkpoint(folder.checkpoint_path, state)

    class Cut(Callback):
        def on_env(self, env: Any) -> None:
            self.fleet = env

        def on_episode(self, episode: Episode, progress: Progress) -> None:
            for member in self.fleet.members:
                self.fleet.tell(member, "cut", 1e6)

    with pytest.raises(HubError, match="no robot of the fleet can be reached"):
        resume(path, Cut(), episodes=20)
    numbers = [episode.episode for episode in folder.read_episodes()]
    assert numbers == list(range(1, len(numbers) + 1)) and len(numbers) > 7
    check_successors(path)


DRAWN = """
from torchrl.envs import Compose, ObservationNorm, RenameTransform, RewardScaling, TransformedEnv

def transform(env):
    statistics = ObservationNorm(in_keys=["observation"], standard_normal=True)
    env = TransformedEnv(env, Compose(statistics, RewardScaling(0.0, 0.1), RenameTransform(["observation"], ["seen"])))
    statistics.init_stats(8)
    return env
"""  # noqa: E501


def test_statistics_are_drawn_once_for_all_robots(tmp_path: Path) -> None:
    file, run = tmp_path / "drawn.py", str(tmp_path / "run")
    file.write_text(DRAWN)
    train(config(tmp_path / "run", episodes=3, transform=str(file)))
    state = load_checkpoint(tmp_path / "run" / "checkpoint.bin")
    loc, scale = (
        next(value for name, value in state["transforms"].items() if name.endswith(end))
        for end in (".loc", ".scale")
    )
    rows, recorded = state["agent"]["memory"]["rows"], load(tmp_path / "run")
    assert {row.about.robot for row in read_dataset(tmp_path / "run" / "data").rows} == {
        "virtual-1",
        "virtual-2",
    }
    distances = torch.cdist(
        rows["seen"] * scale + loc,
        recorded.observation,
        compute_mode="donot_use_mm_for_euclid_dist",
    )
    assert float(distances.min(1).values.max()) < 0.01, (
        "both see with the statistics of the checkpoint"
    )
    other = config(tmp_path / "other", seed=9, transform=str(file), demonstrations=run)
    fleet = make_fleet(other)
    frames = attach_dataset(other, make_learner_for(other, fleet), fleet)
    assert frames is not None
    torch.testing.assert_close(
        frames["seen"] * scale + loc,
        recorded.observation,
        msg="and so does whom the first run teaches",
    )


def test_rows_of_different_robots_are_not_linked() -> None:
    buffer = TransitionReplayBuffer(8, 2, ("observation",), n_step=2)

    def frame(value: float, done: bool = False) -> TensorDict:
        return TensorDict(
            {
                "observation": torch.tensor([[value]]),
                "action": torch.zeros(1, 1),
                "next": {
                    "observation": torch.tensor([[value + 1]]),
                    "reward": torch.zeros(1, 1),
                    "terminated": torch.tensor([[done]]),
                    "done": torch.tensor([[done]]),
                },
            },
            [1],
        )

    for value in range(3):
        buffer.extend(frame(value), robot=1)
        buffer.extend(frame(10 + value, done=value == 2), robot=2)
    assert memory_state(buffer)["successor"].tolist() == [2, 3, 4, 5, 8, 8]
    buffer.end_episodes(1)
    for value in range(5):  # the ring comes round: places 0 to 2 are written over
        buffer.extend(frame(20 + value), robot=3)
    buffer.extend(frame(3), robot=1)
    assert memory_state(buffer)["successor"].tolist() == [1, 2, 8, 8, 8, 8, 7, 0]


def test_episode_cut_by_a_pause_is_recorded_as_such(tmp_path: Path) -> None:
    path, paused = tmp_path / "run", []

    class Pause(Callback):
        def on_env(self, env: Any) -> None:
            self.fleet = env

        def on_step(self, episode: int, step: int, phase: Any) -> None:
            if step == 3 and not paused:
                paused.append(True)
                self.fleet.pause()

        def on_episode(self, episode: Episode, progress: Progress) -> None:
            self.fleet.resume()

    train(config(path, episodes=2, robots=2), Pause())
    cut = [row for row in read_dataset(path / "data").rows if not row.about.whole]
    assert cut and all(row.about.success is None for row in cut)


def test_robot_whose_process_dies_again_and_again_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robots, "_RESTART_S", 0.0)

    class Kill(Callback):
        def __init__(self) -> None:
            self.told: list[tuple[RobotState, str]] = []
            self.pids: set[int] = set()

        def on_env(self, env: Any) -> None:
            self.fleet = env

        def on_robot(self, robot: str, state: RobotState, reason: str) -> None:
            if robot == "virtual-2":
                self.told.append((state, reason))

        def on_step(self, episode: int, step: int, phase: Any) -> None:
            process = self.fleet.members[1].process
            if process is not None and process.pid not in self.pids:
                self.pids.add(process.pid)
                process._process.kill()

    kill = Kill()
    result = train(config(tmp_path / "run", episodes=20), kill)
    assert len(result.episodes) == 20 and len(kill.pids) == 5
    assert {episode.robot for episode in result.episodes[5:]} == {"virtual-1"}
    reason = (
        "its process ended 5 times in a row without a complete episode, the last time with code -9"
    )
    assert kill.told[-1] == (RobotState.GIVEN_UP, reason)


def test_run_ends_if_the_processes_of_all_robots_die_again_and_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also if each dies in the middle of an episode, whose steps are kept."""
    monkeypatch.setattr(robots, "_RESTART_S", 0.0)
    monkeypatch.setattr(robots, "_MAX_DEATHS", 2)
    lines = (
        "import os",
        "from dataclasses import replace",
        "from bricksrl.envs.tasks.run_away import RUN_AWAY",
        (
            "TASK = replace(RUN_AWAY, id='Dying-v0', reward=lambda *state: steps() and "
            "RUN_AWAY.reward(*state))"
        ),
        "left = list(range(5))",
        "def steps():",
        "    return left.pop() or os.abort()",
    )
    (tmp_path / "dying.py").write_text("\n".join(lines))
    run = replace(config(tmp_path / "run"), env=f"{tmp_path / 'dying.py'}:TASK", episodes=20)
    with pytest.raises(RunError) as caught:
        train(run)
    reason = (
        "its process ended 2 times in a row without a complete episode, the last time with code -6"
    )
    assert re.fullmatch(
        f"no robot of the fleet is left; the last one, virtual-[12], was given up: {reason}; "
        "correct it and resume the run",
        str(caught.value),
    )
    assert 2 <= len(RunFolder(tmp_path / "run").read_episodes()) <= 4


def test_error_of_a_users_task_ends_the_run(tmp_path: Path) -> None:
    lines = (
        "from dataclasses import replace",
        "from bricksrl.envs.tasks.run_away import RUN_AWAY",
        "",
    )
    task = "TASK = replace(RUN_AWAY, id='Bad-v0', reward=lambda *_: {}['speed'])\n"
    (tmp_path / "bad.py").write_text("\n".join(lines) + task)
    with pytest.raises(
        RunError, match=r"^virtual-[12] failed \(KeyError: 'speed', bad.py, line 3\); correct it"
    ):
        train(replace(config(tmp_path / "run"), env=f"{tmp_path / 'bad.py'}:TASK", patience_s=0.0))
