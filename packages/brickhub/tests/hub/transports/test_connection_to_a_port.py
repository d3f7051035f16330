"""Connection to a hub over a port that a test plays: what it says, and what it makes of reports."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
from played_port import PlayedPort

from brickhub.errors import (
    HubBusyError,
    HubDisconnectedError,
    HubError,
    HubProtocolError,
    HubRefusedError,
    HubTimeoutError,
    ProgramStoppedError,
)
from brickhub.hub.transports import profile
from brickhub.hub.transports.connection import HubConnection, Output
from brickhub.hub.transports.profile import Feature, Status, StatusReport
from brickhub.robot import HubKind

LONG_S = 20.0
"""Time that nothing here takes on any computer."""
SHORT_S = 0.08
"""Time after which something is given up."""


def connected(
    test: Callable[[PlayedPort, HubConnection], Coroutine[Any, Any, None]],
    port: PlayedPort | None = None,
    answer_s: float = LONG_S,
    connect_s: float = LONG_S,
) -> None:
    """Run a test with a connection."""

    async def run() -> None:
        played = port or PlayedPort()
        connection = HubConnection(played, answer_timeout_s=answer_s, connect_timeout_s=connect_s)
        await connection.connect()
        await test(played, connection)

    asyncio.run(run())


def test_hub_says_who_it_is() -> None:
    async def test(port: PlayedPort, connection: HubConnection) -> None:
        identity = connection.identity
        assert (identity.name, identity.address) == ("Rover", "C0:01")
        assert (identity.kind, identity.firmware) == (HubKind.PRIME, "4.0.1")
        assert identity.profile_version == (1, 5)
        features = Feature.REPL | Feature.MPY_V6
        assert identity.capabilities == profile.Capabilities(20, features, 1000, 2)
        assert connection.status == StatusReport(Status(0), 1)
        assert connection.is_connected
        assert not connection.is_running
        port.report(Status.USER_PROGRAM_RUNNING)
        assert connection.is_running

    connected(test)


@pytest.mark.parametrize(
    ("version", "says"),
    [(b"1.2.9", "the hub speaks Pybricks Profile 1.2; update it on code.pybricks.com")],
)
def test_profile_that_is_too_old(version: bytes, says: str) -> None:
    port = PlayedPort()
    port.values[profile.PROFILE_VERSION_UUID] = version
    with pytest.raises(HubProtocolError, match=says):
        connected(nothing, port)
    assert port.is_closed


async def nothing(port: PlayedPort, connection: HubConnection) -> None:
    """A test that only connects."""


def test_newer_profile_is_told_and_known_ones_are_not(caplog: pytest.LogCaptureFixture) -> None:
    for version in (b"1.3.0", b"1.7.0"):
        port = PlayedPort()
        port.values[profile.PROFILE_VERSION_UUID] = version
        connected(nothing, port)
    assert caplog.messages == []
    port = PlayedPort()
    port.values[profile.PROFILE_VERSION_UUID] = b"1.8.0"
    connected(nothing, port)
    newer = "the hub speaks Pybricks Profile 1.8, newer than the known 1.7; update brickhub"
    assert caplog.messages == [newer]


def test_hub_that_does_not_answer_while_connecting() -> None:
    port = PlayedPort()
    port.is_silent = True
    with pytest.raises(HubTimeoutError, match="did not answer while connecting; switch it on"):
        connected(nothing, port, connect_s=SHORT_S)
    assert port.is_closed


def test_busy_hub_is_asked_again() -> None:
    async def test(port: PlayedPort, connection: HubConnection) -> None:
        port.fails = [HubBusyError("busy"), HubBusyError("busy")]
        await connection.command(b"\x06abc", "write to the program")
        assert port.written == [b"\x06abc"] * 3
        assert port.operations == ["write to the program"] * 3

    connected(test)


def test_hub_that_stays_busy() -> None:
    async def test(port: PlayedPort, connection: HubConnection) -> None:
        port.fails = [HubBusyError("busy")] * 100
        with pytest.raises(HubBusyError):
            await connection.command(b"\x06", "write")
        # Pauses of 10, 20 and 40 ms fit into the time; a further one of 80 does not.
        assert len(port.written) <= 4
        assert connection.is_connected

    connected(test, answer_s=SHORT_S)


def test_refusal_is_not_tried_again() -> None:
    async def test(port: PlayedPort, connection: HubConnection) -> None:
        port.fails = [HubRefusedError("no")]
        with pytest.raises(HubRefusedError):
            await connection.command(b"\x06", "write")
        assert len(port.written) == 1
        assert connection.is_connected

    connected(test)


def test_command_that_is_not_acknowledged_ends_the_link() -> None:
    async def test(port: PlayedPort, connection: HubConnection) -> None:
        port.is_silent = True
        missing = "could not write: the hub did not acknowledge it within 0.08 s; open the link"
        with pytest.raises(HubTimeoutError, match=missing):
            await connection.command(b"\x06", "write")
        assert not connection.is_connected
        lost = r"the link to the hub is lost \(it did not acknowledge a command\); open it again"
        with pytest.raises(HubDisconnectedError, match=lost):
            await connection.command(b"\x06", "write")
        with pytest.raises(HubDisconnectedError, match=lost):
            connection.output.read(0.0)
        assert len(port.written) == 1

    connected(test, answer_s=SHORT_S)


def test_port_that_takes_no_commands_ends_the_link() -> None:
    async def test(port: PlayedPort, connection: HubConnection) -> None:
        port.fails = [HubDisconnectedError("gone")]
        with pytest.raises(HubDisconnectedError, match="gone"):
            await connection.command(b"\x06", "write")
        with pytest.raises(HubDisconnectedError, match=r"lost \(it takes no commands\)"):
            await connection.command(b"\x06", "write")

    connected(test)


def test_first_reason_of_a_loss_is_the_cause() -> None:
    async def test(port: PlayedPort, connection: HubConnection) -> None:
        port.on_loss("out of reach")
        port.on_loss("later")
        await connection.disconnect()
        with pytest.raises(HubDisconnectedError, match=r"lost \(out of reach\)"):
            await connection.command(b"\x06", "write")
        assert port.written == []
        assert port.is_closed

    connected(test)


@pytest.mark.parametrize(
    ("status", "message"),
    [
        (Status.BATTERY_LOW, "the hub's battery is low; charge it soon"),
        (Status.BATTERY_EMPTY, "the hub's battery is low; charge it soon"),
        (Status.BATTERY_HOT, "the hub's battery is hot; let it rest"),
        (Status.BATTERY_TOO_HOT, "the hub's battery is hot; let it rest"),
    ],
)
def test_battery_is_told_once(
    status: Status, message: str, caplog: pytest.LogCaptureFixture
) -> None:
    async def test(port: PlayedPort, connection: HubConnection) -> None:
        port.report(status)
        port.report()
        assert connection.is_connected

    connected(test)
    assert caplog.messages == [message]


@pytest.mark.parametrize("status", [Status.SHUTDOWN, Status.SHUTDOWN_REQUESTED])
def test_hub_that_switches_off_says_so(status: Status) -> None:
    async def test(port: PlayedPort, connection: HubConnection) -> None:
        port.report(status)
        assert not connection.is_connected
        with pytest.raises(HubDisconnectedError, match=r"lost \(the hub is switching off\)"):
            await connection.command(b"\x06", "write")

    connected(test)


def test_broken_notification_is_told_and_changes_nothing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def test(port: PlayedPort, connection: HubConnection) -> None:
        port.on_event(b"\x00\x01")
        assert connection.is_connected
        port.on_event(b"\x01hello")
        assert connection.output.contains(b"ell")

    connected(test)
    assert [message.partition(";")[0] for message in caplog.messages] == [
        "a status report of the hub has 1 bytes"
    ]


def runs(port: PlayedPort) -> Callable[[bytes], None]:
    """What a hub does after its commands: the program runs, or ends."""

    def obey(command: bytes) -> None:
        running = Status.USER_PROGRAM_RUNNING if command[0] == 1 else Status(0)
        if command[0] in (0, 1):
            port.report(running)

    return obey


def test_program_is_started_in_its_slot_and_stopped() -> None:
    async def test(port: PlayedPort, connection: HubConnection) -> None:
        with pytest.raises(HubError, match="no program runs on the hub; start one"):
            connection.output.read(0.0)
        port.after = runs(port)
        await connection.start_program()
        assert port.written == [b"\x01\x01"]
        assert port.operations == ["write the command that starts the program"]
        port.on_event(b"\x01out")
        assert connection.output.read(0.0) == b"out"
        await connection.stop_program()
        assert port.written[1:] == [b"\x00"]
        assert port.operations[1:] == ["write the command that stops the program"]
        with pytest.raises(ProgramStoppedError, match="was stopped; start it again"):
            connection.output.read(0.0)

    connected(test)


def test_hub_without_slots_starts_its_program() -> None:
    port = PlayedPort()
    port.values[profile.CAPABILITIES_UUID] = struct.pack("<HII", 20, 3, 1000)

    async def test(port: PlayedPort, connection: HubConnection) -> None:
        port.after = runs(port)
        await connection.start_program()
        assert port.written == [b"\x01"]

    connected(test, port)


def test_program_that_does_not_stop() -> None:
    async def test(port: PlayedPort, connection: HubConnection) -> None:
        port.after = runs(port)
        await connection.start_program()
        port.after = lambda command: None
        with pytest.raises(HubTimeoutError, match="does not stop; press the hub's button"):
            await connection.stop_program()

    connected(test, answer_s=SHORT_S)


def test_rest_of_the_output_comes_before_the_end() -> None:
    async def test(port: PlayedPort, connection: HubConnection) -> None:
        port.after = runs(port)
        await connection.start_program()
        port.report(Status(0))
        # The last words come after the report of the end.
        port.on_event(b"\x01bye")
        assert not await connection.wait_for_output(b"more", 0.01)
        await connection.wait_until_readable(1.0)
        assert connection.output.read(0.0) == b"bye"
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        await connection.wait_until_readable(LONG_S)
        assert 0.1 < loop.time() - began_s < LONG_S / 2
        with pytest.raises(ProgramStoppedError, match="has ended; start it again"):
            connection.output.read(0.0)

    connected(test)


def test_program_is_downloaded_in_pieces() -> None:
    async def test(port: PlayedPort, connection: HubConnection) -> None:
        await connection.download(b"x" * 31)
        sizes = [len(command) for command in port.written]
        assert sizes == [5, 20, 20, 6, 5]
        assert set(port.operations) == {"write the program onto the hub"}

    connected(test)


@pytest.mark.parametrize(
    ("features", "size", "says"),
    [
        (1, 10, "the hub's firmware cannot run our programs; update it on code.pybricks.com"),
        (3, 1001, "the program has 1001 bytes, the hub takes 1000; use a larger hub"),
    ],
)
def test_program_that_a_hub_does_not_take(features: int, size: int, says: str) -> None:
    port = PlayedPort()
    port.values[profile.CAPABILITIES_UUID] = struct.pack("<HIIB", 512, features, 1000, 1)

    async def test(port: PlayedPort, connection: HubConnection) -> None:
        with pytest.raises(HubProtocolError, match=says):
            await connection.download(bytes(size))
        assert port.written == []

    connected(test, port)


def test_program_as_large_as_the_hub_takes() -> None:
    async def test(port: PlayedPort, connection: HubConnection) -> None:
        await connection.download(bytes(1000))
        assert len(port.written) == 2 + -(-1000 // 15)

    connected(test)


def test_output_is_read_as_soon_as_there_is_some() -> None:
    output = Output()
    assert output.is_readable
    output.begin()
    assert not output.is_readable
    output.check()
    assert output.read(0.0) == b""
    output.put(b"ab")
    output.put(b"c")
    assert output.is_readable
    assert output.contains(b"bc")
    assert not output.contains(b"x")
    output.end(ProgramStoppedError, "over")
    output.end(HubDisconnectedError, "lost")
    # What came before the end is read first, and the last reason counts.
    assert output.read(0.0) == b"abc"
    with pytest.raises(HubDisconnectedError, match="lost"):
        output.read(0.0)
    with pytest.raises(HubDisconnectedError, match="lost"):
        output.check()
    output.put(b"late")
    output.begin()
    assert output.read(0.0) == b""
