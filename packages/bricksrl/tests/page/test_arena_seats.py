"""Seats of an arena's page, without a browser: who drives which robot, and what the others may
do."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from tensordict import TensorDict

from bricksrl.envs.arenas.tag import TAG
from bricksrl.errors import HubError
from bricksrl.page import arena
from bricksrl.page.arena import ArenaPage
from bricksrl.page.visitors import Visitor


@pytest.fixture
def page() -> ArenaPage:
    return ArenaPage(TAG)


@pytest.fixture
def people(page: ArenaPage) -> tuple[Visitor, Visitor]:
    return page.visitors.arrive("a", "Ada"), page.visitors.arrive("b", "Ben")


def driven(page: ArenaPage) -> dict[str, str]:
    """Names of those who drive, by robot."""
    holders = {name: page.seats.holder(name) for name in page.drivers}
    found = {name: visitor.name for name, visitor in holders.items() if visitor is not None}
    assert {name for name, driver in page.drivers.items() if driver.in_charge} == found.keys()
    assert page.is_driven is bool(found)
    return found


def test_a_robot_is_taken_kept_and_given_back(
    page: ArenaPage, people: tuple[Visitor, Visitor]
) -> None:
    ada, ben = people
    assert driven(page) == {}
    assert page._handle_seat("take_over:runner", True, ada)
    assert driven(page) == {"runner": "Ada"}
    assert page._handle_seat("take_over:runner", True, ben)
    assert driven(page) == {"runner": "Ada"} and ben.note == "Ada drives the runner; ask first."
    page._handle_seat("take_over:runner", False, ben)
    assert driven(page) == {"runner": "Ada"}
    page._handle_seat("take_over:catcher", True, ben)
    assert driven(page) == {"catcher": "Ben", "runner": "Ada"}
    page._handle_seat("take_over:runner", False, ada)
    assert driven(page) == {"catcher": "Ben"}
    page._handle_seat("take_over:runner", True, ben)
    assert driven(page) == {"runner": "Ben"}, "each drives one robot"


def test_who_asks_for_a_robot_drives_it_after_a_yes(
    page: ArenaPage, people: tuple[Visitor, Visitor]
) -> None:
    ada, ben = people
    assert page._handle_seat("ask:runner", None, ada)
    assert driven(page) == {"runner": "Ada"}, "nobody is to be asked"
    page._handle_seat("ask:runner", None, ben)
    for answer in (["runner", False], ["runner", True]):
        assert driven(page) == {"runner": "Ada"}
        page._handle_seat("ask:runner", None, ben)
        assert page._handle_seat("answer", answer, ada)
    assert driven(page) == {"runner": "Ben"}
    for answer in (["tower", True], ["runner"], [["runner"], True], "runner", None):
        assert page._handle_seat("answer", answer, ben)
    assert driven(page) == {"runner": "Ben"}


def test_only_who_holds_a_robot_pushes_its_stick(
    page: ArenaPage, people: tuple[Visitor, Visitor]
) -> None:
    ada, ben = people
    runner = page.drivers["runner"]
    page._handle_seat("take_over:runner", True, ada)
    page._handle_seat("drive:runner", [0.5, -1.0], ben)
    assert runner.pushes == [0.0, 0.0]
    page._handle_seat("drive:runner", [0.5, -1.0], ada)
    assert runner.pushes == [0.5, -1.0]
    told = TensorDict(
        {name: {"action": torch.full((1, 2), 0.25)} for name in ("catcher", "runner")}, []
    )
    actions = page.steered(told)
    assert actions["runner", "action"].tolist() == [[0.5, -1.0]]
    assert actions["catcher", "action"].tolist() == [[0.25, 0.25]], "that of its policy"
    page._handle_seat("left", None, ben)
    assert runner.pushes == [0.5, -1.0]
    page._handle_seat("left", None, ada)
    assert runner.pushes == [0.0, 0.0] and driven(page) == {"runner": "Ada"}


def test_who_drives_no_robot_changes_nothing_for_those_who_do(
    page: ArenaPage, people: tuple[Visitor, Visitor]
) -> None:
    ada, ben = people
    for name in ("pause", "reset", "speed"):
        assert not page._handle_seat(name, None, ben), "the page itself handles it"
    page._handle_seat("take_over:runner", True, ada)
    for name in ("pause", "reset", "speed"):
        ben.note = ""
        assert page._handle_seat(name, None, ben)
        assert ben.note == "Others drive here; take a robot first."
        assert not page._handle_seat(name, None, ada)
    for visitor in people:
        assert not page._handle_seat("stop", None, visitor), "everybody may stop them"
        for name in ("arrived", "renamed", "ask", "answer"):
            assert page._handle_seat(name, None, visitor)


class PlayedArena:
    """An arena whose catcher gets these rewards; it is caught at the end, or its link breaks."""

    task = TAG

    def __init__(self, rewards: list[float], *, success: bool, is_lost: bool = False) -> None:
        self.rewards, self.success, self.is_lost = list(rewards), success, is_lost

    def state(self) -> TensorDict:
        return TensorDict(
            {name: {"action": torch.zeros(1, 2)} for name in ("catcher", "runner")}, []
        )

    reset = state

    def step(self, state: TensorDict) -> TensorDict:
        reward = self.rewards.pop(0)
        is_last = not self.rewards
        after = {
            "catcher": {"reward": torch.tensor([[reward]])},
            "runner": {"reward": torch.tensor([[-reward]])},
            "link_lost": torch.tensor([is_last and self.is_lost]),
            "success": torch.tensor([self.success]),
            "done": torch.tensor([is_last]),
        }
        return state.set("next", TensorDict(after, []))

    def step_mdp(self, _frame: TensorDict) -> TensorDict:
        return self.state()


def to_its_end(_env: object, _page: object, episode: Any, **_named: object) -> list[float]:
    """The return of the third episode, in place of `play_endlessly`."""
    steps = episode("3")
    try:
        while True:
            next(steps)
    except StopIteration as end:
        return [end.value]


@pytest.mark.parametrize(
    ("success", "note"),
    [(True, "catcher succeeds after 3 steps."), (False, "catcher does not succeed.")],
)
def test_an_episode_of_an_arena_ends_with_its_outcome(
    page: ArenaPage, monkeypatch: pytest.MonkeyPatch, success: bool, note: str
) -> None:
    monkeypatch.setattr(arena, "play_endlessly", to_its_end)
    shown: list[tuple[Any, ...]] = []
    monkeypatch.setattr(page, "show_outcome", lambda *outcome: shown.append(outcome))
    env = PlayedArena([1.0, -0.5, 2.0], success=success)
    played = arena.play_arena(env, page, lambda state: state, stop=threading.Event())  # type: ignore[arg-type]
    assert played == [2.5]
    assert shown == [([], 1.0, 1.0), ([], -0.5, 0.5), ([], 2.0, 2.5)]
    assert page.board.status[1]["note"] == f"Episode 3: {note}"


def test_a_lost_link_in_an_arena_is_told_to_who_plays(
    page: ArenaPage, monkeypatch: pytest.MonkeyPatch
) -> None:
    lost = SimpleNamespace(link_error=HubError("out of reach"))
    monkeypatch.setattr(arena, "interface_of", lambda _env: lost)
    monkeypatch.setattr(arena, "play_endlessly", to_its_end)
    env = PlayedArena([1.0, 2.0], success=True, is_lost=True)
    with pytest.raises(HubError, match="out of reach"):
        arena.play_arena(env, page, lambda state: state, stop=threading.Event())  # type: ignore[arg-type]
    assert page.board.status[1].get("note") is None


def test_a_robot_of_somebody_who_is_away_plays_by_itself_until_that_one_is_back(
    page: ArenaPage, people: tuple[Visitor, Visitor]
) -> None:
    ada, _ = people
    page._handle_seat("take_over:runner", True, ada)
    page._handle_seat("drive:runner", [1.0, 1.0], ada)
    page._tick()
    assert driven(page) == {"runner": "Ada"} and page.drivers["runner"].pushes == [1.0, 1.0]
    page.visitors.leave(ada, closed=False)
    ada.left_s -= 100.0
    page._tick()
    assert driven(page) == {} and page.drivers["runner"].pushes == [0.0, 0.0]
    page.visitors.arrive("a", "Ada")
    page._tick()
    assert driven(page) == {"runner": "Ada"}
    seats = page.board.status[1]["seats"]
    assert {name: seat["color"] for name, seat in seats.items()} == {
        robot.name: robot.color for robot in TAG.arena.robots
    }
    assert seats["runner"] != seats["catcher"]
