"""Transport to a hub over a played port: which commands it sends, and what it remembers."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from played_port import PlayedPort

from brickhub.errors import (
    AmbiguousHubError,
    HubDisconnectedError,
    HubError,
    HubNotFoundError,
    HubProtocolError,
    HubRefusedError,
    ProgramError,
)
from brickhub.hub.program.compile import compile_program, program_blob
from brickhub.hub.protocol import Up, control_frame, hello_payload
from brickhub.hub.transport import HubProgram, Pipe
from brickhub.hub.transports import profile, pybricks_hub
from brickhub.hub.transports.connection import Port
from brickhub.hub.transports.profile import Status
from brickhub.hub.transports.pybricks_hub import ProfileTransport
from brickhub.robot import HubKind

SAYS_HELLO = HubProgram("print(1)\n", 0x1234)
STARTED = b"\x01\x01"


class Played(ProfileTransport):
    """A transport that finds a played port; ``failures`` are raised by the first searches."""

    def __init__(self, port: PlayedPort, record: Path) -> None:
        super().__init__(timeout_s=20.0, answer_timeout_s=20.0, record=record)
        self.port = port
        self.failures: list[Exception] = []
        self.searches = 0

    async def _find(self, timeout_s: float) -> Port:
        self.searches += 1
        if self.failures:
            raise self.failures.pop(0)
        return self.port


def obeying(port: PlayedPort, output: bytes = b"") -> Callable[[bytes], None]:
    """What a hub does after its commands: its program runs, and says something, or ends."""

    def obey(command: bytes) -> None:
        if command[0] == 1:
            port.report(Status.USER_PROGRAM_RUNNING)
            port.on_event(b"\x01" + output)
        elif command[0] == 0:
            port.report(Status(0))

    return obey


@pytest.fixture
def hub(tmp_path: Path) -> Iterator[Played]:
    port = PlayedPort()
    port.values[profile.CAPABILITIES_UUID] = struct.pack("<HIIB", 512, 3, 100_000, 2)
    port.after = obeying(port)
    transport = Played(port, tmp_path / "programs.json")
    yield transport
    transport.close()


def noted(hub: Played) -> dict[str, int | None]:
    """What is remembered of the programs on hubs."""
    remembered: dict[str, int | None] = json.loads(hub._record.read_text())
    return remembered


def download_of(program: HubProgram) -> list[bytes]:
    """Commands that download a program."""
    blob = program_blob(compile_program(program), HubKind.PRIME)
    return list(profile.download(blob, 512))


def test_closed_transport_has_no_hub(hub: Played) -> None:
    assert hub.identity is None
    assert hub.status is None
    hub.stop()
    for call in (lambda: hub.read(0.0), lambda: hub.write(b"x")):
        with pytest.raises(HubDisconnectedError, match="the hub is not connected; open the link"):
            call()
    hub.close()
    assert hub.searches == 0


def test_first_start_downloads_and_the_next_one_does_not(hub: Played) -> None:
    hub.start(SAYS_HELLO)
    assert hub.port.written == [*download_of(SAYS_HELLO), STARTED]
    assert noted(hub) == {"C0:01 slot 1": 0x1234}
    assert hub.identity is not None
    assert hub.identity.name == "Rover"
    assert hub.status is not None
    assert Status.USER_PROGRAM_RUNNING in hub.status.flags
    hub.port.written.clear()
    hello = control_frame(Up.HELLO, hello_payload(0x1234))
    hub.port.after = obeying(hub.port, hello)
    hub.start(SAYS_HELLO)
    # The program that runs is stopped before.
    assert hub.port.written == [b"\x00", STARTED]
    assert hub.read(0.0) == hello
    assert hub.searches == 1


def test_another_program_is_downloaded(hub: Played) -> None:
    hub.start(SAYS_HELLO)
    hub.stop()
    hub.port.written.clear()
    other = HubProgram("print(2)\n", 0x5678)
    hub.start(other)
    assert hub.port.written == [*download_of(other), STARTED]
    assert noted(hub) == {"C0:01 slot 1": 0x5678}


def test_program_that_another_computer_has_put_there_is_replaced(
    hub: Played, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pybricks_hub, "_HELLO_S", 0.05)
    hub.start(SAYS_HELLO)
    hub.stop()
    hub.port.written.clear()
    # What runs does not say hello with our hash: it is stopped again.
    hub.start(SAYS_HELLO)
    assert hub.port.written == [STARTED, b"\x00", *download_of(SAYS_HELLO), STARTED]


def test_slots_and_hubs_are_remembered_apart(hub: Played) -> None:
    hub._record.write_text(json.dumps({"C0:99 slot 0": 7}))
    hub.port.slot = 0
    hub.start(SAYS_HELLO)
    assert noted(hub) == {"C0:99 slot 0": 7, "C0:01 slot 0": 0x1234}
    assert hub.port.written[-1] == b"\x01\x00"


@pytest.mark.parametrize("text", ["", "[1]", "{", "3"])
def test_damaged_record_costs_a_download(hub: Played, text: str) -> None:
    hub._record.write_text(text)
    hub.start(SAYS_HELLO)
    assert hub.port.written == [*download_of(SAYS_HELLO), STARTED]
    assert noted(hub) == {"C0:01 slot 1": 0x1234}


def test_program_that_says_no_hello_is_downloaded_each_time(hub: Played) -> None:
    program = HubProgram("print(1)\n", 0x1234, says_hello=False)
    for _ in range(2):
        hub.port.written.clear()
        hub.start(program)
        hub.stop()
        assert hub.port.written == [*download_of(program), STARTED, b"\x00"]
        assert noted(hub) == {"C0:01 slot 1": None}


def test_program_that_cannot_be_compiled_needs_no_hub(hub: Played) -> None:
    with pytest.raises(ProgramError):
        hub.start(HubProgram("x = = 3", 1))
    assert hub.searches == 0


def test_move_hub_runs_no_program_of_ours(hub: Played) -> None:
    hub.port.values[profile.PNP_ID_UUID] = struct.pack("<BHHH", 1, 0x0397, 0x40, 0)
    with pytest.raises(HubProtocolError, match="a Move Hub cannot run our programs; use another"):
        hub.start(SAYS_HELLO)
    assert hub.port.written == []
    # One of a user's own, which does not listen, is another thing.
    hub.start(HubProgram("print(1)\n", 1, says_hello=False))
    assert hub.port.written[-1] == STARTED


def test_input_of_a_program(hub: Played) -> None:
    hub.start(SAYS_HELLO)
    hub.port.written.clear()
    hub.write(b"x" * 20)
    assert hub.port.written == [b"\x06" + b"x" * 20]
    assert hub.port.operations[-1] == "write to the program"
    too_long = "21 bytes in one write; a hub takes 20 at most, split them"
    with pytest.raises(HubError, match=too_long):
        hub.write(b"x" * 21)
    assert len(hub.port.written) == 1
    hub.stop()
    with pytest.raises(HubError, match="was stopped; start it again"):
        hub.write(b"x")


def test_input_by_app_data_is_counted(hub: Played) -> None:
    hub.start(HubProgram("print(1)\n", 0x1234, pipe=Pipe.APP_DATA))
    hub.port.written.clear()
    for _ in range(256):
        hub.write(b"abc")
    # Command, offset, count, length, frame; the count is never 0.
    assert hub.port.written[0] == b"\x07\x00\x00" + bytes((1, 3)) + b"abc"
    counts = [command[3] for command in hub.port.written]
    assert counts == [*range(1, 256), 1]


def test_search_goes_on_with_longer_pauses(
    hub: Played, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    pauses_s = []

    async def sleep(seconds: float) -> None:
        pauses_s.append(seconds)

    monkeypatch.setattr(pybricks_hub.asyncio, "sleep", sleep)
    hub.failures = [HubNotFoundError("no hub")] * 6
    with caplog.at_level("INFO"):
        hub.open()
    assert pauses_s == [0.25, 0.5, 1.0, 2.0, 2.0, 2.0]
    assert caplog.messages[:6] == ["no hub; trying again"] * 6
    assert caplog.messages[6] == "connected to the prime hub 'Rover', firmware 4.0.1"


@pytest.mark.parametrize("error", [AmbiguousHubError("two"), HubProtocolError("old")])
def test_what_only_a_person_can_mend_is_not_tried_again(hub: Played, error: HubError) -> None:
    hub.failures = [error]
    with pytest.raises(type(error)):
        hub.open()
    assert hub.searches == 1


def test_search_ends_at_its_time(hub: Played) -> None:
    hub._timeout_s = 0.2
    hub.failures = [HubNotFoundError("no hub")] * 9
    with pytest.raises(HubNotFoundError):
        hub.open()
    assert hub.searches == 1


def test_open_again_keeps_the_link_and_a_lost_one_is_made_anew(hub: Played) -> None:
    hub.open()
    hub.open()
    assert hub.searches == 1
    hub.port.on_loss("out of reach")
    hub.stop()
    assert hub.port.written == []
    hub.open()
    assert hub.searches == 2
    assert hub.port.is_closed


def test_close_stops_the_program(hub: Played) -> None:
    hub.start(SAYS_HELLO)
    hub.port.written.clear()
    hub.close()
    assert hub.port.written == [b"\x00"]
    assert hub.port.is_closed
    assert hub.identity is None


def test_link_that_is_lost_while_a_stored_program_starts(hub: Played) -> None:
    hub.start(SAYS_HELLO)
    hub.stop()
    hub.port.written.clear()

    def lose(command: bytes) -> None:
        hub.port.on_loss("out of reach")

    hub.port.after = lose
    with pytest.raises(HubDisconnectedError, match="out of reach"):
        hub.start(SAYS_HELLO)
    # Nothing is downloaded over a lost link, and what is known of the hub's program stays.
    assert hub.port.written == [STARTED]
    assert noted(hub) == {"C0:01 slot 1": 0x1234}


def test_stored_program_that_the_hub_refuses_is_downloaded(
    hub: Played, caplog: pytest.LogCaptureFixture
) -> None:
    hub.start(SAYS_HELLO)
    hub.stop()
    hub.port.written.clear()
    hub.port.fails = [HubRefusedError("no such program")]
    with caplog.at_level("INFO"):
        hub.start(SAYS_HELLO)
    assert hub.port.written == [STARTED, *download_of(SAYS_HELLO), STARTED]
    assert "the program on the hub cannot be started: no such program" in caplog.messages
