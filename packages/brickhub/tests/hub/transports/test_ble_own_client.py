"""A client program of a user's own over Bluetooth."""

from __future__ import annotations

from pathlib import Path

import pytest
from ble_world import World, bounded

from brickhub.errors import HubProgramError, HubTimeoutError
from brickhub.hub.interface import ClientChannel, ClientCommand, Interface, UntilDone
from brickhub.hub.link.own_client import ClientLink, OwnClient

pytestmark = pytest.mark.realtime

CLIENT = """import ustruct
from micropython import kbd_intr
from pybricks.tools import wait
from usys import stdin, stdout

kbd_intr(-1)
while True:
    numbers = ustruct.unpack("!ffffff", stdin.buffer.read(24))
    wait(5000 if numbers[0] == 3 else 20)
    stdout.buffer.write(ustruct.pack("!ffffff", *[1 / (x - 9) for x in numbers]))
"""
INTERFACE = Interface(
    tuple(ClientCommand(f"a{i}", -9, 9) for i in range(6)),
    tuple(ClientChannel(f"s{i}", -9, 9) for i in range(6)),
    UntilDone(500),
)


def linked(world: World, folder: Path) -> ClientLink:
    (folder / "client.py").write_text(CLIENT)
    client = OwnClient(str(folder / "client.py"), "!ffffff", "!ffffff")
    link = ClientLink(world.transport(), world.robot, INTERFACE, client, timeout_s=1.0)
    world.hub.files["client.py"] = link.program.source
    return link


def test_commands_and_answers_longer_than_a_packet(world: World, tmp_path: Path) -> None:
    with linked(world, tmp_path) as link:
        assert link.read().values == pytest.approx([-1 / 9] * 6)
        for step in range(5):
            assert link.act([1, 2, -1, step, 5, 6]).values == pytest.approx(
                [1 / (x - 9) for x in (1, 2, -1, step, 5, 6)]
            )
    assert not world.hub.is_running


def test_traceback_and_silence_are_told(world: World, tmp_path: Path) -> None:
    link = linked(world, tmp_path)
    link.open()
    error = bounded(lambda: link.act([9, 0, 0, 0, 0, 0]), HubProgramError)
    assert "ZeroDivisionError" in str(error) and "line 10" in str(error)
    link.open()
    bounded(lambda: link.act([3, 0, 0, 0, 0, 0]), HubTimeoutError)
    link.open()
    assert link.act([1, 1, 1, 1, 1, 1]).values == pytest.approx([-1 / 8] * 6), (
        "of the late answer nothing is left"
    )
    link.close()
    assert not world.hub.is_running
