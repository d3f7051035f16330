"""An EV3 Brick on a simulated serial line: found, connected, driven, and disturbed."""

from __future__ import annotations

import io
import random
import struct
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from ble_world import bounded
from played_usb_hub import PlayedUsbHub

from brickhub.cli import main
from brickhub.errors import DescriptionError, HubDisconnectedError, HubError, HubProtocolError
from brickhub.hub.interface import DriveSpeed, DriveTurnRate, Interface, MotorAngle, Wait
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.profiles import PROFILES, usual_link
from brickhub.hub.program import generate
from brickhub.hub.program.run_program import load_program, run_program
from brickhub.hub.transports import usb
from brickhub.hub.transports.address import parse_hub
from brickhub.hub.transports.profile import CommandError, PybricksCommand, parse_hub_kind
from brickhub.hub.transports.usb import UsbHub, UsbTransport
from brickhub.robot import Direction, DriveBase, HubKind, Motor, MotorKind, Robot

pytestmark = pytest.mark.realtime

BRICK = UsbHub("/dev/ttyACM0", "0016534a1b2c", 0x0005)
MAX_WRITE_BYTES = 60
"""Largest command that the firmware of an EV3 takes."""
DRIVER = Robot(
    "ev3-driver",
    HubKind.EV3,
    (
        Motor("left", "B", MotorKind.EV3_LARGE, Direction.COUNTERCLOCKWISE),
        Motor("right", "C", MotorKind.EV3_LARGE),
    ),
    drive_base=DriveBase("left", "right", 56, 120),
)
DRIVING = Interface(
    (DriveSpeed(-200, 200), DriveTurnRate(-90, 90)),
    (MotorAngle("left"), MotorAngle("right")),
    Wait(30),
)
FAULTS = ("lost", "cut", "flipped", "noise", "busy", "pulled")
MAX_STOP_S = 1.0
MAX_CALL_S = 40.0
"""Longest time of a turn: to open the link, perhaps again, and four steps."""
_TRIALS = 3


class Line:
    """A brick on a serial line, and one link to it."""

    def __init__(self, folder: Path) -> None:
        self.hub = PlayedUsbHub(DRIVER, "EV3")
        self.hub.max_write_bytes = MAX_WRITE_BYTES
        self.transport = UsbTransport(
            open_serial=self.hub.open_serial,
            find_hubs=lambda: [BRICK] if self.hub.is_plugged_in else [],
            timeout_s=2.0,
            answer_timeout_s=0.6,
            record=folder / "programs.json",
        )
        self.link = HubLink(self.transport, DRIVER, DRIVING, timeout_s=1.0)
        self.hub.library.append(self.link.program.source)

    def close(self) -> None:
        self.hub.change = lambda data: data
        self.transport.close()
        self.hub.close()


@pytest.fixture
def line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Line]:
    monkeypatch.setattr(generate, "END_MS", 500)
    made = Line(tmp_path)
    yield made
    made.close()


def damage(rng: random.Random, kind: str) -> Callable[[bytes], bytes]:
    """What the line does to a frame."""

    def change(frame: bytes) -> bytes:
        if rng.random() > 0.3:
            return frame
        place = rng.randrange(len(frame))
        if kind == "lost":
            return b""
        if kind == "cut":
            return frame[:place]
        if kind == "flipped":
            wrong = bytes((frame[place] ^ 1 << rng.randrange(8),))
            return frame[:place] + wrong + frame[place + 1 :]
        return bytes(rng.choices(range(256), k=40)) + frame

    return change


def open_again(line: Line) -> None:
    """Open the link; a program of before the fault may take some time to end."""
    for _ in range(_TRIALS):
        try:
            line.link.open()
        except HubError:
            time.sleep(0.5)
        else:
            return
    line.link.open()


def disturb(line: Line, kind: str, rng: random.Random) -> None:
    """Let a fault begin."""
    if kind == "pulled":
        line.hub.pull_the_cable()
    elif kind == "busy":
        refusals = [CommandError.BUSY] * rng.randint(1, 4)
        line.hub.faults[PybricksCommand.WRITE_STDIN] = refusals
    else:
        line.hub.change = damage(rng, kind)


def run_course(line: Line, count: int, seed: int) -> Counter[str]:
    """Draw faults while the robot drives; no call hangs, and the motors stop after each."""
    rng = random.Random(seed)
    seen: Counter[str] = Counter()
    watchdog_ms = generate.WATCHDOG_MS
    for _ in range(count):
        kind = rng.choice(FAULTS)
        line.hub.change = lambda data: data
        line.hub.is_plugged_in = True
        line.hub.faults.clear()
        started_s = time.monotonic()
        try:
            open_again(line)
            line.link.act([100.0, 0.0])
            disturb(line, kind, rng)
            for _ in range(3):
                line.link.act([rng.uniform(-200, 200), 0.0])
            seen[f"{kind}: went on"] += 1
        except HubError as error:
            seen[f"{kind}: {type(error).__name__}"] += 1
        assert time.monotonic() - started_s < MAX_CALL_S
        # Nobody says anything any more: the program stops the motors by itself. A link that has
        # been slow has told the hub to wait longer.
        watchdog_ms = max(watchdog_ms, line.link._watchdog_ms)
        line.hub.wait_until("is_driven", False, watchdog_ms / 1000 + MAX_STOP_S)
    assert line.hub.longest_silent_drive_ms <= watchdog_ms
    return seen


def test_a_program_is_sent_in_pieces_of_55_bytes_and_drives(line: Line) -> None:
    with line.link as link:
        identity = line.transport.identity
        assert identity is not None
        assert (identity.kind, identity.address) == (HubKind.EV3, BRICK.address)
        left, right = 0.0, 0.0
        for _ in range(4):
            left, right = link.act([120.0, 0.0]).values
        assert 3 < left < 180 and left == pytest.approx(right, abs=2)
    program_bytes = len(line.hub._ram[: line.hub.size])
    pieces = line.hub.commands.count(PybricksCommand.WRITE_USER_RAM)
    assert pieces == -(-program_bytes // (MAX_WRITE_BYTES - 5))


def test_lines_of_pybricks_2_are_named_after_the_traceback_of_a_brick(
    line: Line, tmp_path: Path
) -> None:
    path = tmp_path / "main.py"
    path.write_text("from pybricks.tools import wait, DataLog\nwait(1)\n", encoding="utf-8")
    program = load_program(path)
    line.hub.files["main.py"] = program.source
    errors = io.StringIO()
    assert run_program(line.transport, program, stdout=io.BytesIO(), stderr=errors) == 1
    assert "can't import name DataLog" in errors.getvalue()
    assert errors.getvalue().endswith("line 1: DataLog: nothing here uses it; leave it out\n")


def test_pulled_cable_stops_the_motors(line: Line) -> None:
    line.link.open()
    line.link.act([100.0, 0.0])
    line.hub.pull_the_cable()
    bounded(lambda: line.link.act([100.0, 0.0]), HubDisconnectedError)
    assert line.hub.wait_until("is_driven", False) < 0.6


def test_some_faults_of_the_line(line: Line) -> None:
    assert run_course(line, 4, seed=1).total() == 4


@pytest.mark.slow
@pytest.mark.timeout(1500)
def test_200_faults_of_the_line(line: Line) -> None:
    assert run_course(line, 200, seed=2).total() == 200


def test_scan_lists_what_is_plugged_in(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(usb, "list_usb_hubs", lambda: [BRICK, UsbHub("COM3", "1", 0x0002)])
    assert main(["scan", "--hub", "usb"]) == 0
    _, first, second = capsys.readouterr().out.splitlines()
    assert first.split() == ["/dev/ttyACM0", "0016534a1b2c", "cable", "ev3"]
    assert second.split()[-1] == "unknown"
    monkeypatch.setattr(usb, "list_usb_hubs", list)
    assert main(["scan", "--hub", "usb"]) == 1
    assert "plug it in and switch it on" in capsys.readouterr().out


def test_bluetooth_is_refused_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(DescriptionError, match="no Bluetooth to a computer yet; .*--hub usb"):
        parse_hub("ble:Brick").transport(HubKind.EV3)
    assert isinstance(parse_hub("usb").transport(HubKind.EV3), UsbTransport)
    program = tmp_path / "main.py"
    program.write_text("from pybricks.hubs import EV3Brick\n", encoding="utf-8")
    assert main(["run", str(program), "--hub", "ble"]) != 0
    assert "plug its cable in" in capsys.readouterr().err


def test_an_nxt_brick_is_refused_by_name() -> None:
    pnp_id = struct.pack("<BHHH", 1, 0x0397, 0xE1, 0)
    with pytest.raises(HubProtocolError, match="it is an NXT brick"):
        parse_hub_kind(pnp_id)


def test_the_usual_link_of_a_brick_is_a_cable() -> None:
    link = usual_link(HubKind.EV3.model)
    assert link is PROFILES["usb"] and link.loss == link.lost_notifications == 0
    assert usual_link(HubKind.PRIME.model) is PROFILES["linux"]
    round_trips_ms = [
        2 * (PROFILES[name].interval_ms + PROFILES[name].jitter_ms)
        for name in ("usb-quick", "usb-slow")
    ]
    assert round_trips_ms[0] >= 5 and round_trips_ms[1] <= 22
