"""Streaming, AppData and smaller hubs over the simulated radio."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from ble_world import BOUND_S, World, bounded
from described import SPINNING
from radio import SUPERVISION_TIMEOUT_S

from brickhub.errors import HubBusyError, HubDisconnectedError
from brickhub.hub.interface import Interface, MotorAngle, RunAngle, Wait
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.streaming import StreamingLink
from brickhub.hub.program.generate import WATCHDOG_MS
from brickhub.hub.transport import HubProgram, Pipe
from brickhub.hub.transports.profile import PybricksCommand
from brickhub.robot import HubKind, Motor, Robot

pytestmark = pytest.mark.realtime

STEP_S = 0.1
TURN = Interface((RunAngle("wheel", -3000, 3000, 400),), (MotorAngle("wheel"),), Wait(100))
WITHOUT_IMU = [HubKind.TECHNIC, HubKind.CITY, HubKind.ESSENTIAL]


def streaming(
    world: World, interface: Interface = SPINNING, pipe: Pipe = Pipe.STDIN
) -> StreamingLink:
    link = StreamingLink(world.transport(), world.robot, interface, timeout_s=1.0, pipe=pipe)
    world.hub.library.append(link.program.source)
    return link


@pytest.mark.parametrize("interval_ms", [15.0, 45.0])
def test_observations_are_periodic_and_fresh(world: World, interval_ms: float) -> None:
    world.set_interval(interval_ms)
    with streaming(world) as link:
        link.act([10, 10])
        start_s = time.monotonic()
        ages_s = [link.act([50, 50]).age_s for _ in range(10)]
        assert time.monotonic() - start_s == pytest.approx(10 * STEP_S, abs=0.08)
        assert 0 < sorted(ages_s)[5] < 0.010 + 2 * interval_ms / 1000 + 0.01
    assert not world.hub.is_running


def test_streaming_over_app_data(world: World) -> None:
    with streaming(world, pipe=Pipe.APP_DATA) as link:
        angles = [link.act([50, 0]).values[0] for _ in range(5)]
        assert len(set(angles)) == 5
        assert len(link.read().values) == 5
    assert world.hub.commands.count(PybricksCommand.WRITE_STDIN) == 0


def test_lock_step_over_app_data(world: World) -> None:
    link = HubLink(world.transport(), world.robot, SPINNING, timeout_s=1.0, pipe=Pipe.APP_DATA)
    world.hub.library.append(link.program.source)
    with link:
        for _ in range(10):
            link.act([30, -30])
        assert link.statistics.resends == 0
    assert world.hub.commands.count(PybricksCommand.WRITE_APP_DATA) >= 10


def test_streaming_hub_out_of_reach_stops(world: World) -> None:
    """A small output buffer makes the program wait until the hub notices the lost link."""
    link = streaming(
        world, Interface((RunAngle("left", -3000, 3000, 400),), (MotorAngle("left"),), Wait(50))
    )
    link.open()
    link.act([3000])
    world.radio.leave()
    assert (
        world.hub.wait_until("is_driven", False)
        < max(WATCHDOG_MS / 1000, SUPERVISION_TIMEOUT_S) + 0.1
    )
    bounded(lambda: [link.act([3000]) for _ in range(20)], HubDisconnectedError)
    world.hub.wait_until("is_running", False)
    world.radio.come_back()
    link.open()
    link.act([100])


def test_lockstep_age_is_return_delay(world: World) -> None:
    world.set_interval(30.0)
    with world.link(SPINNING) as link:
        link.read()
        ages_s = [link.act([10, 10]).age_s for _ in range(8)]
        assert all(0.0 <= age_s < 0.07 for age_s in ages_s) and max(ages_s) > 0.005


@pytest.mark.parametrize("kind", WITHOUT_IMU)
@pytest.mark.parametrize("pipe", list(Pipe))
def test_smaller_hubs(tmp_path: Path, kind: HubKind, pipe: Pipe) -> None:
    robot = Robot("small", kind, motors=(Motor("wheel", "A"),))
    world = World(tmp_path, robot)
    try:
        link = HubLink(world.transport(), robot, TURN, timeout_s=1.0, pipe=pipe)
        world.hub.library.append(link.program.source)
        with link:
            assert [link.act([30]).values[0] > 5 for _ in range(3)] == [True] * 3
            assert link.statistics.resends == 0
            assert link._transport.identity.kind is kind
    finally:
        world.close()


@pytest.mark.parametrize("kind", [*WITHOUT_IMU, HubKind.PRIME])
def test_hub_refuses_oversized_write(tmp_path: Path, kind: HubKind) -> None:
    world = World(tmp_path, Robot("small", kind))
    deaf = (
        "from pybricks.tools import wait\nfrom micropython import kbd_intr\nkbd_intr(-1)\n"
        "wait(5000)\n"
    )
    world.hub.library.append(deaf)
    try:
        transport = world.transport()
        transport.open()
        transport.start(HubProgram(deaf, 1))
        fits, size = divmod(kind.model.stdin_bytes, 20)
        for _ in range(fits):
            transport.write(bytes(20))
        transport.write(bytes(size))
        bounded(lambda: transport.write(b"x"), HubBusyError, BOUND_S)
    finally:
        world.close()
