"""The Bluetooth transport against a played hub, over a link that delivers at connection events."""

from __future__ import annotations

import itertools
import logging
import statistics
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from played_hub import PlayedHub
from radio import ATT_NOTIFICATION, ATT_WRITE_REQUEST, ATT_WRITE_RESPONSE, SUPERVISION_TIMEOUT_S, Radio
from stand_in import SPINNING, WALKER_INTERFACE

from bricksrl.errors import HubError, HubProgramError, HubProtocolError, HubTimeoutError
from bricksrl.hub import program as hub_program
from bricksrl.hub.ble import BleTransport
from bricksrl.hub.failures import AmbiguousHubError, HubBusyError, HubDisconnectedError, HubNotFoundError, HubRefusedError
from bricksrl.hub.interface import Interface, MotorAngle, RunAngle, Wait
from bricksrl.hub.link import HubLink, LinkState
from bricksrl.hub.pybricks_profile import Command, CommandError, Event, Status
from bricksrl.hub.scan import scan
from bricksrl.hub.transport import HubProgram
from bricksrl.robots import TWO_WHEELER, WALKER, HubKind, Robot

NAME = "Pybricks Hub"
LONG_RUN = Interface(
    commands=(RunAngle("left", -3000, 3000, 400),), channels=(MotorAngle("left"), MotorAngle("right")), settle=Wait(10)
)
"""A motor that goes on turning for seconds after the answer."""
WATCHDOG_S = hub_program.WATCHDOG_MS / 1000
BOUND_S = 3.0
"""No call may take longer, with the bounds that the tests set."""


class World:
    """A hub, its air, and links to it."""

    def __init__(self, folder: Path, robot: Robot = TWO_WHEELER, interval_ms: float = 7.5) -> None:
        self.radio = Radio()
        self.robot = robot
        self.hub = PlayedHub(self.radio, robot, NAME)
        self.record = folder / "programs.json"
        self._interval_ms = interval_ms
        self._open: list[BleTransport] = []
        self.set_interval(interval_ms)

    def set_interval(self, interval_ms: float) -> None:
        self.radio.call(lambda: setattr(self.radio.link, "interval_ms", interval_ms))

    def transport(self, **options: Any) -> BleTransport:
        settings: dict[str, Any] = {"name": NAME, "timeout_s": 2.0, "answer_timeout_s": 0.6, "record": self.record}
        transport = BleTransport(backend=self.radio.backend(), **(settings | options))
        self._open.append(transport)
        return transport

    def link(self, interface: Interface = LONG_RUN, **options: Any) -> HubLink:
        link = HubLink(self.transport(**options), self.robot, interface, timeout_s=1.0)
        self.hub.library.append(link.program.source)
        return link

    def fault(self, rule: Callable[[int, bytes], int] | None) -> None:
        self.radio.call(lambda: setattr(self.radio.link, "fault", rule or (lambda opcode, data: 1)))

    def close(self) -> None:
        self.fault(None)
        for transport in self._open:
            transport.close()
        self.hub.close()
        self.radio.close()


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    monkeypatch.setattr(hub_program, "END_MS", 500)
    made = World(tmp_path)
    yield made
    made.close()


def bounded(call: Callable[[], object], error: type[HubError], bound_s: float = BOUND_S) -> HubError:
    """The error that a call raises, within the bound."""
    start_s = time.monotonic()
    with pytest.raises(error) as caught:
        call()
    assert time.monotonic() - start_s < bound_s
    assert "\n" not in str(caught.value) and ";" in str(caught.value), "one line: what happened; what to do"
    return caught.value


# ---- what it is for


def test_it_connects_downloads_and_exchanges(world: World) -> None:
    transport = world.transport()
    transport.open()
    identity = transport.identity
    assert identity is not None and (identity.name, identity.kind) == (NAME, HubKind.PRIME)
    assert identity.firmware == "4.0.1" and identity.profile_version == (1, 5) and identity.capabilities.slots == 5
    transport.close()
    with world.link(SPINNING) as link:
        left, right = link.act([90, -45]).values[:2]
        assert 0 < left < 90 and 315 < right < 360
        time.sleep(0.3)
        np.testing.assert_allclose(link.read().values[:2], [90, 315], atol=3)
        assert world.hub.is_running
    assert not world.hub.is_running and not world.hub.is_connected


def test_an_exchange_takes_two_connection_intervals(tmp_path: Path) -> None:
    world = World(tmp_path, WALKER)
    try:
        with world.link(WALKER_INTERFACE) as link:
            assert link.wire.up_frame_bytes == 19
            for interval_ms, exchanges in ((7.5, 60), (15.0, 40), (30.0, 20), (45.0, 12)):
                world.set_interval(interval_ms)
                link.read()
                took_ms = statistics.median(link.read().round_trip_s for _ in range(exchanges)) * 1000
                assert took_ms == pytest.approx(2 * interval_ms, abs=2.0)
    finally:
        world.close()


def test_the_same_program_is_not_downloaded_again(world: World) -> None:
    for _ in range(2):
        with world.link() as link:
            link.act([100])
    assert world.hub.commands.count(Command.WRITE_USER_PROGRAM_META) == 2  # one download
    with world.link(SPINNING) as link:
        link.act([10, 10])
    assert world.hub.commands.count(Command.WRITE_USER_PROGRAM_META) == 4


def test_a_hub_that_lost_its_program_gets_it_again(world: World) -> None:
    with world.link():
        pass
    world.hub.size = 0
    with world.link() as link:
        link.act([100])
    assert world.hub.commands.count(Command.WRITE_USER_PROGRAM_META) == 4


def test_another_program_in_its_place_is_stopped_and_replaced(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bricksrl.hub.ble._HELLO_S", 0.3)
    link = world.link()
    other = "from pybricks.tools import wait\nprint('mine')\nwhile True:\n    wait(10)\n"
    world.hub.library.append(other)
    transport = world.transport()
    transport.open()
    transport.start(HubProgram(other, link.program.hash))  # this computer believes that it is ours
    transport.close()
    with link:
        link.act([100])


def test_an_unknown_program_is_never_started(world: World) -> None:
    other = "from usys import stdout\nstdout.write('moving')\n"
    world.hub.library.append(other)
    transport = world.transport()
    transport.open()
    transport.start(HubProgram(other, 1))
    transport.close()
    world.record.unlink()
    world.hub.commands.clear()
    with world.link():
        kinds = world.hub.commands
        assert kinds.index(Command.WRITE_USER_RAM) < kinds.index(Command.START_USER_PROGRAM)


def test_all_writes_wait_for_their_response(world: World) -> None:
    seen = set[int]()

    def watch(opcode: int, data: bytes) -> int:
        seen.add(opcode)
        return 1

    world.fault(watch)
    with world.link() as link:
        link.act([100])
    assert ATT_WRITE_REQUEST in seen and 0x52 not in seen  # 0x52: write without response, which hubs drop


# ---- the program


@pytest.mark.parametrize("flushes_late", [False, True])
def test_a_program_that_raises_at_its_start(world: World, flushes_late: bool) -> None:
    world.hub.flushes_late = flushes_late
    world.hub.body.motors.pop("A")
    world.hub.machine.servos.pop("A")
    error = bounded(world.link().open, HubProgramError)
    assert "ENODEV" in str(error) and "Motor(Port.A" in str(error) and "plug the device" in str(error)


def test_a_program_that_raises_later(world: World) -> None:
    transport = world.transport()
    source = "from usys import stdin\nfrom pybricks.tools import wait\nprint('ready')\nstdin.buffer.read(1)\nwait(50)\n1 // 0\n"
    world.hub.library.append(source)
    transport.open()
    transport.start(HubProgram(source, 7))
    assert transport.read(1.0) == b"ready\r\n"
    transport.write(b"x")
    text = b"".join(iter(lambda: transport.read(1.0), b""))
    assert b"line 6" in text and text.endswith(b"ZeroDivisionError: divide by zero\r\n")
    assert "has ended" in str(bounded(lambda: transport.read(1.0), HubError))
    bounded(lambda: transport.write(b"x"), HubError)


def test_the_button_ends_the_program(world: World) -> None:
    link = world.link()
    link.open()
    world.hub.press_button()
    world.hub.wait_until("is_running", False)
    bounded(lambda: link.act([100]), HubError)
    assert link.state is LinkState.FAULT
    link.open()
    link.act([100])


def test_stop_from_another_thread_while_a_move_is_under_way(world: World) -> None:
    link = world.link()
    link.open()
    link.act([3000])
    assert world.hub.is_driven
    start_s = time.monotonic()
    thread = threading.Thread(target=link.stop)
    thread.start()
    world.hub.wait_until("is_driven", False)
    assert time.monotonic() - start_s < 0.1
    thread.join(BOUND_S)
    assert not thread.is_alive() and not world.hub.is_running


# ---- what goes wrong


def drop_when(world: World, kind: Command, count: int = 1, drop: Callable[[], None] | None = None) -> None:
    """Break the link at the count-th command of a kind. Subscribing to notifications looks like a first START."""
    seen = itertools.count(1)

    def rule(opcode: int, data: bytes) -> int:
        if opcode == ATT_WRITE_REQUEST and len(data) > 3 and data[3] == kind and next(seen) == count:
            (drop or world.radio.disconnect)()
            return 0
        return 1

    world.fault(rule)


@pytest.mark.parametrize(
    ("kind", "count"), [(Command.WRITE_USER_PROGRAM_META, 1), (Command.WRITE_USER_RAM, 3), (Command.START_USER_PROGRAM, 2)]
)
def test_a_disconnection_while_the_program_is_brought(world: World, kind: Command, count: int) -> None:
    drop_when(world, kind, count)
    link = world.link()
    bounded(link.open, HubDisconnectedError)
    world.fault(None)
    link.open()
    link.act([100])


def test_a_disconnection_while_connecting_is_tried_again(world: World) -> None:
    attempts = itertools.count(1)

    def rule(opcode: int, data: bytes) -> int:
        if opcode == 0x0A and next(attempts) == 2:  # the second value that is read
            world.radio.disconnect()
            return 0
        return 1

    world.fault(rule)
    with world.link() as link:
        link.act([100])


def test_a_disconnection_in_a_step_and_in_a_reset(world: World) -> None:
    link = world.link()
    for exchange in (lambda: link.act([3000]), link.read):
        link.open()
        link.act([3000])
        drop_when(world, Command.WRITE_STDIN)
        bounded(exchange, HubDisconnectedError)
        assert link.state is LinkState.FAULT
        world.hub.wait_until("is_running", False)
        assert not world.hub.is_driven
        world.fault(None)
    link.open()
    assert link.read().values.shape == (2,)


def test_a_disconnection_while_closing(world: World) -> None:
    link = world.link()
    link.open()
    drop_when(world, Command.STOP_USER_PROGRAM)
    start_s = time.monotonic()
    link.close()
    assert time.monotonic() - start_s < BOUND_S
    world.hub.wait_until("is_running", False)


def test_a_hub_out_of_reach_stops_its_motors_and_comes_back(world: World) -> None:
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
    assert world.hub.commands.count(Command.WRITE_USER_PROGRAM_META) == 2, "the hub has kept its program"


def test_a_hub_out_of_reach_cannot_be_found(world: World) -> None:
    world.radio.leave()
    error = bounded(world.transport(timeout_s=0.5).open, HubNotFoundError)
    assert NAME in str(error) and "switch it on" in str(error)


def test_a_hub_whose_program_runs_on_is_found_when_it_has_ended(world: World) -> None:
    first = world.link()
    first.open()
    world.radio.disconnect()
    second = world.link(timeout_s=5.0)
    second.open()
    second.act([100])


def test_a_hub_that_reboots(world: World) -> None:
    link = world.link()
    link.open()
    world.hub.reboot()
    bounded(lambda: link.act([100]), HubDisconnectedError)
    link.open()
    link.act([100])
    assert world.hub.commands.count(Command.WRITE_USER_PROGRAM_META) == 4


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


def test_a_full_input_buffer_is_tried_again(world: World) -> None:
    with world.link() as link:
        world.hub.faults[Command.WRITE_STDIN] = [CommandError.BUSY] * 3
        link.act([100])
        assert link.statistics.resends == 0
        world.hub.faults[Command.WRITE_STDIN] = [CommandError.BUSY] * 1000
        bounded(lambda: link.act([100]), HubBusyError)


def test_a_command_that_the_hub_refuses(world: World) -> None:
    world.hub.faults[Command.WRITE_USER_RAM] = [CommandError.INVALID_COMMAND]
    error = bounded(world.link().open, HubRefusedError)
    assert "0x80, invalid command" in str(error)


@pytest.mark.parametrize("lost", [ATT_WRITE_REQUEST, ATT_WRITE_RESPONSE])
def test_a_write_that_is_never_acknowledged(world: World, lost: int) -> None:
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


def test_a_program_that_does_not_stop(world: World) -> None:
    transport = world.transport()
    transport.open()
    transport.start(world.link().program)
    world.fault(lambda opcode, data: int(not (opcode == ATT_NOTIFICATION and data[3] == Event.STATUS_REPORT)))
    assert "press the hub's button" in str(bounded(transport.stop, HubTimeoutError))


def test_battery_and_shutdown(world: World, caplog: pytest.LogCaptureFixture) -> None:
    transport = world.transport()
    transport.open()
    with caplog.at_level(logging.WARNING):
        world.hub.battery = Status.BATTERY_LOW
        time.sleep(1.2)
    assert [record.message for record in caplog.records].count("the hub's battery is low; charge it soon") == 1
    assert transport.status is not None and Status.BATTERY_LOW in transport.status.flags
    world.hub.battery = Status.SHUTDOWN
    time.sleep(0.6)
    assert "switching off" in str(bounded(lambda: transport.read(1.0), HubDisconnectedError))


def test_old_firmware(world: World) -> None:
    world.hub.profile_version = "1.2.0"
    assert "1.2" in str(bounded(world.transport().open, HubProtocolError))


# ---- several hubs, and none


def test_several_hubs(world: World) -> None:
    other = PlayedHub(world.radio, WALKER, "Rover", "C0:01:02:03:04:06")
    found = scan(0.3, backend=world.radio.backend())
    assert {(hub.name, hub.address) for hub in found} == {(NAME, "C0:01:02:03:04:05"), ("Rover", "C0:01:02:03:04:06")}
    error = bounded(world.transport(name=None).open, AmbiguousHubError)
    assert "Rover" in str(error) and NAME in str(error)
    bounded(world.transport(name="Rovre", timeout_s=0.5).open, HubNotFoundError)
    for wanted in ({"name": "Rover"}, {"name": None, "address": "c0:01:02:03:04:06"}):
        transport = world.transport(**wanted)
        transport.open()
        assert other.is_connected and not world.hub.is_connected
        transport.close()
        other.wait_until("is_connected", False)


def test_the_only_hub_needs_no_name(world: World) -> None:
    world.transport(name=None).open()
    assert world.hub.is_connected


def test_without_bluetooth(tmp_path: Path) -> None:
    """Whatever this computer has, there is no such hub."""
    transport = BleTransport(name="no such hub", timeout_s=0.5, record=tmp_path / "programs.json")
    bounded(transport.open, HubError, 10.0)
    transport.close()


# ---- opening and closing


def test_close_in_any_state_leaves_nothing_behind(world: World) -> None:
    before = set(threading.enumerate())
    transport = world.transport()
    transport.close()
    transport.open()
    transport.close()
    transport.close()
    assert not {thread.name for thread in set(threading.enumerate()) - before}
    for call in (lambda: transport.read(0.1), lambda: transport.write(b"x")):
        bounded(call, HubDisconnectedError)
    transport.stop()
    transport.start(world.link().program)
    assert world.hub.is_running
    transport.close()
    assert not world.hub.is_running


def test_closing_while_another_thread_reads(world: World) -> None:
    transport = world.transport()
    transport.open()
    transport.start(world.link().program)
    transport.read(1.0)
    errors: list[HubError] = []

    def read() -> None:
        errors.append(bounded(lambda: [transport.read(BOUND_S) for _ in range(4)], HubError))

    thread = threading.Thread(target=read)
    thread.start()
    time.sleep(0.1)
    transport.close()
    thread.join(BOUND_S)
    assert not thread.is_alive() and errors


def test_a_write_holds_at_most_twenty_bytes(world: World) -> None:
    transport = world.transport()
    transport.open()
    bounded(lambda: transport.write(bytes(21)), HubError)
