"""Streaming link: steps of a fixed rate, fresh observations, commands that were lost."""

from __future__ import annotations

import pytest
from described import RUN_AWAY, SPINNING, TWO_WHEELER

from brickhub.errors import DescriptionError, HubTimeoutError
from brickhub.hub.link.profiles import LinkProfile
from brickhub.hub.link.streaming import PERIOD_MS, StreamingLink
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.virtual_transport import VirtualHub

STEP_S = 0.1
INTERVAL_MS = 15.0


class DroppingHub(VirtualHub):
    """A virtual hub to which the next writes do not come."""

    def __init__(self) -> None:
        super().__init__(BenchBody(TWO_WHEELER), link=LinkProfile(INTERVAL_MS))
        self.drops = 0

    def write(self, data: bytes) -> None:
        if self.drops:
            self.drops -= 1
        else:
            super().write(data)


@pytest.fixture
def hub() -> DroppingHub:
    return DroppingHub()


def streamed(hub: VirtualHub, timeout_s: float = 2.0) -> StreamingLink:
    return StreamingLink(hub, TWO_WHEELER, SPINNING, timeout_s=timeout_s)


def test_steps_are_as_long_as_they_say_and_observations_fresh(hub: DroppingHub) -> None:
    with streamed(hub) as link:
        link.act([50.0, 50.0])
        before_s = link.now_s()
        readings = [link.act([50.0, 50.0]) for _ in range(10)]
        assert link.now_s() - before_s == pytest.approx(10 * STEP_S, abs=0.002)
        oldest_s = (PERIOD_MS + 2 * INTERVAL_MS + 5) / 1000
        assert all(0 < reading.age_s < oldest_s for reading in readings)
        assert link.statistics.resends == 0 and link.statistics.stale_answers == 0


def test_late_caller_begins_a_new_rhythm(hub: DroppingHub) -> None:
    with streamed(hub) as link:
        link.act([50.0, 50.0])
        hub.run_on_until(hub.machine.time_ms + 250)
        for _ in range(3):
            started_s = link.now_s()
            link.act([50.0, 50.0])
            assert link.now_s() - started_s == pytest.approx(STEP_S, abs=0.002)


@pytest.mark.parametrize("drops", [1, 2])
def test_lost_command_is_sent_again_and_counted_once(hub: DroppingHub, drops: int) -> None:
    """With the request for observations: two writes each time."""
    with streamed(hub) as link:
        for _ in range(3):
            link.act([50.0, 50.0])
        before = link.statistics.exchanges
        hub.drops = drops
        reading = link.act([-50.0, -50.0])
        assert link.statistics.resends == 1
        assert link.statistics.exchanges == before + 1
        assert reading.round_trip_s > link.statistics.watchdog_s / 3
        link.act([-50.0, -50.0])
        assert link.statistics.resends == 1


def test_hub_that_says_nothing_is_waited_for_as_long_as_was_said(hub: DroppingHub) -> None:
    with streamed(hub, timeout_s=1.0) as link:
        link.act([50.0, 50.0])
        hub.drops = 1000
        started_s = link.now_s()
        with pytest.raises(HubTimeoutError, match="the hub sent no observation"):
            link.act([-50.0, -50.0])
        assert link.now_s() - started_s == pytest.approx(1.0 + STEP_S, abs=0.05)


def test_step_without_a_fixed_time_is_refused(hub: DroppingHub) -> None:
    with pytest.raises(DescriptionError, match="cannot be streamed; omit streaming"):
        StreamingLink(hub, TWO_WHEELER, RUN_AWAY)
