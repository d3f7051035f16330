"""Bluetooth faults: bounded time, our errors, stopped motors, recovery."""

from __future__ import annotations

import itertools
import logging
import time
from collections.abc import Callable

import pytest
from ble_world import BOUND_S, NAME, World, bounded
from radio import ATT_NOTIFICATION, ATT_WRITE_REQUEST, ATT_WRITE_RESPONSE, SUPERVISION_TIMEOUT_S

from brickhub.errors import (
    HubBusyError,
    HubDisconnectedError,
    HubNotFoundError,
    HubProtocolError,
    HubRefusedError,
    HubTimeoutError,
)
from brickhub.hub.link.lockstep import LinkState
from brickhub.hub.program.generate import WATCHDOG_MS
from brickhub.hub.transports.profile import CommandError, Event, PybricksCommand, Status

pytestmark = pytest.mark.realtime

WATCHDOG_S = WATCHDOG_MS / 1000


def drop_when(
    world: World, kind: PybricksCommand, count: int = 1, drop: Callable[[], None] | None = None
) -> None:
    """Break the link at the count-th command of a kind; subscribing counts as a first START."""
    seen = itertools.count(1)

    def rule(opcode: int, data: bytes) -> int:
        if (
            opcode == ATT_WRITE_REQUEST
            and len(data) > 3
            and data[3] == kind
            and next(seen) == count
        ):
            (drop or world.radio.disconnect)()
            return 0
        return 1

    world.fault(rule)


@pytest.mark.parametrize(
    ("kind", "count"),
    [
        (PybricksCommand.WRITE_USER_PROGRAM_META, 1),
        (PybricksCommand.WRITE_USER_RAM, 3),
        (PybricksCommand.START_USER_PROGRAM, 2),
    ],
)
def test_disconnect_during_download(world: World, kind: PybricksCommand, count: int) -> None:
    drop_when(world, kind, count)
    link = world.link()
    bounded(link.open, HubDisconnectedError)
    world.fault(None)
    link.open()
    link.act([100])


def test_disconnect_while_connecting_is_retried(world: World) -> None:
    attempts = itertools.count(1)

    def rule(opcode: int, data: bytes) -> int:
        if opcode == 0x0A and next(attempts) == 2:  # the second value that is read
            world.radio.disconnect()
            return 0
        return 1

    world.fault(rule)
    with world.link() as link:
        link.act([100])


def test_disconnect_in_step_and_reset(world: World) -> None:
    link = world.link()
    for exchange in (lambda: link.act([3000]), link.read):
        link.open()
        link.act([3000])
        drop_when(world, PybricksCommand.WRITE_STDIN)
        bounded(exchange, HubDisconnectedError)
        assert link.state is LinkState.FAULT
        world.hub.wait_until("is_running", False)
        assert not world.hub.is_driven
        world.fault(None)
    link.open()
    assert len(link.read().values) == 2


def test_disconnect_while_closing(world: World) -> None:
    link = world.link()
    link.open()
    drop_when(world, PybricksCommand.STOP_USER_PROGRAM)
    start_s = time.monotonic()
    link.close()
    assert time.monotonic() - start_s < BOUND_S
    world.hub.wait_until("is_running", False)


def test_hub_out_of_reach_stops_and_returns(world: World) -> None:
    link = world.link(timeout_s=5.0)
    link.open()
    link.act([3000])
    world.radio.leave()
    left_s = time.monotonic()
    assert world.hub.wait_until("is_driven", False) < WATCHDOG_S + 0.1
    assert world.hub.is_running
    bounded(lambda: link.act([3000]), HubDisconnectedError, SUPERVISION_TIMEOUT_S + 1.0)
    assert not world.hub.is_driven, "the command must not have arrived"
    world.hub.wait_until("is_running", False)
    world.radio.come_back()
    link.open()
    link.act([100])
    assert time.monotonic() - left_s < 15
    assert world.hub.commands.count(PybricksCommand.WRITE_USER_PROGRAM_META) == 2, (
        "the hub has kept its program"
    )


def test_hub_out_of_reach_is_not_found(world: World) -> None:
    world.radio.leave()
    error = bounded(world.transport(timeout_s=0.5).open, HubNotFoundError)
    assert NAME in str(error) and "switch it on" in str(error)


def test_hub_with_running_program_is_found_after_its_end(world: World) -> None:
    first = world.link()
    first.open()
    world.radio.disconnect()
    second = world.link(timeout_s=5.0)
    second.open()
    second.act([100])


def test_hub_kept_connected_by_system(world: World) -> None:
    """Some systems keep the connection of a killed program, so the hub does not advertise."""
    world.radio.run(world.radio.central.connect(world.hub.address))
    world.hub.wait_until("is_connected", True)
    with world.link(name=None) as link:
        link.act([100])


def test_hub_reboot(world: World) -> None:
    link = world.link()
    link.open()
    world.hub.reboot()
    bounded(lambda: link.act([100]), HubDisconnectedError)
    link.open()
    link.act([100])
    assert world.hub.commands.count(PybricksCommand.WRITE_USER_PROGRAM_META) == 4


def test_lost_and_duplicated_notifications(world: World) -> None:
    count = itertools.count()

    def rule(opcode: int, data: bytes) -> int:
        if opcode == ATT_NOTIFICATION and data[3] == Event.WRITE_STDOUT:
            return (1, 1, 2, 1, 0)[next(count) % 5]
        return 1

    with world.link() as link:
        world.fault(rule)
        turned = [link.read().hub_time_ms for _ in range(15)]
        assert turned == sorted(turned) and len(set(turned)) == 15
        assert link.statistics.resends > 0 and link.statistics.stale_answers > 0


def test_full_input_buffer_is_retried(world: World) -> None:
    with world.link() as link:
        world.hub.faults[PybricksCommand.WRITE_STDIN] = [CommandError.BUSY] * 3
        link.act([100])
        assert link.statistics.resends == 0
        world.hub.faults[PybricksCommand.WRITE_STDIN] = [CommandError.BUSY] * 1000
        bounded(lambda: link.act([100]), HubBusyError)


def test_refused_hub_command(world: World) -> None:
    world.hub.faults[PybricksCommand.WRITE_USER_RAM] = [CommandError.INVALID_COMMAND]
    error = bounded(world.link().open, HubRefusedError)
    assert "0x80, invalid command" in str(error)


@pytest.mark.parametrize("lost", [ATT_WRITE_REQUEST, ATT_WRITE_RESPONSE])
def test_unacknowledged_write(world: World, lost: int) -> None:
    link = world.link()
    link.open()
    link.act([3000])
    world.fault(lambda opcode, data: int(opcode != lost))
    bounded(lambda: link.act([3000]), HubTimeoutError)
    world.hub.wait_until("is_running", False)
    assert not world.hub.is_driven
    world.fault(None)
    link.open()
    link.act([100])


def test_program_that_does_not_stop(world: World) -> None:
    transport = world.transport()
    transport.open()
    transport.start(world.link().program)
    world.fault(
        lambda opcode, data: int(
            not (opcode == ATT_NOTIFICATION and data[3] == Event.STATUS_REPORT)
        )
    )
    assert "press the hub's button" in str(bounded(transport.stop, HubTimeoutError))


def test_battery_and_shutdown(world: World, caplog: pytest.LogCaptureFixture) -> None:
    transport = world.transport()
    transport.open()
    with caplog.at_level(logging.WARNING):
        world.hub.battery = Status.BATTERY_LOW
        time.sleep(1.2)
    assert [record.message for record in caplog.records].count(
        "the hub's battery is low; charge it soon"
    ) == 1
    assert transport.status is not None and Status.BATTERY_LOW in transport.status.flags
    world.hub.battery = Status.SHUTDOWN
    time.sleep(0.6)
    assert "switching off" in str(bounded(lambda: transport.read(1.0), HubDisconnectedError))


def test_old_firmware(world: World) -> None:
    world.hub.profile_version = "1.2.0"
    assert "1.2" in str(bounded(world.transport().open, HubProtocolError))
