"""Words of messages: hints, counts, articles, shares, one line of anybody's error."""

from __future__ import annotations

import pytest

from brickhub import errors
from brickhub.errors import (
    BluetoothUnavailableError,
    HubNotFoundError,
    MediumUnavailableError,
    Reason,
    TwinError,
    WriteError,
    an,
    counted,
    hint,
    installed,
    message_of,
    percent,
)


@pytest.mark.parametrize(
    ("name", "known", "said"),
    [
        ("wlaker", ["runner", "walker"], " (did you mean 'walker'?)"),
        ("WALKER", ["Walker"], " (did you mean 'Walker'?)"),
        ("walker", ["crane"], ""),
        ("walker", [], ""),
    ],
)
def test_hint_is_the_name_that_is_most_alike(name: str, known: list[str], said: str) -> None:
    assert hint(name, known) == said


@pytest.mark.parametrize(
    ("number", "said"), [(0, "0 lines"), (1, "1 line"), (2, "2 lines"), (11, "11 lines")]
)
def test_counts(number: int, said: str) -> None:
    assert counted(number, "line") == said


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("prime", "a prime"),
        ("ev3", "an ev3"),
        ("EV3", "an EV3"),
        ("nxt-motor", "an nxt-motor"),
        ("NXT", "an NXT"),
        ("net", "a net"),
        ("UltrasonicSensor", "an UltrasonicSensor"),
    ],
)
def test_article_is_as_the_name_is_spoken(name: str, said: str) -> None:
    assert an(name) == said


@pytest.mark.parametrize(
    ("share", "said"), [(0.57, "57 %"), (0.0, "0 %"), (1.0, "100 %"), (0.996, "100 %"), (None, "")]
)
def test_shares(share: float | None, said: str) -> None:
    assert percent(share) == said


@pytest.mark.parametrize(
    ("error", "typed", "said"),
    [
        (ValueError("too  much\n of it"), False, "too much of it"),
        (ValueError("too much"), True, "ValueError: too much"),
        (KeyError(), False, "KeyError"),
        (KeyError(), True, "KeyError"),
        (ValueError("x" * 300), False, "x" * 200),
    ],
)
def test_anybodys_error_is_one_line(error: Exception, typed: bool, said: str) -> None:
    assert message_of(error, typed=typed) == said


def test_message_is_cut() -> None:
    assert message_of(ValueError("abcdef"), 3) == "abc"
    assert message_of(ValueError("abcdef"), 3, typed=True) == "ValueError: abc"


def test_missing_package_says_what_to_install() -> None:
    says = "^mujoco is not installed; run `pip install bricktwin`$"
    with pytest.raises(TwinError, match=says), installed("mujoco", TwinError, "bricktwin"):
        raise ImportError
    with pytest.raises(ZeroDivisionError), installed("mujoco", TwinError, "bricktwin"):
        raise ZeroDivisionError
    with installed("mujoco", TwinError, "bricktwin"):
        pass


def test_reasons_that_last_until_a_person_acts() -> None:
    passing = [reason for reason in Reason if not reason.is_lasting]
    assert passing == [Reason.NOT_FOUND, Reason.UNKNOWN]


def test_reason_of_an_error() -> None:
    assert MediumUnavailableError("x").reason is Reason.UNKNOWN
    switched_off = BluetoothUnavailableError("x", Reason.SWITCHED_OFF)
    assert (str(switched_off), switched_off.reason) == ("x", Reason.SWITCHED_OFF)
    assert HubNotFoundError.reason is Reason.NOT_FOUND
    assert errors.AmbiguousHubError.reason is Reason.SEVERAL
    assert errors.HubTakenError.reason is Reason.TAKEN


def test_write_error_is_its_message_alone() -> None:
    assert str(WriteError("a.csv cannot be written; name another place")) == (
        "a.csv cannot be written; name another place"
    )
