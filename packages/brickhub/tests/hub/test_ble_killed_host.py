"""A killed host process (``kill -9``) over Bluetooth; see also ``fault_course.py``."""

from __future__ import annotations

import time

import pytest
from ble_world import World
from host_process import START_S, host_process
from radio import SUPERVISION_TIMEOUT_S

from brickhub.hub.program import generate
from brickhub.hub.program.generate import WATCHDOG_MS
from brickhub.hub.transports.profile import PybricksCommand

pytestmark = pytest.mark.realtime

LIVES_S = 0.7
"""Longer than the watchdog."""


@pytest.mark.parametrize(
    ("step_ms", "says_good_bye"),
    [(2000, True), (10, False)],
    ids=["process in mid-step", "computer"],
)
def test_killed_host_stops_motors_and_new_host_connects(
    world: World, step_ms: int, says_good_bye: bool
) -> None:
    world.set_interval(15.0)
    hub = world.hub
    with host_process(world, step_ms, says_good_bye=says_good_bye) as first:
        hub.wait_until("is_driven", True, START_S)
        time.sleep(LIVES_S)
        assert hub.is_driven and first.poll() is None
        first.kill()
        killed_s = time.monotonic()
    hub.wait_until("is_driven", False, 2.0)
    bound_s = SUPERVISION_TIMEOUT_S + (WATCHDOG_MS + generate.END_MS) / 1000 + 0.5
    hub.wait_until("is_advertising", True, bound_s)
    assert time.monotonic() - killed_s < bound_s
    with host_process(world, step_ms):
        hub.wait_until("is_driven", True, START_S)
        assert hub.runs == 2 and hub.commands.count(PybricksCommand.WRITE_USER_PROGRAM_META) == 2, (
            "it has kept its program"
        )
    assert hub.longest_silent_drive_ms <= WATCHDOG_MS
    hub.wait_until("is_driven", False, 2.0)
