"""Visitors of a page, what they hold, and what they ask each other for."""

from __future__ import annotations

import pytest

from bricksrl.page import visitors
from bricksrl.page.visitors import Seats, Visitor, Visitors


@pytest.fixture
def clock_s(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now_s = [100.0]
    monkeypatch.setattr(visitors.time, "monotonic", lambda: now_s[0])
    return now_s


@pytest.fixture
def people(clock_s: list[float]) -> tuple[Visitors, Visitor, Visitor]:
    everybody = Visitors()
    return everybody, everybody.arrive("a", "Ada"), everybody.arrive("b", "")


@pytest.mark.parametrize(
    ("given", "shown"),
    [
        ("Grace", "Grace"),
        ("  Grace \n Hopper ", "Grace Hopper"),
        ("Ada", "Ada (2)"),
        ("", "Visitor 2"),
        ("\x00\u202e", "Visitor 2"),
        (None, "Visitor 2"),
        (["x"], "Visitor 2"),
        ("x" * 500, "x" * 24),
        ("<b>", "<b>"),
    ],
)
def test_each_visitor_has_a_name_of_its_own(
    people: tuple[Visitors, Visitor, Visitor], given: object, shown: str
) -> None:
    everybody, _, second = people
    everybody.rename(second, given)
    assert second.name == shown


def test_tabs_of_a_browser_are_one_visitor(people: tuple[Visitors, Visitor, Visitor]) -> None:
    everybody, ada, other = people
    assert everybody.arrive("a", "somebody else") is ada and ada.tabs == 2 and ada.name == "Ada"
    everybody.leave(ada, closed=True)
    assert everybody.here() == [ada, other]


def test_holder_is_asked(people: tuple[Visitors, Visitor, Visitor]) -> None:
    _, ada, other = people
    seats = Seats()
    assert seats.ask("runner", ada), "nobody is to be asked"
    seats.take("runner", ada)
    assert not seats.may("runner", other) and not seats.ask("runner", other)
    assert seats.described() == {"holders": {"runner": "Ada"}, "questions": {"runner": "Visitor 2"}}
    assert seats.answer("runner", other, agrees=True) is None, "only the holder can say yes"
    assert seats.answer("runner", ada, agrees=False) is None
    assert other.note == "Ada says no." and seats.holder("runner") is ada
    seats.ask("runner", other)
    assert seats.answer("runner", ada, agrees=True) is other
    seats.take("runner", other)
    assert seats.holder("runner") is other and "yes" in ada.note


def test_question_of_two_visitors(people: tuple[Visitors, Visitor, Visitor]) -> None:
    everybody, ada, other = people
    third = everybody.arrive("c", "Cy")
    seats = Seats()
    seats.take("runner", ada)
    seats.ask("runner", other)
    assert not seats.ask("runner", third) and "asked already" in third.note
    assert seats.answer("runner", ada, agrees=True) is other


def test_question_without_answer_is_withdrawn(
    people: tuple[Visitors, Visitor, Visitor], clock_s: list[float]
) -> None:
    _, ada, other = people
    seats = Seats()
    seats.take("runner", ada)
    seats.ask("runner", other)
    clock_s[0] += visitors.ASK_S + 1
    seats.refresh()
    assert not seats.described()["questions"] and "not answered" in other.note


def test_who_comes_back_in_time_keeps_it(
    people: tuple[Visitors, Visitor, Visitor], clock_s: list[float]
) -> None:
    everybody, ada, other = people
    seats = Seats()
    seats.take("runner", ada)
    everybody.leave(ada, closed=True)
    clock_s[0] += visitors.AWAY_S - 0.1
    assert seats.refresh() == ([], []) and not seats.may("runner", other)
    everybody.arrive("a", "")
    clock_s[0] += 100.0
    assert seats.refresh() == ([], []) and seats.holder("runner") is ada


def test_who_slept_takes_it_up_again_unless_another_has_it(
    people: tuple[Visitors, Visitor, Visitor], clock_s: list[float]
) -> None:
    everybody, ada, other = people
    seats = Seats()
    seats.take("runner", ada)
    everybody.leave(ada, closed=False)
    clock_s[0] += visitors.AWAY_S + 0.1
    assert seats.refresh() == (["runner"], []) and seats.may("runner", other)
    everybody.arrive("a", "")
    assert seats.refresh() == ([], ["runner"]) and seats.holder("runner") is ada
    everybody.leave(ada, closed=False)
    clock_s[0] += visitors.AWAY_S + 0.1
    seats.refresh()
    seats.take("runner", other)
    everybody.arrive("a", "")
    seats.refresh()
    assert seats.holder("runner") is other and ada.tabs == 1


def test_one_robot_each(people: tuple[Visitors, Visitor, Visitor]) -> None:
    _, ada, _ = people
    seats = Seats()
    seats.take("runner", ada)
    assert seats.take("catcher", ada) == ["runner"]
    assert seats.described()["holders"] == {"catcher": "Ada"}


def test_the_page_knows_who_is_here_and_who_sleeps(clock_s: list[float]) -> None:
    everybody = Visitors()
    assert everybody.described() == {"here": [], "asleep": False, "came": False}
    ada = everybody.arrive("a", "Ada")
    assert everybody.described() == {"here": [ada.key], "asleep": False, "came": True}
    assert (len(ada.key), ada.left_s, ada.given_name) == (16, clock_s[0], "Ada")
    everybody.leave(ada, closed=False)
    assert everybody.described() == {"here": [], "asleep": True, "came": True}
    everybody.arrive("a", "")
    everybody.leave(ada, closed=True)
    assert everybody.described()["asleep"] is False
    for name in ("Visitor 12", "Visitor 3 (2)"):
        everybody.rename(ada, name)
        assert ada.given_name == ""


def test_a_visitor_is_away_after_five_seconds(clock_s: list[float]) -> None:
    everybody = Visitors()
    ada = everybody.arrive("a", "Ada")
    clock_s[0] += 100.0
    assert not ada.is_away
    everybody.leave(ada, closed=True)
    clock_s[0] += visitors.AWAY_S
    assert not ada.is_away
    clock_s[0] += 0.1
    assert ada.is_away


def test_who_left_first_is_forgotten_where_too_many_are_known(clock_s: list[float]) -> None:
    everybody = Visitors()
    known = [everybody.arrive(str(number), "") for number in range(64)]
    for number in (5, 3):
        clock_s[0] += 1.0
        everybody.leave(known[number], closed=True)
    # Those who are not away yet stay, and so do those who are here.
    newest = everybody.arrive("64", "")
    assert everybody.arrive("5", "") is known[5]
    everybody.leave(known[5], closed=True)
    clock_s[0] += 60.0
    everybody.arrive("65", "")
    assert everybody.arrive("5", "") is known[5], "3 had left before"
    again = everybody.arrive("3", "")
    assert again not in known and again.name == "Visitor 67"
    assert newest.name == "Visitor 65"


def test_several_may_be_held_at_once(people: tuple[Visitors, Visitor, Visitor]) -> None:
    _, ada, other = people
    seats = Seats(holds_several=True)
    assert seats.take("runner", ada) == seats.take("catcher", ada) == []
    assert seats.described()["holders"] == {"runner": "Ada", "catcher": "Ada"}
    assert seats.may("runner", None) and not seats.may("runner", other)
    seats.ask("runner", other)
    seats.give_back("runner")
    assert other.note == "The runner is free now."
    assert seats.holder("runner") is None and seats.holder("catcher") is ada


def test_a_question_ends_with_who_asked_and_after_a_minute(
    people: tuple[Visitors, Visitor, Visitor], clock_s: list[float]
) -> None:
    everybody, ada, other = people
    seats = Seats()
    seats.take("runner", ada)
    seats.ask("runner", other)
    clock_s[0] += visitors.ASK_S
    seats.refresh()
    assert seats.described()["questions"] == {"runner": "Visitor 2"}
    clock_s[0] += 0.1
    seats.refresh()
    assert seats.described()["questions"] == {} and other.note == "Ada has not answered."
    seats.ask("runner", other)
    everybody.leave(other, closed=True)
    clock_s[0] += visitors.AWAY_S + 0.1
    seats.refresh()
    assert seats.described() == {"holders": {"runner": "Ada"}, "questions": {}}
    assert seats.answer("runner", ada, agrees=True) is None
