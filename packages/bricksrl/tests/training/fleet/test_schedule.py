"""Which robot of a fleet plays which episode, without processes."""

from __future__ import annotations

import itertools
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch
from test_fleet import config

from bricksrl.data import About
from bricksrl.errors import HubError, RunError
from bricksrl.training import Callback, Phase, RobotState
from bricksrl.training.fleet import schedule
from bricksrl.training.fleet.fleet_robots import Member
from bricksrl.training.fleet.schedule import FleetRobots
from bricksrl.training.loop import Loop
from bricksrl.training.sources import Ended, Moved, Playing


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


def test_end_without_a_step_takes_no_place_of_an_episode(tmp_path: Path) -> None:
    """The only episode of the run is assigned again, as it does not count."""
    fleet, stub = stub_fleet(tmp_path, 1, episodes=1)
    member = stub.members[0]
    fleet._handle((member, "ready", None))
    ended = fleet._handle((member, "ended", (None, {}, True, False)))
    assert isinstance(ended, Ended) and ended.episode is None
    assert stub.log == [("episode", 0), ("episode", 0)]
    fleet.playing[0].length = 1
    fleet._handle((member, "ended", (True, {}, False, False)))
    assert stub.log[2:] == [], "but one that has a step is the last one"
    assert member.state is RobotState.DONE


def test_episode_has_what_its_robot_has_told(tmp_path: Path) -> None:
    fleet, stub = stub_fleet(tmp_path, 2)
    _, two = stub.members
    for member in stub.members:
        fleet._handle((member, "ready", None))
    fleet._handle((two, "begun", About(policy="sac", hub="virtual")))
    assert two.state is RobotState.ACTING
    assert fleet.playing[1].about == About(policy="sac", hub="virtual", robot="r1")
    outcome = {"next.reward": torch.ones(1), "observation": torch.zeros(2)}
    own = {"next.reward": torch.full((1,), 2.0)}
    moved = fleet._handle((two, "frame", ([outcome, own], ["row", "row"], [0.5, 0.25])))
    assert isinstance(moved, Moved) and moved.playing is fleet.playing[1]
    assert (moved.playing.length, moved.playing.return_, moved.is_lost) == (2, 0.75, False)
    assert moved.playing.steps == ["row", "row"]
    assert moved.frame["next", "reward"] == 1.0 and moved.own_frame["next", "reward"] == 2.0
    lost = {**outcome, "next.link_lost": torch.ones(1, dtype=torch.bool)}
    moved = fleet._handle((two, "frame", ([lost], [], [])))
    assert isinstance(moved, Moved) and moved.is_lost and moved.own_frame is moved.frame
    ended = fleet._handle((two, "ended", (True, {"error": 3.0}, True, True)))
    assert isinstance(ended, Ended) and ended.episode is not None and ended.is_cut
    episode = ended.episode
    assert (episode.length, episode.steps, episode.return_) == (2, 2, 0.75)
    assert (episode.success, episode.measures) == (True, {"error": 3.0})
    assert (episode.link_lost, episode.robot, episode.episode) == (True, "r1", 2)


class Heard(Callback):
    """Notes what a run is told of its robots."""

    def __init__(self) -> None:
        self.states: list[tuple[str, RobotState, str]] = []
        self.lost: list[tuple[int, int, str]] = []

    def on_robot(self, robot: str, state: RobotState, reason: str) -> None:
        self.states.append((robot, state, reason))

    def on_link_lost(self, episode: int, length: int, error: Exception) -> None:
        self.lost.append((episode, length, str(error)))


def test_robot_that_is_done_takes_over_for_one_that_left(tmp_path: Path) -> None:
    fleet, stub = stub_fleet(tmp_path, 2, episodes=1)
    fleet.callback = heard = Heard()
    one = stub.members[0]
    for member in stub.members:
        fleet._handle((member, "ready", None))
    assert stub.log == [("episode", 0)]
    assert heard.states == [("r1", RobotState.DONE, "")]
    fleet.playing[0].length = 3
    fleet._handle((one, "out", "it is out of reach"))
    assert heard.lost == [(1, 3, "r0: it is out of reach")]
    assert stub.log == [("episode", 0), ("episode", 1)]
    assert heard.states[1:] == [
        ("r0", RobotState.LEFT, "it is out of reach"),
        ("r1", RobotState.STARTING, ""),
    ]
    fleet._handle((one, "begun", About()))
    assert not one.is_out, "it has come back, and plays on"


def test_link_that_breaks_before_an_episode_is_of_none(tmp_path: Path) -> None:
    fleet, stub = stub_fleet(tmp_path, 1)
    fleet.callback = heard = Heard()
    fleet._handle((stub.members[0], "out", "it is off"))
    assert heard.lost == [(0, 0, "r0: it is off")]


def test_run_ends_when_all_robots_are_given_up_and_waits_for_those_that_left(
    tmp_path: Path,
) -> None:
    fleet, stub = stub_fleet(tmp_path, 2, patience_s=100.0)
    one, two = stub.members
    one.process = two.process = None
    fleet._check_reach()
    fleet._handle((one, "given up", "it died 5 times"))
    fleet._check_reach()
    fleet._handle((two, "gone", "it died"))
    assert two.state is RobotState.LEFT
    fleet._check_reach()
    two.since_s = time.monotonic() - 101.0
    one.since_s = two.since_s + 0.5
    with pytest.raises(HubError, match="the last error, of r0: it died 5 times"):
        fleet._check_reach()
    one.since_s = time.monotonic()
    fleet._check_reach()
    fleet._handle((two, "given up", "it died, too"))
    two.since_s = time.monotonic() + 1.0
    with pytest.raises(RunError, match="the last one, r1, was given up: it died, too; correct"):
        fleet._check_reach()


def test_broken_off_episode_of_a_dead_process_counts_as_lost(tmp_path: Path) -> None:
    fleet, stub = stub_fleet(tmp_path, 1)
    member = stub.members[0]
    fleet._handle((member, "ready", None))
    fleet.playing[0].length = 2
    member.process, member.is_ready = None, False
    ended = fleet._handle((member, "gone", "it died"))
    assert isinstance(ended, Ended) and ended.episode is not None and not ended.is_cut
    assert ended.episode.link_lost and ended.episode.success is None
    assert fleet._handle((member, "gone", "it died again")) is None, "it played nothing"


def test_errors_of_robots_and_of_placing_end_the_run(tmp_path: Path) -> None:
    fleet, stub = stub_fleet(tmp_path, 1)
    member = stub.members[0]
    fleet._handle((member, "place", None))
    assert member.state is RobotState.PLACED
    with pytest.raises(RunError, match=r"^r0 failed \(KeyError: 'x'\); correct it and resume"):
        fleet._handle((member, "failed", ("KeyError", "'x'")))
    with pytest.raises(ZeroDivisionError):
        fleet._handle((member, "unplaced", ZeroDivisionError()))
    with pytest.raises(RunError, match="the robots cannot be placed; start again"):
        fleet._handle((member, "unplaced", KeyboardInterrupt()))


@pytest.mark.parametrize("is_paced", [True, False])
def test_robots_get_weights_before_they_are_told_to_go_on(tmp_path: Path, is_paced: bool) -> None:
    """Only robots in simulated time wait for that word."""
    fleet, stub = stub_fleet(tmp_path, 1)
    member = stub.members[0]
    fleet._is_started = True
    fleet._handle((member, "ready", None))
    fleet.learner = cast("Any", SimpleNamespace(new_weights=lambda: {"w": 1}))
    reports: list[Any] = [(member, "frame", ([{"next.reward": torch.ones(1)}], [], [1.0])), None]
    stub.is_paced = is_paced  # type: ignore[attr-defined]
    stub.next_event = lambda _timeout_s: reports.pop(0)  # type: ignore[attr-defined]
    stub.log.clear()
    events = fleet.events()
    assert isinstance(next(events), Moved) and not stub.log, "first it is learned from"
    assert next(events) is None
    assert stub.log == [("send_weights", ({"w": 1},)), *[("go", 0)] * is_paced]


def test_run_starts_when_the_first_robot_acts(tmp_path: Path) -> None:
    fleet, stub = stub_fleet(tmp_path, 2)
    fleet._is_started = True
    one, two = stub.members
    events: list[Any] = [
        (one, "ready", None),
        None,
        (two, "ready", None),
        (two, "place", None),
        (two, "begun", About()),
        (one, "begun", About()),
    ]
    stub.next_event = lambda _timeout_s: events.pop(0)  # type: ignore[attr-defined]
    fleet.signals = cast("Any", SimpleNamespace(at_once=torch.no_grad, requested=False))
    fleet.start()
    assert len(events) == 1 and two.state is RobotState.ACTING, "the others follow"
    one.state = two.state = RobotState.STARTING
    events[:] = [None]
    fleet.signals = cast("Any", SimpleNamespace(at_once=torch.no_grad, requested=True))
    with pytest.raises(KeyboardInterrupt):
        fleet.start()


def test_episode_that_has_ended_is_counted_once(tmp_path: Path) -> None:
    """Until the run has counted it, the next one must not be one too many."""
    fleet, stub = stub_fleet(tmp_path, 1, episodes=2)
    member = stub.members[0]
    fleet._is_started = True
    fleet._handle((member, "ready", None))
    fleet.playing[0].length = 1
    events: list[Any] = [(member, "ended", (True, {}, False, False)), None]
    stub.next_event = lambda _timeout_s: events.pop(0)  # type: ignore[attr-defined]
    reports = fleet.events()
    assert isinstance(next(reports), Ended) and fleet._unsaved == 1
    next(reports)
    assert fleet._unsaved == 0


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


def test_robots_of_a_run_are_started_once_with_the_learner_s_weights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fleet, stub = stub_fleet(tmp_path, 2)
    ended: list[bool] = []
    fleet.learner = cast("Any", SimpleNamespace(end_episodes=lambda: ended.append(True)))
    monkeypatch.setattr(schedule, "base_of", lambda _env: stub)
    monkeypatch.setattr(schedule, "transform_state", lambda _env: "state")
    monkeypatch.setattr(fleet, "_send_weights", lambda: stub.log.append(("weights", ())))
    for _ in range(2):
        fleet._start()
    assert stub.kept == "state" and ended == [True]
    assert stub.log == [("start", ()), ("weights", ())]
