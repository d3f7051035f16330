"""A program on a virtual hub on the page."""

from __future__ import annotations

import base64
import io
import socket
import threading
import time
import urllib.request
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from brickhub.robot import HubKind
from brickhub.virtual.panel import Panel
from brickhub.virtual.room import HubProgramFile, Room
from brickhub.virtual.run import Operation, run_file
from bricksrl.errors import PageError
from bricksrl.page.program import ProgramPage
from bricksrl.page.robot_view import panel_of
from bricksrl.page.server import PageOptions
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.arena import Arena, Contestant, Place
from bricktwin.twin.make_body import make_body
from bricktwin.twin.mujoco_arena import ArenaWorld

PROGRAM = """
from pybricks.hubs import TechnicHub
from pybricks.parameters import Color, Port
from pybricks.pupdevices import Motor
from pybricks.tools import wait
hub = TechnicHub()
hub.light.on(Color.GREEN)
motor = Motor(Port.{port})
motor.run(500)
while True:
    try:
        wait(10)
    except SystemExit:
        pass
"""


def test_program_is_shown_and_stopped(tmp_path: Path) -> None:
    path = tmp_path / "main.py"
    body = make_body(TWO_WHEELER)
    name = TWO_WHEELER.hub.model.class_name
    path.write_text(PROGRAM.format(port=TWO_WHEELER.motors[0].port).replace("TechnicHub", name))
    said = io.StringIO()
    with ProgramPage("main.py") as page:

        def stop_once_shown() -> None:
            while (
                page.board.poses[0] < 5
                or (page.board.status[1].get("hub") or {}).get("light") is None
            ):
                time.sleep(0.02)
            page.stop()

        thread = threading.Thread(target=stop_once_shown)
        thread.start()
        code = run_file(
            path, body, stdout=io.BytesIO(), stderr=said, operation=Operation(attend=page.attend)
        )
        thread.join()
        status = page.board.status[1]
    assert code == 0 and "stopped" in said.getvalue(), "also a program that takes no SystemExit"
    assert status["state"] == "stopped" and status["controls"] == ["stop", "speed", "pull"]
    assert page.board.drawing[0] == 1


DRIVES_ON = """
from pybricks.parameters import Port
from pybricks.pupdevices import Motor
from pybricks.tools import wait
motor = Motor(Port.A)
while True:
    motor.run(300)
    wait(10)
"""


def test_robots_of_several_programs_are_shown_in_one_world_and_stopped(tmp_path: Path) -> None:
    """The first program ends at once: the world is shown and the others are stopped even so."""
    paths = []
    for name, text in (("short", "print('over')\n"), ("one", DRIVES_ON), ("two", DRIVES_ON)):
        (tmp_path / f"{name}.py").write_text(text)
        paths.append(tmp_path / f"{name}.py")
    starts = ((0.0, 0.0), (0.5, 0.5), (1.0, 1.0))
    robots = [Contestant(f"r{y_m[0]:g}", TWO_WHEELER, Place(y_m=y_m)) for y_m in starts]
    world = ArenaWorld(Arena(tuple(robots)))
    world.place(np.random.default_rng(0))
    errors = io.StringIO()
    with ProgramPage("several") as page:
        operation = Operation(attend=lambda machine: page.attend_together(machine, world))
        programs = []
        for path, body in zip(paths, world.bodies, strict=True):
            programs.append(HubProgramFile(path, body, operation))
        room = Room(programs, stdout=io.BytesIO(), stderr=errors)
        world.runners = [partial(room.run_until, number) for number in range(3)]

        def stop_once_shown() -> None:
            while page.board.poses[0] < 5:
                time.sleep(0.02)
            page.stop()

        thread = threading.Thread(target=stop_once_shown)
        thread.start()
        codes = room.run()
        thread.join()
        assert page.has_stopped()
        drawing = page.board.drawing[1]
        assert drawing is not None
        drawn = [body.name for body in drawing.bodies]
        status = page.board.status[1]
    assert codes == [0, 0, 0] and errors.getvalue().count("stopped") == 2
    assert status["subtitle"] == "3 programs on virtual hubs in one room"
    for contestant in robots:
        assert any(name.startswith(f"{contestant.name}/") for name in drawn)


def test_used_port_raises() -> None:
    with ProgramPage("one") as page:
        port = int(page.url.split(":")[2].split("/")[0])
        with (
            pytest.raises(PageError, match="name another host or port") as caught,
            ProgramPage("two", PageOptions("127.0.0.1", port)),
        ):
            pass
        assert "\n" not in str(caught.value)
        with ProgramPage("three") as another:
            assert another.url != page.url, "without a name the next free port is taken"
    for bad in (PageOptions("256.0.0.1"), PageOptions(page_port=70000), PageOptions(page_port=-1)):
        with pytest.raises(PageError), ProgramPage("bad", bad):
            pass


@pytest.mark.skipif(not socket.has_dualstack_ipv6(), reason="this computer has no IPv6")
def test_page_on_all_addresses_is_where_it_says() -> None:
    with (
        ProgramPage("all", PageOptions("::", 0)) as page,
        urllib.request.urlopen(page.url, timeout=10) as answer,
    ):
        assert answer.status == 200


def test_unknown_host_raises() -> None:
    with (
        pytest.raises(
            PageError, match=r"on no\.invalid:8090 \([^()]+\); name another host or port"
        ),
        ProgramPage("nowhere", PageOptions("no.invalid")),
    ):
        pass


@pytest.mark.parametrize(
    ("hub", "pixels"), [(HubKind.PRIME, 25), (HubKind.TECHNIC, 0), (HubKind.CITY, 0)]
)
def test_only_hubs_with_a_display_show_one(hub: HubKind, pixels: int) -> None:
    assert len(panel_of(Panel(hub))["display"] or ()) == pixels


def test_screen_of_a_brick_goes_to_the_page_as_four_pixels_a_byte() -> None:
    panel = Panel(HubKind.EV3)
    assert panel_of(panel)["screen"] == {"width": 178, "height": 128, "pixels": ""}
    panel.change(screen=bytes((3, 2, 1, 0)) + bytes(178 * 128 - 4))
    pixels = base64.b64decode(panel_of(panel)["screen"]["pixels"])
    assert (pixels[0], len(pixels)) == (0b11100100, 178 * 128 // 4)
    assert panel_of(Panel(HubKind.PRIME))["screen"] is None
