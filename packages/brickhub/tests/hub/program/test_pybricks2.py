"""Programs of Pybricks 1 and 2: each line that Pybricks 4 does not run is named."""

from __future__ import annotations

import io
from pathlib import Path

from brickhub.hub.program.pybricks2 import outdated, outdated_note
from brickhub.hub.program.run_program import load_program
from brickhub.hub.transport import HubProgram
from brickhub.virtual.run import run_file

TEMPLATE = """#!/usr/bin/env pybricks-micropython
from pybricks.hubs import EV3Brick
from pybricks.ev3devices import Motor, TouchSensor
from pybricks.parameters import Port, Stop
from pybricks.tools import wait, StopWatch, DataLog
from pybricks.robotics import DriveBase
from pybricks.media.ev3dev import SoundFile, ImageFile
import time

ev3 = EV3Brick()
left = Motor(Port.B)
ev3.speaker.say("hello")
ev3.speaker.play_file(SoundFile.HELLO)
ev3.screen.load_image("face.png")
left.stop(Stop.BRAKE)
time.sleep(1)
"""


def lines(source: str) -> dict[int, list[str]]:
    found: dict[int, list[str]] = {}
    for one in outdated(HubProgram(source, 0)):
        found.setdefault(one.line, []).append(f"{one.what}: {one.instead.partition(' ')[0]}")
    return found


def test_each_line_is_named_with_what_there_is_instead() -> None:
    assert lines(TEMPLATE) == {
        5: ["DataLog: nothing"],
        7: ["ImageFile: nothing", "SoundFile: there"],
        8: ["time: wait"],
        12: ["say: the"],
        13: ["SoundFile.HELLO: there", "play_file: there"],
        14: ["load_image of a file: there"],
        15: ["stop(Stop...): stop()"],
    }


def test_a_program_of_pybricks_4_has_no_such_line() -> None:
    source = """
from pybricks.hubs import EV3Brick
from pybricks.parameters import Font, Image, Port
from pybricks.tools import wait
ev3 = EV3Brick()
ev3.screen.set_font(Font.MONO_8X5_8)
ev3.screen.load_image(Image.empty(20, 20))
ev3.speaker.volume(50)
"""
    assert lines(source) == {}
    assert outdated_note(HubProgram(source, 0)) == ""


def test_the_first_version_had_a_module_for_the_brick() -> None:
    source = """from pybricks import ev3brick as brick
from pybricks.parameters import Button, Color
brick.sound.beep()
brick.display.text("hello", (60, 50))
brick.light(Color.RED)
while Button.CENTER not in brick.buttons():
    print(brick.battery.voltage())
"""
    assert lines(source) == {
        1: ["ev3brick: from"],
        3: ["brick.sound: ev3.speaker"],
        4: ["brick.display: ev3.screen"],
        5: ["brick.light: ev3.light.on(color)"],
        6: ["brick.buttons: ev3.buttons.pressed()"],
        7: ["brick.battery: ev3.battery"],
    }


def test_files_and_what_other_objects_have_too_are_named_where_they_are_old() -> None:
    source = """
with open("log.txt", "w") as file:
    file.write("done")
ev3.screen.save("screen.png")
ev3.light.on(Color.PURPLE)
if ev3.buttons.pressed()[0] == Button.LEFT:
    motor.log.save("motor.csv")
"""
    assert lines(source) == {
        2: ["open: the"],
        4: ["screen.save: the"],
        5: ["Color.PURPLE: Color.VIOLET"],
        6: ["pressed()[...]: a"],
    }


def test_modules_beside_the_program_are_read_and_may_have_such_names(tmp_path: Path) -> None:
    program = tmp_path / "main.py"
    program.write_text("import robot\nimport time\ntime.run()\n", encoding="utf-8")
    (tmp_path / "time.py").write_text("def run():\n    pass\n", encoding="utf-8")
    (tmp_path / "robot.py").write_text("import threading\n", encoding="utf-8")
    (found,) = outdated(load_program(program))
    assert (found.file, found.line, found.what) == ("robot.py", 1, "threading")


def test_a_name_that_a_module_imports_for_others_is_used(tmp_path: Path) -> None:
    program = tmp_path / "main.py"
    program.write_text("from common import *\nFont(size=3)\n", encoding="utf-8")
    common = tmp_path / "common.py"
    common.write_text("from pybricks.media.ev3dev import Font, Image\n", encoding="utf-8")
    found = {one.what: one.instead for one in outdated(load_program(program))}
    assert found["Font"] == "from pybricks.parameters import Font"
    assert found["Image"].startswith("nothing here uses it")


def test_the_note_follows_the_traceback(tmp_path: Path) -> None:
    program = tmp_path / "main.py"
    program.write_text(TEMPLATE, encoding="utf-8")
    err = io.StringIO()
    assert run_file(program, stdout=io.BytesIO(), stderr=err) == 1
    said = err.getvalue().splitlines()
    assert said[2] == "ImportError: can't import name DataLog"
    assert said[3] == "Pybricks 4 does not run these lines of Pybricks 2:"
    assert said[4] == "  line 5: DataLog: nothing here uses it; leave it out"
    assert len(said) == 13


def test_mailboxes_alone_tell_a_program_of_pybricks_2(tmp_path: Path) -> None:
    path = tmp_path / "main.py"
    path.write_text(
        "from pybricks.messaging import BluetoothMailboxServer\nserver = BluetoothMailboxServer()\n"
    )
    err = io.StringIO()
    assert run_file(path, stdout=io.BytesIO(), stderr=err) == 1
    assert "line 1: BluetoothMailboxServer: there are no mailboxes yet" in err.getvalue()
