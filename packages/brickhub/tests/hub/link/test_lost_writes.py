"""Links over each profile, with one write in ten lost: no step is cut. And their watchdogs."""

from __future__ import annotations

import random

import pytest
from described import RUN_AWAY, SPINNING, TWO_WHEELER

from brickhub.hub.interface import Interface
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.profiles import PROFILES
from brickhub.hub.link.states import LinkState
from brickhub.hub.link.streaming import StreamingLink
from brickhub.hub.transport import Pipe
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.virtual_transport import VirtualHub

SHARE = 0.1


class LossyHub(VirtualHub):
    """A virtual hub to which some writes do not come."""

    lost = 0

    def __init__(self, profile: str) -> None:
        super().__init__(BenchBody(TWO_WHEELER), link=PROFILES[profile], seed=5)
        self._loss = random.Random(6)

    def write(self, data: bytes) -> None:
        if self._loss.random() < SHARE:
            self.lost += 1
        else:
            super().write(data)


def run(link: HubLink, hub: LossyHub, interface: Interface, steps: int) -> None:
    """Random steps; each must be answered by the program that was started at first."""
    draw, spans = random.Random(7), [(command.low, command.high) for command in interface.commands]
    with link:
        times_ms = [
            link.act([draw.uniform(*span) for span in spans]).hub_time_ms for _ in range(steps)
        ]
        assert link.state is LinkState.ARMED and times_ms == sorted(times_ms)
        assert hub.lost > steps * SHARE / 2


def move_times(hub: LossyHub, steps: int) -> None:
    """Steps that end when their move has ended, some after the watchdog's time."""
    run(HubLink(hub, TWO_WHEELER, RUN_AWAY), hub, RUN_AWAY, steps)


@pytest.mark.parametrize("profile", list(PROFILES))
def test_long_steps_are_not_cut(profile: str) -> None:
    move_times(LossyHub(profile), 60)


@pytest.mark.slow
@pytest.mark.parametrize("profile", list(PROFILES))
def test_thousand_long_steps_are_not_cut(profile: str) -> None:
    move_times(LossyHub(profile), 1000)


@pytest.mark.parametrize("pipe", list(Pipe))
@pytest.mark.parametrize("kind", [HubLink, StreamingLink])
@pytest.mark.parametrize("profile", list(PROFILES))
def test_short_steps_and_streams_go_on(profile: str, kind: type[HubLink], pipe: Pipe) -> None:
    hub = LossyHub(profile)
    run(kind(hub, TWO_WHEELER, SPINNING, pipe=pipe), hub, SPINNING, 100)


@pytest.mark.parametrize("profile", list(PROFILES))
def test_watchdog_is_four_times_the_slowest_round_trips(profile: str) -> None:
    hub = VirtualHub(BenchBody(TWO_WHEELER), link=PROFILES[profile], seed=1)
    with HubLink(hub, TWO_WHEELER, SPINNING) as link:
        for _ in range(400):
            link.read()
        p99_s = sorted(link.statistics.delays_s)[-5]
        assert link.statistics.watchdog_s >= max(0.4, 4 * p99_s) * 0.95
        hub.run_on_until(hub.machine.time_ms + 11_500)  # the host falls silent
        assert link.read().hub_time_ms < 2000, "a new program"


@pytest.mark.parametrize("profile", list(PROFILES))
def test_silence_stops_the_motors(profile: str) -> None:
    hub = VirtualHub(BenchBody(TWO_WHEELER), link=PROFILES[profile], seed=1)
    with HubLink(hub, TWO_WHEELER, SPINNING) as link:
        link.act([100.0, 100.0])
        hub.run_on_until(hub.machine.time_ms + round(link.statistics.watchdog_s * 1000))
        assert not any(servo.control.is_active for servo in hub.machine.servos.values())
