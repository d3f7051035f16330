"""Reconnection: how often, with which pauses, and what gives up at once; the clock is played."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest

from brickhub.errors import (
    AmbiguousHubError,
    BluetoothUnavailableError,
    HubDisconnectedError,
    HubNotFoundError,
    Reason,
)
from bricksrl.envs.connection import Reconnect
from bricksrl.errors import CameraError


class Clock:
    """Time that passes only in pauses and tries."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.pauses_s: list[float] = []

    def wait(self, seconds: float) -> None:
        self.pauses_s.append(seconds)
        self.now_s += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    played = Clock()
    monkeypatch.setattr(time, "monotonic", lambda: played.now_s)
    return played


def failing(
    clock: Clock, times: int, takes_s: float = 0.0, error: Exception | None = None
) -> Callable[[], str]:
    """Fails so often, then answers."""
    left = [times]

    def begin() -> str:
        clock.now_s += takes_s
        left[0] -= 1
        if left[0] >= 0:
            raise error or HubDisconnectedError("gone")
        return "answer"

    return begin


def test_pauses_double_up_to_a_quarter_of_a_minute(clock: Clock) -> None:
    told: list[Exception] = []
    reconnect = Reconnect(1000.0, clock.wait, told.append)
    assert reconnect.until_answered(failing(clock, 8)) == "answer"
    assert clock.pauses_s == [0.5, 1.0, 2.0, 4.0, 8.0, 15.0, 15.0, 15.0]
    assert len(told) == 8


def test_an_answer_to_a_reset_is_no_recovery_and_one_to_a_step_is(clock: Clock) -> None:
    reconnect = Reconnect(1000.0, clock.wait)
    reconnect.until_answered(failing(clock, 2))
    reconnect.until_answered(failing(clock, 0))
    assert clock.pauses_s == [0.5, 1.0, 2.0], "the robot breaks at each step after a reset"
    reconnect.recovered()
    reconnect.until_answered(failing(clock, 1))
    assert clock.pauses_s == [0.5, 1.0, 2.0, 0.5]


def test_a_broken_step_is_tried_again_at_once(clock: Clock) -> None:
    reconnect = Reconnect(1000.0, clock.wait)
    reconnect.until_answered(failing(clock, 0))
    reconnect.failed(HubDisconnectedError("in a step"))
    assert reconnect.until_answered(failing(clock, 1)) == "answer"
    assert clock.pauses_s == [0.5]


@pytest.mark.parametrize(
    ("patience_s", "takes_s", "tries"),
    [
        (0.0, 0.0, 1),
        (0.5, 0.0, 1),
        (0.6, 0.0, 2),
        (1.6, 0.0, 3),
        # Vain tries count, as pauses do.
        (1.6, 0.1, 2),
        (1.8, 0.1, 3),
    ],
)
def test_patience_ends(clock: Clock, patience_s: float, takes_s: float, tries: int) -> None:
    told: list[Exception] = []
    reconnect = Reconnect(patience_s, clock.wait, told.append)
    with pytest.raises(HubDisconnectedError):
        reconnect.until_answered(failing(clock, 99, takes_s))
    assert len(told) == tries
    # The next one begins anew.
    with pytest.raises(HubDisconnectedError):
        reconnect.until_answered(failing(clock, 99, takes_s))
    assert len(told) == 2 * tries


def test_the_time_of_a_person_does_not_count(clock: Clock) -> None:
    reconnect = Reconnect(1.6, clock.wait)
    tries = []

    def begin() -> str:
        tries.append(clock.now_s)
        with reconnect.by_hand():
            clock.now_s += 60.0
        if len(tries) < 3:
            raise HubDisconnectedError("gone")
        return "answer"

    assert reconnect.until_answered(begin) == "answer"
    assert len(tries) == 3


LASTING = [
    BluetoothUnavailableError("off", Reason.SWITCHED_OFF),
    AmbiguousHubError("two of them"),
    CameraError("no camera"),
]
PASSING = [
    BluetoothUnavailableError("?", Reason.UNKNOWN),
    HubNotFoundError("none"),
    HubDisconnectedError("gone"),
]


@pytest.mark.parametrize("error", LASTING)
def test_what_needs_a_person_is_raised_at_once_before_the_first_answer(
    clock: Clock, error: Exception
) -> None:
    reconnect = Reconnect(1000.0, clock.wait)
    with pytest.raises(type(error)):
        reconnect.until_answered(failing(clock, 1, error=error))
    assert reconnect.until_answered(failing(clock, 0)) == "answer"
    assert not clock.pauses_s
    assert reconnect.until_answered(failing(clock, 1, error=error)) == "answer"
    assert clock.pauses_s == [0.5]


@pytest.mark.parametrize("error", PASSING)
def test_what_passes_is_tried_again_from_the_first_time_on(clock: Clock, error: Exception) -> None:
    assert Reconnect(9.0, clock.wait).until_answered(failing(clock, 1, error=error)) == "answer"
    assert clock.pauses_s == [0.5]


def test_a_final_error_is_raised_and_told_to_nobody(clock: Clock) -> None:
    told: list[Exception] = []
    reconnect = Reconnect(9.0, clock.wait, told.append)
    with pytest.raises(HubDisconnectedError):
        reconnect.until_answered(failing(clock, 1), is_final=lambda error: "gone" in str(error))
    assert not told and not clock.pauses_s
