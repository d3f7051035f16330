"""Generated programs of all robot tasks, with link, hub, firmware and unloaded motors."""

from __future__ import annotations

import random

import pytest
from bench_arm import BenchArm
from described import ROBO_ARM, RUN_AWAY, TASKS, TWO_WHEELER

from brickhub.errors import HubError
from brickhub.hub.link.lockstep import HubLink, LinkState
from brickhub.hub.link.profiles import LinkProfile
from brickhub.virtual import virtual_transport as transport
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.machine import Pace
from brickhub.virtual.virtual_transport import VirtualHub

ON_A_ROBOT = ("RunAway-v0", "Spinning-v0", "Walker-v0", "RoboArm-v0")


def connected(env_id: str) -> tuple[HubLink, VirtualHub]:
    robot, interface = TASKS[env_id]
    hub = VirtualHub(BenchArm() if robot is ROBO_ARM else BenchBody(robot), link=LinkProfile(15.0))
    link = HubLink(hub, robot, interface)
    link.open()
    return link, hub


@pytest.mark.parametrize("env_id", ON_A_ROBOT)
def test_reading_moves_nothing(env_id: str) -> None:
    link, hub = connected(env_id)
    ports = [motor.port for motor in hub.robot.motors]
    before = [hub.body.angle_mdeg(port) for port in ports]
    for _ in range(5):
        reading = link.read()
    assert len(reading.values) == len(TASKS[env_id][1].channels)
    assert [hub.body.angle_mdeg(port) for port in ports] == before
    assert link.state is LinkState.READY


@pytest.mark.parametrize("env_id", ON_A_ROBOT)
def test_step_takes_move_and_two_intervals(env_id: str) -> None:
    link, hub = connected(env_id)
    interface = TASKS[env_id][1]
    link.read()
    reading = link.act([command.low for command in interface.commands])
    settle_s = {"RunAway-v0": 0.795, "Spinning-v0": 0.1, "Walker-v0": 0.25, "RoboArm-v0": 0.25}[
        env_id
    ]
    assert reading.round_trip_s == pytest.approx(settle_s + 0.030, abs=0.02)
    assert hub.now_s() > settle_s


def test_overlapping_commands_equal_firmware() -> None:
    link, hub = connected("Walker-v0")
    link.read()
    angles = []
    for _ in range(8):
        link.act([-100, -100, -100, -100])
        angles.append(-hub.machine.servos["C"].angle_deg())
    steps = [after - before for before, after in zip(angles, angles[1:], strict=False)]
    # facts/twin.md: 60 degrees in the first step, 88 in each that follows, every 250 ms; here a
    # step takes 270 ms
    assert 55 <= angles[0] <= 70
    assert sum(steps[2:]) / len(steps[2:]) == pytest.approx(90, abs=5)


def test_joint_stays_in_range() -> None:
    link, _ = connected("RoboArm-v0")
    link.read()
    for _ in range(15):
        reading = link.act([100, 30, 60, 25])
    low, high, grab = reading.values[1:]
    assert 60 <= low <= 70 and 0 <= high <= 10 and -55 <= grab <= -45, (
        "content near the end of its range; nothing pulls at it"
    )


def test_silent_host_stops_then_reading_restarts() -> None:
    link, hub = connected("Spinning-v0")
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
    link, hub = connected("Spinning-v0")
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
