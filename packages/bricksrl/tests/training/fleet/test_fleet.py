"""Fleets: processes that leave and return, one dataset, separate rows."""

from __future__ import annotations

import csv
import itertools
import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch
from tensordict import TensorDict

from bricksrl.agents.replay.buffer import TransitionReplayBuffer
from bricksrl.agents.replay.memory_state import memory_state
from bricksrl.agents.sac import SACSettings
from bricksrl.data import load
from bricksrl.data.dataset import read_dataset
from bricksrl.errors import DescriptionError, HubError, RunError, UnknownNameError
from bricksrl.training import (
    Callback,
    Episode,
    Phase,
    Progress,
    RobotState,
    RunFolder,
    TrainConfig,
    resume,
    train,
)
from bricksrl.training.checkpoint import load_checkpoint, save_checkpoint
from bricksrl.training.fleet import fleet_robots as robots
from bricksrl.training.fleet.fleet_robots import Member, make_fleet, members_of
from bricksrl.training.fleet.schedule import FleetRobots
from bricksrl.training.learners import attach_dataset, make_learner_for
from bricksrl.training.loop import Loop
from bricksrl.training.sources import Ended, Playing

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


class Stub:
    """A fleet without processes that logs calls."""

    def __init__(self, robots: int) -> None:
        self.members = [Member(f"r{place}", place, "virtual") for place in range(robots)]
        for member in self.members:
            member.process = cast("Any", "there")
        self.log: list[tuple[str, Any]] = []

    def begin_sending(self, member: Member) -> None:
        member.is_ready = True

    def tell(self, member: Member, kind: str, content: Any = None) -> None:
        self.log.append((kind, member.number))

    def __getattr__(self, name: str) -> Any:
        return lambda *content, **named: self.log.append((name, content))


def stub_fleet(tmp_path: Path, robots: int, **changes: Any) -> tuple[FleetRobots, Stub]:
    stub, numbers = Stub(robots), itertools.count(1)
    whole = config(tmp_path / "run", **changes)

    def next_episode(being_played: int) -> Playing | None:
        return (
            Playing(next(numbers), Phase.TRAIN, 0, "sac") if being_played < whole.episodes else None
        )

    there = cast("Any", stub)
    nobody = cast("Any", None)
    return FleetRobots(
        there, there, Callback(), nobody, None, next_episode, "virtual", whole.patience_s, True
    ), stub


def test_first_episodes_start_together(tmp_path: Path) -> None:
    fleet, stub = stub_fleet(tmp_path, 3)
    one, two, three = stub.members
    fleet._handle((two, "ready", None))
    assert not stub.log
    three.process = None
    fleet._handle((three, "gone", "it died"))
    assert not stub.log, "the first one is still on its way"
    fleet._handle((one, "ready", None))
    assert stub.log == [("episode", 0), ("episode", 1)]
    three.process = cast("Any", "there again")
    fleet._handle((three, "ready", None))
    assert stub.log[2:] == [("episode", 2)], "and that one joins them at once"


def test_starting_process_gets_no_weights(tmp_path: Path) -> None:
    fleet: Any = make_fleet(config(tmp_path / "run"))
    sent: list[tuple[int, str]] = []
    for member in fleet.members:
        send = partial(lambda number, kind, _content: sent.append((number, kind)), member.number)
        member.process = cast("Any", SimpleNamespace(send=send))
    fleet.send_weights({"weight": torch.zeros(1)})
    assert sent == [], "a pipe that nobody reads would be full, and the whole fleet would wait"
    fleet.begin_sending(fleet.members[1])
    fleet.send_weights({"weight": torch.ones(1)})
    assert sent == [(1, "weights"), (1, "weights")]


def test_last_error_is_of_the_robot_that_left_last(tmp_path: Path) -> None:
    fleet, stub = stub_fleet(tmp_path, 2, patience_s=0.0)
    one, two = stub.members
    fleet._handle((two, "out", "its battery is empty"))
    fleet._check_reach()
    fleet._handle((one, "out", "it is out of reach"))
    with pytest.raises(HubError, match="the last error, of r0: it is out of reach"):
        fleet._check_reach()


def test_next_episode_starts_before_saving_last(tmp_path: Path) -> None:
    fleet, stub = stub_fleet(tmp_path, 1)
    fleet._handle((stub.members[0], "ready", None))
    fleet.playing[0].length = 1
    stub.log.clear()
    ended = fleet._handle((stub.members[0], "ended", (True, {}, False, False)))
    assert isinstance(ended, Ended) and ended.episode is not None and ended.episode.length == 1
    assert stub.log == [("episode", 0)]


def test_episode_lost_before_its_first_step_is_played_again_as_it_was(tmp_path: Path) -> None:
    loop: Any = Loop.__new__(Loop)
    loop.config, loop.prefill_episodes, loop.episodes, loop._started, loop._numbers_again = (
        config(tmp_path / "run"),
        2,
        [],
        0,
        [],
    )
    loop.learner, loop.signals = (
        SimpleNamespace(end_episodes=lambda _robot: None),
        SimpleNamespace(requested=False),
    )
    one, two, three = (loop._next_episode(0) for _ in range(3))
    assert [playing.phase for playing in (one, two, three)] == [
        Phase.PREFILL,
        Phase.PREFILL,
        Phase.TRAIN,
    ]
    loop._ended(Ended(two, None))
    again, four = loop._next_episode(0), loop._next_episode(0)
    assert (again.number, again.phase, again.seed) == (2, Phase.PREFILL, two.seed)
    assert (four.number, four.phase) == (4, Phase.TRAIN)


def test_pause_reaches_robots_that_are_starting(tmp_path: Path) -> None:
    fleet: Any = make_fleet(config(tmp_path / "run"))
    sent: list[str] = []
    fleet.members[0].process = cast(
        "Any", SimpleNamespace(send=lambda kind, _content: sent.append(kind))
    )
    for control, expected in ((fleet.pause, ["pause"]), (fleet.resume, []), (fleet.stop, ["stop"])):
        control()
        sent.clear()  # as if lost on a process that has no environment yet
        fleet.begin_sending(fleet.members[0])
        assert sent == expected


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


def test_deaths_count_from_the_last_complete_episode(tmp_path: Path) -> None:
    fleet, stub = stub_fleet(tmp_path, 1)
    member, process = stub.members[0], stub.members[0].process
    fleet._handle((member, "ready", None))
    member.deaths, member.process = 4, None
    fleet.playing[0].length = 1
    fleet._handle((member, "gone", "it died"))
    assert member.deaths == 4, "an episode that the death broke off is not complete"
    member.process = process
    fleet._handle((member, "ready", None))
    fleet.playing[0].length = 1
    fleet._handle((member, "ended", (True, {}, False, False)))
    assert member.deaths == 0


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


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"robots": 2, "hub": "ble:A"}, "named one by one"),
        ({"hub": "ble:A,ble:A", "robots": 1}, "give each robot a name"),
        ({"hub": "ble,ble:A", "robots": 1}, "give each robot a name"),
        ({"eval_every": 2}, "does not support num_envs"),
        ({"num_envs": 2}, "does not support num_envs"),
    ],
)
def test_invalid_fleet_raises(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(RunError, match=message):
        config(tmp_path / "run", **changes)
    with pytest.raises(DescriptionError, match="robots is 0; give 1 or more"):
        config(tmp_path / "run", robots=0)


def test_real_robots_are_named_by_hub(tmp_path: Path) -> None:
    named = config(tmp_path / "run", robots=1, hub="ble:A, ble:B")
    assert [(member.name, member.number) for member in members_of(named)] == [
        ("ble:A", 0),
        ("ble:B", 1),
    ]
    with pytest.raises(UnknownNameError, match="no hub 'tin:B'"):
        make_fleet(replace(named, hub="ble:A,tin:B"))
    with pytest.raises(RunError, match="num_envs"):
        make_fleet(replace(named, env="WalkerSim-v0"))
