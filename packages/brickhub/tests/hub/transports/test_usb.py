"""USB transport with a simulated hub, over sockets and a pseudo terminal."""

from __future__ import annotations

import errno
import os
import random
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ClassVar

import pytest
import serial
from ble_world import BOUND_S, LONG_RUN, bounded
from described import SPINNING, TWO_WHEELER
from played_usb_hub import PlayedUsbHub, SocketSerial

from brickhub.errors import (
    AmbiguousHubError,
    HubDisconnectedError,
    HubError,
    HubNotFoundError,
    HubProgramError,
    HubRefusedError,
    HubTimeoutError,
    Reason,
    UsbUnavailableError,
)
from brickhub.hub.interface import Interface
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.states import LinkState
from brickhub.hub.program import generate
from brickhub.hub.transports.profile import CommandError, PybricksCommand
from brickhub.hub.transports.usb import UsbHub, UsbTransport, list_usb_hubs
from brickhub.robot import HubKind

pytestmark = pytest.mark.realtime

PORT = "/dev/played"


class Cable:
    """A hub on a cable, and links to it."""

    def __init__(self, folder: Path) -> None:
        self.hub = PlayedUsbHub(TWO_WHEELER, "Rover")
        self.record = folder / "programs.json"
        self._open: list[UsbTransport] = []

    def transport(self, port: str | None = PORT, **options: Any) -> UsbTransport:
        settings: dict[str, Any] = {
            "open_serial": self.hub.open_serial,
            "find_hubs": list,
            "timeout_s": 1.0,
            "answer_timeout_s": 0.6,
            "record": self.record,
        }
        transport = UsbTransport(port, **(settings | options))
        self._open.append(transport)
        return transport

    def link(self, interface: Interface = LONG_RUN, **options: Any) -> HubLink:
        link = HubLink(self.transport(**options), TWO_WHEELER, interface, timeout_s=1.0)
        self.hub.library.append(link.program.source)
        return link

    def close(self) -> None:
        self.hub.change = lambda data: data
        for transport in self._open:
            transport.close()
        self.hub.close()


@pytest.fixture
def cable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Cable]:
    monkeypatch.setattr(generate, "END_MS", 500)
    made = Cable(tmp_path)
    yield made
    made.close()


def test_connect_download_exchange(cable: Cable) -> None:
    with cable.link(SPINNING) as link:
        identity = link._transport.identity
        assert (identity.name, identity.kind, identity.profile_version) == (
            "Rover",
            HubKind.PRIME,
            (1, 6),
        )
        left, right = link.act([90, -45]).values[:2]
        assert 0 < left < 90 and 315 < right < 360
        time.sleep(0.3)
        assert link.read().values[:2] == pytest.approx((90, 315), abs=3)
    assert not cable.hub.is_running
    cable.hub.wait_until("is_connected", False)


def test_same_program_is_downloaded_once(cable: Cable) -> None:
    for _ in range(2):
        with cable.link() as link:
            link.act([100])
    assert cable.hub.commands.count(PybricksCommand.WRITE_USER_PROGRAM_META) == 2  # one download


@pytest.mark.skipif(os.name != "posix", reason="pseudo terminals are a thing of POSIX")
def test_usb_over_pseudo_terminal(cable: Cable) -> None:
    with cable.link(port=cable.hub.attach_terminal(), open_serial=None) as link:
        times = [link.read().round_trip_s for _ in range(20)]
        link.act([100])
    assert sorted(times)[10] < 0.05
    assert not cable.hub.is_running


def test_hub_is_identified_by_usb_ids(cable: Cable) -> None:
    cable.hub.tells_product = False
    transport = cable.transport(port=None, find_hubs=lambda: [UsbHub(PORT, "123", 0x0009)])
    transport.open()
    assert transport.identity is not None
    assert (transport.identity.kind, transport.identity.address) == (HubKind.PRIME, "123")


def test_usb_hub_selection(cable: Cable) -> None:
    assert all(isinstance(hub, UsbHub) for hub in list_usb_hubs())
    assert "plug it in" in str(bounded(cable.transport(port=None).open, HubNotFoundError))
    two = [UsbHub("/dev/a", "1"), UsbHub("/dev/b", "2")]
    error = bounded(cable.transport(port=None, find_hubs=lambda: two).open, AmbiguousHubError)
    assert "/dev/a, /dev/b" in str(error)
    cable.transport(port="/dev/b", find_hubs=lambda: two).open()


def test_forbidden_port(cable: Cable) -> None:
    def refuse(device: str) -> Any:
        raise PermissionError(errno.EACCES, "Permission denied", device)

    error = bounded(cable.transport(open_serial=refuse, timeout_s=30.0).open, UsbUnavailableError)
    assert "dialout" in str(error) and error.reason is Reason.DENIED


def test_port_of_other_device(cable: Cable, tmp_path: Path) -> None:
    cable.hub._on_message = lambda message: _nothing()  # type: ignore[method-assign]
    bounded(cable.transport().open, HubTimeoutError)


async def _nothing() -> None:
    pass


def test_program_error_has_line(cable: Cable) -> None:
    link = cable.link()
    link.open()
    servos = cable.hub.machine.servos
    servos.pop("E").close()
    error = bounded(lambda: [link.act([100]) for _ in range(3)], HubProgramError)
    assert (
        "ENODEV" in str(error)
        and "at line" in str(error)
        and "motor_left.run_angle(400" in str(error)
    )
    assert link.state is LinkState.FAULT


def test_refused_command(cable: Cable) -> None:
    cable.hub.faults[PybricksCommand.WRITE_USER_RAM] = [CommandError.INVALID_COMMAND]
    bounded(cable.link().open, HubRefusedError)


def test_full_input_buffer_is_retried(cable: Cable) -> None:
    with cable.link() as link:
        cable.hub.faults[PybricksCommand.WRITE_STDIN] = [CommandError.BUSY] * 3
        link.act([100])
        assert link.statistics.resends == 0


def test_unplugged_hub_stops_and_is_found_again(cable: Cable) -> None:
    link = cable.link(timeout_s=3.0)
    link.open()
    link.act([3000])
    assert cable.hub.is_driven
    cable.hub.pull_the_cable()
    bounded(lambda: link.act([3000]), HubDisconnectedError)
    assert link.state is LinkState.FAULT
    assert cable.hub.wait_until("is_driven", False) < 0.6
    threading.Timer(0.3, lambda: setattr(cable.hub, "is_plugged_in", True)).start()
    link.open()
    link.act([100])


def test_hub_is_found_again_at_another_port(cable: Cable) -> None:
    opened, plugged = [], [UsbHub(PORT, "123", 0x0009)]

    def open_serial(device: str) -> Any:
        opened.append(device)
        return cable.hub.open_serial(device)

    link = cable.link(timeout_s=3.0, open_serial=open_serial, find_hubs=lambda: list(plugged))
    link.open()
    cable.hub.pull_the_cable()
    bounded(lambda: link.act([100]), HubDisconnectedError)
    plugged[:] = [UsbHub(PORT, "another", 0x0009), UsbHub("/dev/played1", "123", 0x0009)]
    cable.hub.is_plugged_in = True
    link.open()
    link.act([100])
    assert (opened[0], opened[-1]) == (PORT, "/dev/played1")


def test_port_that_takes_no_bytes_is_opened_again(
    cable: Cable, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[SocketSerial] = []

    def open_serial(device: str) -> SocketSerial:
        opened.append(cable.hub.open_serial(device))
        return opened[-1]

    def write(data: bytes) -> int:
        raise serial.SerialTimeoutException("Write timeout")

    link = cable.link(open_serial=open_serial)
    link.open()
    monkeypatch.setattr(opened[0], "write", write)
    bounded(lambda: link.act([100]), HubDisconnectedError)
    link.open()
    link.act([100])
    assert len(opened) == 2


HOST = """
import sys, time
from ble_world import LONG_RUN
from brickhub.hub.program import generate
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.transports.usb import UsbTransport
from described import TWO_WHEELER
from pathlib import Path
generate.END_MS = 500
link = HubLink(UsbTransport(sys.argv[1], record=Path(sys.argv[2])), TWO_WHEELER, LONG_RUN)
link.open()
end_s = time.monotonic() + float(sys.argv[3])
while time.monotonic() < end_s:
    link.act([3000])
"""


def host_process(cable: Cable, duration_s: float) -> subprocess.Popen[str]:
    command = [
        sys.executable,
        "-c",
        HOST,
        cable.hub.attach_terminal(),
        str(cable.record),
        str(duration_s),
    ]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)


@pytest.mark.skipif(os.name != "posix", reason="pseudo terminals are a thing of POSIX")
def test_end_of_host_process_stops_program(cable: Cable) -> None:
    cable.link()
    _, errors = host_process(cable, 0.0).communicate(timeout=60)
    assert not errors
    assert cable.hub.commands[-1] == PybricksCommand.STOP_USER_PROGRAM


@pytest.mark.skipif(os.name != "posix", reason="pseudo terminals and SIGKILL are things of POSIX")
def test_killed_host_process(cable: Cable) -> None:
    link = cable.link()
    host = host_process(cable, 60.0)
    try:
        cable.hub.wait_until("is_driven", True, 60.0)
        time.sleep(0.2)
    finally:
        host.kill()
        host.communicate(timeout=5)
    assert cable.hub.wait_until("is_driven", False) < 0.6
    assert cable.hub.longest_silent_drive_ms <= generate.WATCHDOG_MS
    cable.hub.wait_until("is_running", False, 2.0)
    link.open()
    link.act([100])


def test_close_in_any_state(cable: Cable) -> None:
    before = set(threading.enumerate())
    transport = cable.transport()
    transport.close()
    transport.open()
    transport.close()
    transport.close()
    time.sleep(0.1)
    assert not {
        thread.name
        for thread in set(threading.enumerate()) - before
        if thread.name.startswith("bricksrl")
    }


def damage(rng: random.Random, kind: str) -> Callable[[bytes], bytes]:
    def change(frame: bytes) -> bytes:
        if rng.random() > 0.15:
            return frame
        place = rng.randrange(len(frame))
        if kind == "lost":
            return b""
        if kind == "cut":
            return frame[:place]
        if kind == "flipped":
            return (
                frame[:place] + bytes((frame[place] ^ 1 << rng.randrange(8),)) + frame[place + 1 :]
            )
        return bytes(rng.choices(range(256), k=40)) + frame  # noise

    return change


@pytest.mark.parametrize("kind", ["lost", "cut", "flipped", "noise"])
def test_damaged_frames_raise_only_our_errors(cable: Cable, kind: str) -> None:
    rng = random.Random(7)
    link = cable.link()
    answered = 0
    for _ in range(3):
        cable.hub.change = lambda data: data
        link.open()
        cable.hub.change = damage(rng, kind)
        start_s = time.monotonic()
        try:
            for _ in range(6):
                reading = link.act([rng.uniform(-200, 200)])
                answered += 1
                assert reading.values[1] == 0, (
                    "a motor that nobody moves has moved: a frame was decoded wrongly"
                )
        except HubError:
            assert link.state is LinkState.FAULT
        assert time.monotonic() - start_s < 4 * BOUND_S
    assert answered > 1


class ReadSerial(SocketSerial):
    """A port that records whether it was closed while it was read, which Windows does not bear."""

    closed_while_read: ClassVar[list[bool]] = []
    _is_read = False

    def read(self, size: int) -> bytes:
        self._is_read = True
        try:
            return super().read(size)
        finally:
            self._is_read = False

    def close(self) -> None:
        self.closed_while_read.append(self._is_read)
        super().close()


def test_port_is_closed_when_nothing_reads_it(
    cable: Cable, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("played_usb_hub.SocketSerial", ReadSerial)
    monkeypatch.setattr(ReadSerial, "closed_while_read", [])
    for _ in range(3):
        transport = cable.transport()
        transport.open()
        transport.close()
    assert ReadSerial.closed_while_read == 3 * [False]


def test_port_in_small_letters_is_the_same_hub(cable: Cable) -> None:
    """Windows takes ``com3`` for ``COM3``; calibrations belong to the hub that is there."""
    hubs = [UsbHub("COM3", "123", 0x0009), UsbHub("COM4", "456", 0x0009)]
    transport = cable.transport(port="com3", find_hubs=lambda: hubs)
    transport.open()
    assert transport.identity is not None and transport.identity.address == "123"
