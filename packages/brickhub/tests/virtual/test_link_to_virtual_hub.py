"""Generated programs of all robot tasks, with link, hub, firmware and unloaded motors."""

from __future__ import annotations

import random

import pytest
from bench_arm import BenchArm
from described import ROBO_ARM, RUN_AWAY, TASKS, TWO_WHEELER
from on_a_body import LinkContract, connected

from brickhub.errors import HubError
from brickhub.hub.link.lockstep import HubLink, LinkState
from brickhub.virtual import virtual_transport as transport
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.body import Body
from brickhub.virtual.machine import Pace
from brickhub.virtual.virtual_transport import VirtualHub


class TestLinkToTheBench(LinkContract):
    """Unloaded motors, and an arm's joints between their end stops."""

    def body_of(self, env_id: str) -> Body:
        robot, _ = TASKS[env_id]
        return BenchArm() if robot is ROBO_ARM else BenchBody(robot)


def spinning() -> tuple[HubLink, VirtualHub]:
    return connected(BenchBody(TWO_WHEELER), "Spinning-v0")


def test_silent_host_stops_then_reading_restarts() -> None:
    link, hub = spinning()
    link.read()
    for _ in range(3):
        link.act([100, 100])
    hub.run_on_until(hub.machine.time_ms + 1500)
    angle = hub.body.angle_mdeg("A")
    hub.run_on_until(hub.machine.time_ms + 1000)
    assert hub.body.angle_mdeg("A") == angle, "the watchdog has not stopped the motors"
    hub.run_on_until(hub.machine.time_ms + 15_000)
    with pytest.raises(HubError):
        hub.write(b"x")
    assert link.read().hub_time_ms < 1000


def test_close_stops_robot() -> None:
    link, hub = spinning()
    for _ in range(3):
        link.act([100, 100])
    link.close()
    hub.machine.advance(3000)
    angle = hub.body.angle_mdeg("A")
    hub.machine.advance(1000)
    assert hub.body.angle_mdeg("A") == angle
    assert link.state is LinkState.DISCONNECTED


def test_real_time_hub_restarts_after_long_gap(monkeypatch) -> None:
    clock = [0.0]

    def sleep(duration_s: float) -> None:
        clock[0] += duration_s

    monkeypatch.setattr(transport, "Pace", lambda: Pace(lambda: clock[0], sleep))
    virtual = VirtualHub(BenchBody(TWO_WHEELER), realtime=True)
    link = HubLink(virtual, TWO_WHEELER, RUN_AWAY)
    virtual.in_reach = lambda: clock[0] > 30.0
    with pytest.raises(HubError, match="out of reach"):
        link.open()
    clock[0] += 60.0
    link.open()
    virtual.reset(random.Random(0))
    assert link.read().hub_time_ms < 10_000, "the program began after the gap, not before it"
    link.act([10.0])
    link.close()
