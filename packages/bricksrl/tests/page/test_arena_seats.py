"""Seats of an arena's page, without a browser: who drives which robot, and what the others may
do."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict

from bricksrl.envs.arenas.tag import TAG
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
    for answer in (["tower", True], ["runner"], "runner", None):
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
