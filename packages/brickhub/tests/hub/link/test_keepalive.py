"""Keepalive frames."""

from __future__ import annotations

import itertools
import math

import pytest
from described import RUN_AWAY, SPINNING, TWO_WHEELER, WALKER, WALKING
from hypothesis import given
from hypothesis import strategies as st
from stand_in import StandInHub

from brickhub.errors import HubError, SilentHubError
from brickhub.hub.interface import Interface
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.states import LinkState
from brickhub.hub.link.timing import repeat_times_s
from brickhub.hub.program.generate import WATCHDOG_MS
from brickhub.hub.protocol import Down
from brickhub.robot import Robot

WATCHDOG_S = WATCHDOG_MS / 1000


@given(st.none() | st.floats(0.0, 10.0), st.floats(0.05, 2.0))
def test_frame_is_repeated_as_keepalive_and_when_overdue(
    move_s: float | None, watchdog_s: float
) -> None:
    times_s = list(
        itertools.takewhile(lambda time_s: time_s < 12.0, repeat_times_s(move_s, watchdog_s))
    )
    pauses_s = [after - before for before, after in itertools.pairwise([0.0, *times_s])]
    due_s = math.inf if move_s is None else move_s
    is_short = due_s < watchdog_s
    for pause_s, time_s in zip(pauses_s, times_s, strict=True):
        if time_s < due_s:
            assert pause_s <= 1.0001 * watchdog_s / (2 if is_short else 6), (
                "four in a row may get lost"
            )
        else:
            assert time_s >= due_s + 0.4999 * watchdog_s, "the answer is on its way"
            assert pause_s <= 1.0001 * watchdog_s


def repeated(hub: StandInHub) -> tuple[int, int]:
    """Number of data frames, and of those that tell the watchdog's time."""
    data = sum(write[1] != 0 for write in hub.writes)
    return data, sum(write[1] == 0 and write[2] == Down.WATCHDOG for write in hub.writes)


@pytest.mark.parametrize(
    ("robot", "interface", "values", "count"),
    [
        (TWO_WHEELER, SPINNING, [30, 30], (1, 0)),
        (WALKER, WALKING, [-30] * 4, (2, 0)),
        (TWO_WHEELER, RUN_AWAY, [90], (2, 5)),
    ],
)
def test_keepalive_lets_long_step_finish(
    robot: Robot, interface: Interface, values: list[float], count: tuple[int, int]
) -> None:
    hub = StandInHub()
    with HubLink(hub, robot, interface) as link:
        for _ in range(3):
            link.act(values)
        assert repeated(hub) == (3 * count[0], 3 * count[1]) and hub.starts == 1
        assert (link.statistics.resends, link.statistics.stale_answers) == (0, 0)


def test_lost_keepalives_abort_step() -> None:
    hub = StandInHub()
    link = HubLink(hub, TWO_WHEELER, RUN_AWAY)
    link.open()
    hub.motors["A"].blocked = True
    sent = itertools.count()
    hub.down = lambda data: data if next(sent) == 0 else b""
    with pytest.raises(SilentHubError):
        link.act([90])
    assert (
        link.state is LinkState.FAULT
        and not hub.running
        and not any(motor.moving for motor in hub.motors.values())
    )
    with pytest.raises(HubError, match="open"):
        link.act([90])
    hub.down = lambda data: data
    link.open()
    link.act([90])
