"""Processes of a fleet: what they are told, and when they start again."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch
from test_fleet import config

from bricksrl.errors import DescriptionError, RunError, UnknownNameError
from bricksrl.training.fleet.fleet_robots import make_fleet, members_of


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


def dead() -> Any:
    """A process that has ended with code 3."""
    return SimpleNamespace(end=lambda _timeout_s: 3, send=lambda *_: None)


def test_pauses_before_a_restart_double_and_the_fifth_death_is_the_last(tmp_path: Path) -> None:
    fleet: Any = make_fleet(config(tmp_path / "run"))
    member = fleet.members[0]
    pauses_s = []
    for _ in range(4):
        member.process, member.is_ready = dead(), True
        told = fleet._bury(member, 100.0)
        assert told == (member, "gone", "its process ended with code 3")
        assert member.process is None and not member.is_ready
        pauses_s.append(member.restart_at_s - 100.0)
    assert pauses_s == [2.0, 4.0, 8.0, 16.0]
    member.process = dead()
    _, kind, reason = fleet._bury(member, 100.0)
    assert kind == "given up"
    assert reason.startswith("its process ended 5 times in a row without a complete episode, ")


def test_end_of_a_former_process_is_not_that_of_its_successor(tmp_path: Path) -> None:
    fleet: Any = make_fleet(config(tmp_path / "run"))
    member = fleet.members[0]
    member.process, member.starts = dead(), 2
    fleet.events.put((member, "gone", 1))
    assert fleet.next_event(0.0) is None and member.process is not None
    fleet.events.put((member, "gone", 2))
    assert fleet.next_event(0.0)[1] == "gone"
    assert fleet.next_event(0.0) is None, "nothing happens until it is started again"


def test_fleet_knows_whether_it_is_paused_and_has_stopped(tmp_path: Path) -> None:
    fleet: Any = make_fleet(config(tmp_path / "run"))
    assert fleet.has_stopped and not fleet.is_paused
    fleet.pause()
    assert fleet.is_paused
    fleet.resume()
    assert not fleet.is_paused
    code: list[int | None] = [None]
    fleet.members[1].process = SimpleNamespace(
        wait=lambda _timeout_s: code[0], send=lambda *_: None
    )
    fleet.stop()
    assert not fleet.has_stopped, "one of them may still move"
    code[0] = 0
    assert fleet.has_stopped


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


def test_a_robot_that_was_placed_is_told_and_one_that_was_not_ends_the_run(tmp_path: Path) -> None:
    placed: list[object] = []
    fleet: Any = make_fleet(config(tmp_path / "run"), placed.append)
    member, sent = fleet.members[0], []
    member.process = SimpleNamespace(send=lambda *told: sent.append(told))
    fleet._place_robot(member)
    assert len(placed) == 1 and sent == [("placed", None)] and fleet.events.empty()
    error = KeyboardInterrupt()

    def refuse(_rng: object) -> None:
        raise error

    fleet._place = refuse
    fleet._place_robot(member)
    assert sent == [("placed", None)]
    assert fleet.events.get_nowait() == (member, "unplaced", error)
    assert not fleet._placing.locked(), "the next one can be placed"
