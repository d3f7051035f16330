"""A client program of a user's own behind the link, on the virtual hub."""

from __future__ import annotations

import logging
import os
import urllib.request
from pathlib import Path

import pytest
from described import TWO_WHEELER

from brickhub.errors import (
    DescriptionError,
    HubProgramError,
    HubProtocolError,
    HubTimeoutError,
    ProgramError,
    ProgramStoppedError,
)
from brickhub.hub.interface import ClientChannel, ClientCommand, Interface, UntilDone
from brickhub.hub.link.lockstep import HubLink, LinkState
from brickhub.hub.link.own_client import ClientLink, OwnClient
from brickhub.hub.program.compile import HUB_MODULES, check_program
from brickhub.hub.protocol import EncodingError
from brickhub.hub.transport import HubProgram
from brickhub.robot import HubKind, Motor, PoweredUpSensor, Robot, SensorKind, UltrasonicSensor
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.frozen import FROZEN
from brickhub.virtual.machine import Machine
from brickhub.virtual.pybricks import modules
from brickhub.virtual.virtual_transport import VirtualHub

HEAD = """import ustruct
from micropython import kbd_intr
from pybricks.parameters import Port
from pybricks.pupdevices import Motor
from pybricks.tools import wait
from usys import stdin, stdout

kbd_intr(-1)
motor = Motor(Port.A)
"""
LOOP = """while True:
    turn, count = ustruct.unpack("!fb", stdin.buffer.read(5))
    motor.run_angle(500, turn)
    stdout.buffer.write(ustruct.pack("!fb", motor.angle(), count))
"""
INTERFACE = Interface(
    (ClientCommand("turn", -90, 90, "deg"), ClientCommand("count", 0, 9)),
    (ClientChannel("angle", 0, 360, "deg"), ClientChannel("count", 0, 9)),
    UntilDone(2000),
)


def linked(folder: Path, loop: str = LOOP) -> tuple[ClientLink, VirtualHub]:
    (folder / "client.py").write_text(HEAD + loop)
    hub = VirtualHub(BenchBody(TWO_WHEELER))
    return ClientLink(
        hub,
        TWO_WHEELER,
        INTERFACE,
        OwnClient(str(folder / "client.py"), "!fb", "!fb"),
        timeout_s=1.0,
    ), hub


def test_exchange_in_its_own_format_and_one_word_about_the_watchdog(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    link, hub = linked(tmp_path)
    with caplog.at_level(logging.WARNING), link:
        assert link.read().values == (0.0, 0.0)
        first, second = link.act([60.0, 2.4]), link.act([30.0, 7])
        assert first.values == (pytest.approx(60, abs=2), 2.0) and second.values == (
            pytest.approx(90, abs=2),
            7.0,
        )
        assert second.round_trip_s > 0.09 and second.hub_time_ms > first.hub_time_ms
        link.stop()
        link.open()
        assert link.act([1, 5]).values[1] == 5.0
    assert [record.message.count("has no watchdog") for record in caplog.records] == [1]
    assert link.state is LinkState.DISCONNECTED and hub.machine.servos["A"].voltage_mv is None


def test_silence_ends_the_step_as_lost(tmp_path: Path) -> None:
    link, _ = linked(
        tmp_path, LOOP.replace("motor.run", "wait(9000 if count == 3 else 0)\n    motor.run")
    )
    link.open()
    link.read()
    with pytest.raises(
        HubTimeoutError,
        match=r"client.py sent 0 bytes and no answer '!fb' within 3 s; let it answer each",
    ):
        link.act([1.0, 3])
    assert link.state is LinkState.FAULT
    link.open()
    assert link.act([1.0, 4]).values[1] == 4.0, "nothing of the late answer is left"


def test_another_size_of_the_answer_is_told(tmp_path: Path) -> None:
    link, _ = linked(
        tmp_path,
        LOOP.replace('pack("!fb", motor.angle(), count)', 'pack("!fbf", motor.angle(), count, 0)'),
    )
    link.open()
    with pytest.raises(
        HubProtocolError, match="client.py sent more than an answer '!fb'; correct one of them"
    ):
        link.read()


def test_what_is_no_number_and_an_end_are_told(tmp_path: Path) -> None:
    link, _ = linked(tmp_path, LOOP.replace("motor.angle()", 'float("nan") if count else 0'))
    link.open()
    link.read()
    with pytest.raises(
        HubProtocolError,
        match=r"client.py answers \[nan, 1.0\], which are not all numbers; correct it",
    ):
        link.act([1.0, 1])
    link, _ = linked(tmp_path, LOOP.replace("while True", "for _ in range(2)"))
    link.open()
    link.read()
    link.act([1.0, 1])
    with pytest.raises(
        ProgramStoppedError, match="client.py has ended; let it answer in a loop without end"
    ):
        link.act([1.0, 1])
    link, _ = linked(tmp_path, LOOP.replace("motor.run", "raise SystemExit\n    motor.run"))
    link.open()
    with pytest.raises(ProgramStoppedError, match="client.py has ended"):
        link.read()


def test_error_of_the_program_is_told_with_its_line(tmp_path: Path) -> None:
    link, _ = linked(tmp_path, LOOP.replace("motor.run", "count = 1 // count\n    motor.run"))
    link.open()
    with pytest.raises(
        HubProgramError,
        match=r"ZeroDivisionError: divide by zero at line 12 \(count = 1 // count\)",
    ):
        link.read()


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ("import numpy", "client.py: the hub has no module 'numpy'; put it beside the program"),
        (
            "while True print(1)",
            "client.py, line 10: SyntaxError: invalid syntax; correct the program",
        ),
        (
            "def f(a):\n    return a + angel\nf(1)",
            "client.py, line 11: nothing sets 'angel'; define it",
        ),
        ("print([x for x in range(y)])", "client.py, line 10: nothing sets 'y'"),
        ("text = '" + "x" * 300_000 + "'", "bytes, the prime hub takes 278528; make it shorter"),
    ],
)
def test_checked_before_it_starts(tmp_path: Path, change: str, problem: str) -> None:
    with pytest.raises(ProgramError, match=problem.replace("(", r"\(")):
        linked(tmp_path, change + "\n")


def test_sound_names_are_no_findings() -> None:
    source = (
        "from pybricks.tools import *\nimport ustruct as s\ncount = 0\n"
        "def add(n, *rest, by=1, **named):\n    global total\n    total = [n + m for m in rest]\n"
        "    return lambda q: q + by + count\n"
        "class A:\n    size = 3\n    def get(self):\n        return self.size\n"
        "try:\n    add(1)\nexcept OSError as error:\n    print(error, total, A().get(), s)\n"
    )
    assert check_program(HubProgram(source, 0), HubKind.PRIME) > 100


def test_modules_are_those_of_the_virtual_hub() -> None:
    class NoConsole:
        def available(self) -> int:
            return 0

    machine = Machine(BenchBody(TWO_WHEELER))
    frozen = {module.name for module in FROZEN}
    assert set(modules(machine, NoConsole())) | frozen == HUB_MODULES  # type: ignore[arg-type]


def test_formats_fit_the_interface(tmp_path: Path) -> None:
    (tmp_path / "client.py").write_text(HEAD)
    path = str(tmp_path / "client.py")
    for form, problem in (
        ("!q?x:", "is no struct format"),
        ("4s", "has no numbers or a text"),
        ("", "has no numbers or a text"),
    ):
        with pytest.raises(DescriptionError, match=problem):
            OwnClient(path, form, "!f")
    with pytest.raises(
        DescriptionError, match=r"'!f' is not a format for 2 numbers \(turn, count\)"
    ):
        OwnClient(path, "!f", "!ff").check(INTERFACE)
    with pytest.raises(
        DescriptionError, match="there is no client program 'nowhere.py'; put it beside your task"
    ):
        OwnClient("nowhere.py", "!f", "!f")
    client = OwnClient(path, "!fb", "!ff")
    with pytest.raises(EncodingError, match="cannot hold"):
        client.encoded([1.0, 300.0])
    with pytest.raises(EncodingError, match="cannot hold"):
        client.encoded([1.0])
    with pytest.raises(EncodingError, match="not a number"):
        client.encoded([float("nan"), 1.0])
    assert client.encoded([0.5, 2.6]) == b"\x3f\x00\x00\x00\x03"


def test_numbers_of_a_client_need_one() -> None:
    with pytest.raises(DescriptionError, match="is for a client of your own; name its program"):
        HubLink(VirtualHub(BenchBody(TWO_WHEELER)), TWO_WHEELER, INTERFACE)


EYE, COLOR = UltrasonicSensor("eye", "C"), PoweredUpSensor("color", "C", SensorKind.COLOR)
RELEASED = {
    "runaway": ("!f", "!fffff", "EA", (EYE,)),
    "spinning": ("!ff", "!fffff", "EA", (EYE,)),
    "walker": (
        "!ffff",
        "!fffffff",
        "ABCD",
        (UltrasonicSensor("eye", "E"), PoweredUpSensor("color", "F", SensorKind.COLOR)),
    ),
    "roboarm": ("!ffff", "!ffff", "ABDE", (COLOR,)),
}


@pytest.mark.slow
@pytest.mark.skipif(
    "BRICKSRL_NETWORK" not in os.environ,
    reason="set BRICKSRL_NETWORK=1 to fetch the released clients",
)
@pytest.mark.parametrize("name", RELEASED)
def test_released_clients_run_as_they_are(name: str, tmp_path: Path) -> None:
    address = f"https://raw.githubusercontent.com/BricksRL/bricksrl/main/bricksrl/environments/{name}_v0/client.py"
    (tmp_path / "client.py").write_bytes(urllib.request.urlopen(address, timeout=30).read())
    commands, answer, ports, sensors = RELEASED[name]
    robot = Robot(
        "released",
        HubKind.PRIME,
        tuple(Motor(f"m{port}", port) for port in ports),
        sensors,
        needs_imu=True,
    )
    interface = Interface(
        tuple(ClientCommand(f"action_{i}") for i in range(len(commands) - 1)),
        tuple(ClientChannel(f"state_{i}", -2000, 2000) for i in range(len(answer) - 1)),
        UntilDone(),
    )
    readings = {"color": lambda _: 0.0} if "color" in [sensor.name for sensor in sensors] else {}
    link = ClientLink(
        VirtualHub(BenchBody(robot, readings)),
        robot,
        interface,
        OwnClient(str(tmp_path / "client.py"), commands, answer),
    )
    with link:
        if name == "roboarm":
            with pytest.raises(HubProgramError, match="NameError: name 'low_angle' isn't defined"):
                link.read()
            return
        start = link.read().values
        assert link.act([0.5] * len(interface.commands)).values != start
