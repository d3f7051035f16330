"""Messages between a fleet and the processes of its robots, without processes."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from tensordict import TensorDict
from test_fleet import config
from toys import Cart

from brickhub.seed import derive_seed
from bricksrl.agents import make_learner
from bricksrl.child_process import END
from bricksrl.envs.env_interface import BricksEnv
from bricksrl.errors import LearnerError, RunError
from bricksrl.training.callbacks import RobotState
from bricksrl.training.fleet import fleet_robots
from bricksrl.training.fleet import worker as workers
from bricksrl.training.fleet.fleet_robots import Member, make_fleet, members_of
from bricksrl.training.fleet.worker import Worker, _columns, _FleetEnded


class Robot:
    """Notes what it is asked to do."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def __getattr__(self, name: str) -> Any:
        return lambda: self.asked.append(name)


def test_worker_does_at_once_what_must_not_wait() -> None:
    worker: Any = Worker()
    worker._env = Robot()
    for kind in ("stop", "pause", "resume"):
        worker.receive((kind, None))
    assert worker._env.asked == ["stop", "pause", "resume"]
    worker.receive(("weights", {"old": 1}))
    worker.receive(("weights", {"new": 2}))
    assert list(worker._weights) == [{"new": 2}], "a slow robot acts with the newest ones alone"
    assert worker._inbox.empty()
    worker.receive(("episode", 7))
    assert worker._inbox.get_nowait() == ("episode", 7)
    assert not worker._ended.is_set()


@pytest.mark.parametrize("message", [END, None])
def test_worker_ends_with_its_fleet(message: Any) -> None:
    worker: Any = Worker()
    worker.receive(message)
    assert worker._ended.is_set()
    with pytest.raises(_FleetEnded):
        worker._next_message("episode")
    with pytest.raises(_FleetEnded):
        worker._wait(60.0)


def test_worker_waits_for_the_message_that_it_expects() -> None:
    worker: Any = Worker()
    for message in (("go", 1), ("placed", 2), ("episode", 3), ("go", 4)):
        worker.receive(message)
    assert worker._next_message("episode") == ("episode", 3)
    assert worker._next_message() == ("go", 4)
    worker._wait(0.0)


def test_worker_asks_to_be_placed() -> None:
    worker: Any = Worker()
    sent: list[str] = []
    worker.send = sent.append
    worker.receive(("placed", None))
    worker._place(None)
    assert sent == ["place"] and worker._inbox.empty()


def test_link_is_cut_for_as_long_as_told(monkeypatch: pytest.MonkeyPatch) -> None:
    worker: Any = Worker()
    monkeypatch.setattr(workers, "time", SimpleNamespace(monotonic=lambda: 100.0))
    worker.receive(("cut", 2.5))
    assert worker._cut_until_s == 102.5


@pytest.mark.parametrize(
    ("error", "is_told"),
    [(ValueError("a robot of wood"), True), (_FleetEnded(), False), (BrokenPipeError(), False)],
)
def test_failure_of_a_worker_is_told_with_its_line(error: BaseException, is_told: bool) -> None:
    worker: Any = Worker()
    told: list[Any] = []
    worker.send = lambda *message: told.append(message)

    def fail(_begin: Any) -> None:
        raise error

    worker._prepare = fail
    worker.receive(("begin", {}))
    worker.run()
    assert len(told) == int(is_told)
    for kind, (name, reason) in told:
        assert (kind, name) == ("failed", "ValueError")
        assert reason.startswith(f"a robot of wood, {Path(__file__).name}, line ")


def test_steps_go_without_the_link_of_the_reset() -> None:
    flag = torch.zeros(1, dtype=torch.bool)
    frame = TensorDict({"a": torch.ones(2), "link_lost": flag, "next": {"link_lost": flag}}, [])
    assert sorted(_columns(frame)) == ["a", "next.link_lost"]


class Process:
    """A process of a robot that only notes what it is told."""

    def __init__(self, module: str, deliver: Any) -> None:
        self.module = module
        self.deliver = deliver
        self.sent: list[tuple[str, Any]] = []
        self.ended_s: list[float] = []

    def send(self, kind: str, content: Any) -> None:
        self.sent.append((kind, content))

    def end(self, timeout_s: float) -> int:
        self.ended_s.append(timeout_s)
        return 0


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[Process]:
    processes: list[Process] = []

    def start(module: str, deliver: Any) -> Process:
        processes.append(Process(module, deliver))
        return processes[-1]

    monkeypatch.setattr(fleet_robots, "ChildProcess", start)
    return processes


@pytest.mark.parametrize("is_placed", [False, True])
def test_process_of_a_robot_is_told_what_it_is(
    tmp_path: Path, started: list[Process], is_placed: bool
) -> None:
    place: Any = print if is_placed else None
    made = config(tmp_path / "run", robots=2)
    fleet: Any = make_fleet(made, place)
    fleet.kept = {"a transform": 1}
    fleet.start()
    fleet.start()
    assert [process.module for process in started] == ["bricksrl.training.fleet.worker"] * 2
    first, second = (process.sent[0][1] for process in started)
    assert first["config"]["robots"] == 1 and first["config"]["hub"] == "virtual"
    assert first["config"]["asynchronous"] is False
    assert first["seed"] == derive_seed(made.seed, "robot virtual-1", 0)
    assert second["seed"] == derive_seed(made.seed, "robot virtual-2", 0)
    assert first["transforms"] == {"a transform": 1}
    assert (first["is_recorded"], first["is_paced"]) == (made.record, not made.realtime)
    assert first["is_placed"] is is_placed
    started[0].deliver(("begun", 5))
    started[1].deliver(None)
    assert fleet.events.get_nowait() == (fleet.members[0], "begun", 5)
    assert fleet.events.get_nowait() == (fleet.members[1], "gone", 1), "its first start"
    fleet.close()
    assert [process.sent[-1][0] for process in started] == ["end", "end"]
    assert all(process.ended_s[0] >= 5.0 for process in started), "a robot is stopped first"
    assert all(member.process is None for member in fleet.members)


def test_robot_is_started_again_when_its_pause_is_over(
    tmp_path: Path, started: list[Process], monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = [100.0]
    clock = SimpleNamespace(monotonic=lambda: now_s[0])
    monkeypatch.setattr(fleet_robots, "time", clock)
    fleet: Any = make_fleet(config(tmp_path / "run", robots=2))
    member = fleet.members[0]
    member.restart_at_s = 102.0
    member.deaths = 3
    now_s[0] = 101.9
    assert fleet.next_event(0.0) is None and not started
    now_s[0] = 102.0
    assert fleet.next_event(0.0) is None
    (process,) = started
    assert member.process is process and member.restart_at_s is None and member.starts == 1
    name = f"robot {member.name}"
    assert process.sent[0][1]["seed"] == derive_seed(fleet.config.seed, name, 3), "other draws"
    fleet.stop()
    assert process.sent[-1] == ("stop", None)
    fleet.members[1].restart_at_s = 102.0
    fleet.next_event(0.0)
    assert len(started) == 1, "a fleet that was stopped starts nothing"


def test_longest_pause_is_a_minute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fleet_robots, "_MAX_DEATHS", 99)
    fleet: Any = make_fleet(config(tmp_path / "run"))
    member = fleet.members[0]
    pauses_s = []
    for _ in range(8):
        fleet._bury(member, 0.0)
        pauses_s.append(member.restart_at_s)
    assert pauses_s == [2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0, 60.0]


def test_process_that_cannot_be_started_ends_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any) -> None:
        raise OSError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(fleet_robots, "ChildProcess", refuse)
    fleet: Any = make_fleet(config(tmp_path / "run"))
    with pytest.raises(LearnerError) as raised:
        fleet.start()
    assert str(raised.value) == (
        "cannot start the process of virtual-1 (Resource temporarily unavailable); use fewer robots"
    )


def test_closed_pipe_of_a_robot_is_no_error(tmp_path: Path) -> None:
    fleet: Any = make_fleet(config(tmp_path / "run"))
    member = fleet.members[0]
    fleet.tell(member, "go")

    def send(*_: Any) -> None:
        raise BrokenPipeError

    member.process = SimpleNamespace(send=send)
    fleet.tell(member, "go")


def test_robot_that_asks_is_placed_by_a_person(tmp_path: Path) -> None:
    placed = threading.Event()
    fleet: Any = make_fleet(config(tmp_path / "run"), lambda _rng: placed.set())
    member = fleet.members[1]
    fleet.events.put((member, "place", None))
    assert fleet.next_event(0.0) == (member, "place", None)
    assert placed.wait(10.0)


def test_members_have_names_and_are_reachable_at_first(tmp_path: Path) -> None:
    members = members_of(config(tmp_path / "run", robots=3))
    assert [(one.name, one.number, one.hub) for one in members] == [
        ("virtual-1", 0, "virtual"),
        ("virtual-2", 1, "virtual"),
        ("virtual-3", 2, "virtual"),
    ]
    out = {state for state in RobotState if Member("a", 0, "virtual", state).is_out}
    assert out == {RobotState.LEFT, RobotState.GIVEN_UP}
    with pytest.raises(RunError) as raised:
        make_fleet(replace(config(tmp_path / "run"), env="WalkerSim-v0"))
    assert str(raised.value) == (
        "WalkerSim-v0 is a simulation without a robot; train copies of it with num_envs"
    )


class Cartlike(BricksEnv, Cart):
    """A cart with what a robot has beside its specs."""


def episode_of(
    worker: Any, *, is_recorded: bool = False, is_paced: bool = False, is_random: bool = True
) -> list[Any]:
    """What a worker sends of an episode of three steps."""
    sent: list[Any] = []
    worker.send = lambda *message: sent.append(message)
    env = Cartlike(max_steps=3)
    actor = make_learner("sac", Cart())
    begin = {
        "config": {"hub": "ble:A"},
        "is_recorded": is_recorded,
        "is_paced": is_paced,
    }
    order = {"seed": 7, "is_random": is_random, "policy": "sac"}
    try:
        worker._episode(env, actor, begin, order)
    except _FleetEnded:
        sent.append("ended by the fleet")
    return sent


@pytest.mark.parametrize("is_recorded", [False, True])
@pytest.mark.parametrize("is_random", [False, True])
def test_episode_is_told_step_by_step(
    monkeypatch: pytest.MonkeyPatch, is_recorded: bool, is_random: bool
) -> None:
    monkeypatch.setattr(workers, "about", lambda env, policy, **named: (policy, named))
    begun, *frames, ended = episode_of(Worker(), is_recorded=is_recorded, is_random=is_random)
    assert begun == ("begun", ("sac", {"seed": 7, "hub": "ble:A"}))
    assert [kind for kind, _ in frames] == ["frame"] * 3
    for _, (columns, steps, rewards) in frames:
        assert len(columns) == 1 and len(rewards) == 1
        assert float(columns[0]["next.reward"]) == pytest.approx(rewards[0])
        assert len(steps) == int(is_recorded)
    kind, (success, measures, is_lost, is_cut) = ended
    assert (kind, success, is_lost, is_cut) == ("ended", None, False, False)
    assert isinstance(measures, dict)


def test_same_seed_is_the_same_episode_but_for_what_it_draws() -> None:
    def starts() -> Any:
        return episode_of(Worker())[1][1][0][0]["observation"].tolist()

    assert starts() == starts()


def test_robot_in_simulated_time_waits_for_its_fleet() -> None:
    worker: Any = Worker()
    for _ in range(3):
        worker.receive(("go", None))
    sent = episode_of(worker, is_paced=True)
    assert [message[0] for message in sent] == ["begun", *["frame"] * 3, "ended"]
    assert worker._inbox.empty()


def test_episode_ends_with_its_fleet() -> None:
    worker: Any = Worker()
    worker.receive(END)
    sent = episode_of(worker)
    assert [message[0] for message in sent[:-1]] == ["begun", "frame"]
    assert sent[-1] == "ended by the fleet"


@pytest.mark.parametrize(
    ("is_placed", "is_transformed"), [(False, False), (True, False), (False, True)]
)
def test_robot_of_a_worker_tries_for_ever_to_come_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_placed: bool, is_transformed: bool
) -> None:
    """The fleet decides when to give it up."""
    asked: list[Any] = []
    robot = SimpleNamespace(reconnect=SimpleNamespace(), in_reach=None)
    actor = SimpleNamespace(weights=None)

    def make(env_id: str, options: Any, **named: Any) -> Any:
        asked.append((env_id, options, named))
        return robot

    def make_learner_for(config: Any, env: Any, *, device: str) -> Any:
        asked.append((env, device))
        return actor

    monkeypatch.setattr(workers, "make", make)
    monkeypatch.setattr(workers, "make_learner_for", make_learner_for)
    monkeypatch.setattr(workers, "stand_in", lambda config: "stand-in")
    monkeypatch.setattr(workers, "over", lambda env, given: (env, given))
    kept: list[Any] = []
    monkeypatch.setattr(workers, "load_transform_state", lambda *given: kept.append(given))
    changes = {"frame_skip": 2} if is_transformed else {}
    made = config(tmp_path / "run", robots=1, **changes)
    worker: Any = Worker()
    sent: list[Any] = []
    worker.send = lambda *message: sent.append(message)
    begin = {
        "config": made.to_dict(),
        "seed": 5,
        "is_placed": is_placed,
        "transforms": {"a transform": 1},
    }
    with torch.random.fork_rng():
        env, found = worker._prepare(begin)
        assert torch.initial_seed() == 5
    (name, options, named), (acts_in, device) = asked
    assert (name, named["seed"]) == (made.env, made.seed)
    assert not options.is_transformed, "its transforms come around it"
    assert (named["place"] is not None) is is_placed
    wanted = ("stand-in", robot) if is_transformed else robot
    assert env == acts_in == wanted and device == "cpu"
    assert kept == [(env, {"a transform": 1})]
    assert found is actor and actor.weights is worker._weights
    assert robot.reconnect.patience_s == float("inf")
    robot.reconnect.on_error(RunError("out of reach"))
    assert sent == [("out", "out of reach")]
    assert robot.in_reach()
    worker.receive(("cut", 60.0))
    assert not robot.in_reach()
    robot.reconnect.wait(0.0)
    worker.receive(END)
    with pytest.raises(_FleetEnded):
        robot.reconnect.wait(60.0)
