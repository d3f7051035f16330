"""Bluetooth transport with a simulated hub."""

from __future__ import annotations

import statistics
import threading
import time
from pathlib import Path

import pytest
from ble_world import BOUND_S, NAME, World, bounded
from described import SPINNING, WALKER, WALKING
from hub_programs import unplug
from played_hub import PlayedHub
from radio import ATT_WRITE_REQUEST

from brickhub.errors import (
    AmbiguousHubError,
    HubDisconnectedError,
    HubError,
    HubNotFoundError,
    HubProgramError,
)
from brickhub.hub.link.lockstep import LinkState
from brickhub.hub.protocol import data_frame
from brickhub.hub.transport import HubProgram
from brickhub.hub.transports.ble import BleTransport, scan
from brickhub.hub.transports.profile import PybricksCommand
from brickhub.robot import HubKind

pytestmark = pytest.mark.realtime

# ---- what it is for


def test_connect_download_exchange(world: World) -> None:
    transport = world.transport()
    transport.open()
    identity = transport.identity
    assert identity is not None and (identity.name, identity.kind) == (NAME, HubKind.PRIME)
    assert (
        identity.firmware == "4.0.1"
        and identity.profile_version == (1, 5)
        and identity.capabilities.slots == 5
    )
    transport.close()
    with world.link(SPINNING) as link:
        left, right = link.act([90, -45]).values[:2]
        assert 0 < left < 90 and 315 < right < 360
        time.sleep(0.3)
        assert link.read().values[:2] == pytest.approx((90, 315), abs=3)
        assert world.hub.is_running
    assert not world.hub.is_running and not world.hub.is_connected


def test_an_exchange_takes_two_connection_intervals(tmp_path: Path) -> None:
    world = World(tmp_path, WALKER)
    try:
        with world.link(WALKING) as link:
            assert len(data_frame(1, bytes(link.wire.answer_bytes))) == 19
            for interval_ms, exchanges in ((7.5, 60), (15.0, 40), (30.0, 20), (45.0, 12)):
                world.set_interval(interval_ms)
                link.read()
                took_ms = (
                    statistics.median(link.read().round_trip_s for _ in range(exchanges)) * 1000
                )
                assert took_ms == pytest.approx(2 * interval_ms, abs=2.0)
    finally:
        world.close()


def test_clock_tells_milliseconds_on_windows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its monotonic clock has steps of 15.6 ms, about a round trip."""
    transport = BleTransport(record=tmp_path / "programs.json")
    monkeypatch.setattr(time, "monotonic", lambda: 7.0)
    start_s = transport.now_s()
    time.sleep(0.002)
    assert 0.002 <= transport.now_s() - start_s < BOUND_S


def test_same_program_is_downloaded_once(world: World) -> None:
    for _ in range(2):
        with world.link() as link:
            link.act([100])
    assert world.hub.commands.count(PybricksCommand.WRITE_USER_PROGRAM_META) == 2  # one download
    with world.link(SPINNING) as link:
        link.act([10, 10])
    assert world.hub.commands.count(PybricksCommand.WRITE_USER_PROGRAM_META) == 4


def test_lost_program_is_downloaded_again(world: World) -> None:
    with world.link():
        pass
    world.hub.size = 0
    with world.link() as link:
        link.act([100])
    assert world.hub.commands.count(PybricksCommand.WRITE_USER_PROGRAM_META) == 4


def test_other_running_program_is_replaced(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("brickhub.hub.transports.pybricks_hub._HELLO_S", 0.3)
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
        assert kinds.index(PybricksCommand.WRITE_USER_RAM) < kinds.index(
            PybricksCommand.START_USER_PROGRAM
        )


def test_writes_wait_for_response(world: World) -> None:
    seen = set[int]()

    def watch(opcode: int, data: bytes) -> int:
        seen.add(opcode)
        return 1

    world.fault(watch)
    with world.link() as link:
        link.act([100])
    # 0x52: write without response, which hubs drop
    assert ATT_WRITE_REQUEST in seen and 0x52 not in seen


# ---- the program


@pytest.mark.parametrize("flushes_late", [False, True])
def test_program_raises_at_start(world: World, flushes_late: bool) -> None:
    world.hub.flushes_late = flushes_late
    unplug(world.hub.machine, "A")
    error = bounded(world.link().open, HubProgramError)
    assert (
        "ENODEV" in str(error) and "Motor(Port.A" in str(error) and "plug the device" in str(error)
    )


def test_program_raises_later(world: World) -> None:
    transport = world.transport()
    source = (
        "from usys import stdin\nfrom pybricks.tools import wait\nprint('ready')\n"
        "stdin.buffer.read(1)\nwait(50)\n1 // 0\n"
    )
    world.hub.library.append(source)
    transport.open()
    transport.start(HubProgram(source, 7))
    assert transport.read(1.0) == b"ready\r\n"
    transport.write(b"x")
    pieces: list[bytes] = []
    error = bounded(lambda: [pieces.append(transport.read(1.0)) for _ in range(100)], HubError)
    text = b"".join(pieces)
    assert b"line 6" in text and text.endswith(b"ZeroDivisionError: divide by zero\r\n")
    assert "has ended" in str(error)
    bounded(lambda: transport.write(b"x"), HubError)


def test_program_error_in_step_has_text_and_line(world: World) -> None:
    link = world.link()
    link.open()
    world.hub.machine.servos.pop("E").close()  # the motor is pulled out
    error = bounded(lambda: [link.act([100]) for _ in range(3)], HubProgramError)
    assert (
        "ENODEV" in str(error)
        and "at line" in str(error)
        and "motor_left.run_angle(400" in str(error)
    )
    assert link.state is LinkState.FAULT


def test_button_ends_program(world: World) -> None:
    link = world.link()
    link.open()
    world.hub.press_button()
    world.hub.wait_until("is_running", False)
    bounded(lambda: link.act([100]), HubError)
    assert link.state is LinkState.FAULT
    link.open()
    link.act([100])


def test_stop_from_other_thread_during_move(world: World) -> None:
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


# ---- several hubs, and none


def test_several_hubs(world: World) -> None:
    other = PlayedHub(world.radio, WALKER, "Rover", "C0:01:02:03:04:06")
    found = scan(0.3, backend=world.radio.backend())
    assert {(hub.name, hub.address) for hub in found} == {
        (NAME, "C0:01:02:03:04:05"),
        ("Rover", "C0:01:02:03:04:06"),
    }
    error = bounded(world.transport(name=None).open, AmbiguousHubError)
    assert "Rover" in str(error) and NAME in str(error)
    bounded(world.transport(name="Rovre", timeout_s=0.5).open, HubNotFoundError)
    for wanted in ({"name": "Rover"}, {"name": None, "address": "c0:01:02:03:04:06"}):
        transport = world.transport(**wanted)
        transport.open()
        assert other.is_connected and not world.hub.is_connected
        transport.close()
        other.wait_until("is_connected", False)


def test_several_hubs_of_one_name(world: World) -> None:
    other = PlayedHub(world.radio, WALKER, NAME, "C0:01:02:03:04:06")
    error = bounded(world.transport().open, AmbiguousHubError)
    assert world.hub.address in str(error) and "C0:01:02:03:04:06" in str(error)
    world.transport(name=None, address="C0:01:02:03:04:06").open()
    assert other.is_connected and not world.hub.is_connected


def test_single_hub_needs_no_name(world: World) -> None:
    world.transport(name=None).open()
    assert world.hub.is_connected


def test_without_bluetooth(tmp_path: Path) -> None:
    """Whatever this computer has, there is no such hub."""
    transport = BleTransport(name="no such hub", timeout_s=0.5, record=tmp_path / "programs.json")
    bounded(transport.open, HubError, 10.0)
    transport.close()


# ---- opening and closing


def test_close_in_any_state_cleans_up(world: World) -> None:
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


def test_write_is_limited_to_20_bytes(world: World) -> None:
    transport = world.transport()
    transport.open()
    bounded(lambda: transport.write(bytes(21)), HubError)
