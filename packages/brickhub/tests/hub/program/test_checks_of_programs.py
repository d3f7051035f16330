"""What is said of a program before it runs: names that nothing sets, modules that no hub has, which
hub it is for, and its lines in other languages."""

from __future__ import annotations

import pytest

from brickhub.errors import ProgramError
from brickhub.hub.program.compile import check_program, imported_modules
from brickhub.hub.program.imported_hub import imported_hub
from brickhub.hub.program.lego_languages import language_note, language_of, other_lines
from brickhub.hub.program.syntax import imported_names, parse
from brickhub.hub.transport import HubModule, HubProgram
from brickhub.robot import HubKind

ARM = HubModule("parts.arm", "parts/arm.py", "REACH = 3\n")


def checked(source: str, hub: HubKind = HubKind.PRIME, *modules: HubModule) -> int:
    """Size of a program on a hub."""
    return check_program(HubProgram(source, 0, name="wave.py", modules=modules), hub)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("\nx = y\n", "wave.py, line 2: nothing sets 'y'; define it, or correct the name"),
        ("def f():\n    return g()\n", "wave.py, line 2: nothing sets 'g'; define it, or correct"),
        ("b = c\na = d\n", "wave.py, line 1: nothing sets 'c'; define it"),
        (
            "import ustruckt\n",
            r"wave.py: the hub has no module 'ustruckt' \(did you mean 'ustruct'\?\); put it",
        ),
        ("from arm import REACH\n", "wave.py: the hub has no module 'arm'; put it beside the prog"),
        ("import pybricks.ev3devices\n", r"wave.py: the hub has no module 'pybricks.ev3devices'"),
    ],
)
def test_what_fails_only_on_the_hub_is_said_before(source: str, message: str) -> None:
    with pytest.raises(ProgramError, match=f"^{message}"):
        checked(source)


@pytest.mark.parametrize(
    "source",
    [
        "def f():\n    global x\n    x = 1\n\n\nf()\nprint(x)\n",
        "import usys as system\nprint(system)\n",
        "from pybricks.tools import wait\nwait(1)\n",
        "class A:\n    b = 1\n    c = b\n",
        "def f(a, *b, **c):\n    return [d for d in (a, b, c)]\n",
        "for i in range(3):\n    print(i)\nprint(i, __name__)\n",
        "import sys, ujson, gc, micropython, errno, pybricks.messaging\nprint(sys, ujson, gc)\n",
    ],
)
def test_what_runs_on_the_hub_is_accepted(source: str) -> None:
    assert checked(source) > 20


def test_modules_beside_a_program_are_checked_too() -> None:
    alone = checked("x = 1\n")
    assert checked("from parts.arm import REACH\nx = REACH\n", HubKind.PRIME, ARM) > alone
    wrong = HubModule("parts.arm", "parts/arm.py", "x = 1\nREACH = y\n")
    with pytest.raises(ProgramError, match=r"^parts/arm\.py, line 2: nothing sets 'y'"):
        checked("from parts.arm import REACH\n", HubKind.PRIME, wrong)


def test_devices_of_an_ev3_are_on_an_ev3() -> None:
    source = "from pybricks.ev3devices import Motor\nfrom pybricks.nxtdevices import LightSensor\n"
    assert checked(source, HubKind.EV3) > 20
    with pytest.raises(ProgramError, match=r"no module 'pybricks\.(ev3|nxt)devices'"):
        checked(source)


def test_program_too_large_for_its_hub() -> None:
    source = "\n".join(f"x{n} = 'abcdefghijklmnopqrstuvwxyz{n}'" for n in range(600)) + "\n"
    assert checked(source) > 20 * 1024
    with pytest.raises(ProgramError, match="the city hub takes 20480; make it shorter"):
        checked(source, HubKind.CITY)


@pytest.mark.parametrize(
    ("source", "kind"),
    [
        ("print(1)\n", HubKind.PRIME),
        ("from pybricks.hubs import CityHub\n", HubKind.CITY),
        ("from pybricks.hubs import InventorHub\n", HubKind.PRIME),
        ("from pybricks.hubs import EV3Brick\n", HubKind.EV3),
        # That is the other name of an EV3, but a Prime hub is meant.
        ("from pybricks.hubs import PrimeHub\n", HubKind.PRIME),
        ("from pybricks.hubs import TechnicHub as Hub\n", HubKind.TECHNIC),
        ("from pybricks.ev3devices import Motor\n", HubKind.EV3),
        ("from pybricks.pupdevices import Motor\n", HubKind.PRIME),
        # The hub says more than its devices.
        (
            "from pybricks.ev3devices import Motor\nfrom pybricks.hubs import MoveHub\n",
            HubKind.MOVE,
        ),
        ("from pybricks.tools import DataLog\n", HubKind.EV3),
        ("from pybricks import ev3brick\n", HubKind.EV3),
        ("from mine import CityHub\n", HubKind.PRIME),
        ("from pybricks.hubs import Nothing\n", HubKind.PRIME),
        ("x = = 3\nfrom pybricks.hubs import CityHub\n", HubKind.PRIME),
    ],
)
def test_hub_that_a_program_is_for(source: str, kind: HubKind) -> None:
    assert imported_hub(HubProgram(source, 0)) is kind


def test_hub_may_be_imported_by_a_module() -> None:
    module = HubModule("base", "base.py", "from pybricks.hubs import TechnicHub\n")
    assert imported_hub(HubProgram("from base import hub\n", 0, modules=(module,))) is (
        HubKind.TECHNIC
    )


def test_names_of_all_imports() -> None:
    source = "import a.b, c\nfrom d.e import f as g, h\nfrom . import i\nfrom .j import k\n"
    tree = parse(source)
    assert list(imported_names(tree)) == [("a.b", ""), ("c", ""), ("d.e", "f"), ("d.e", "h")]
    assert list(imported_modules(tree)) == ["a.b", "c", "d.e", "d.e"]


SPIKE_3 = """\
import motor as m
from hub import port, light_matrix
import runloop

async def main():
    light_matrix.write('Hi')
    await m.run_for_degrees(port.A, 360, 720)

runloop.run(main())
"""


def test_lines_of_another_language_word_by_word() -> None:
    program = HubProgram(SPIKE_3, 0)
    language = language_of(program)
    assert language is not None
    assert other_lines(program, language) == [
        (2, "port", "Port of pybricks.parameters"),
        (3, "runloop", "run_task, multitask and wait of pybricks.tools"),
        (6, "light_matrix.write", "hub.display.text(text)"),
        (7, "motor.run_for_degrees", "run_angle(speed, degrees): the speed comes first"),
        (9, "runloop.run", "run_task(main()) of pybricks.tools; several: await multitask(...)"),
    ]
    note = language_note(program)
    assert note.startswith("This program is for LEGO's SPIKE app 3; Pybricks has other names:\n")
    assert note.endswith("await multitask(...)\n")
    assert "  line 2: port: Port of pybricks.parameters\n" in note
    assert note.count("\n") == 6


@pytest.mark.parametrize(
    ("source", "lines"),
    [
        (
            "from spike import Motor as M\nm = M('A')\nm.start_at_power(30)\n",
            [
                (1, "Motor", "Motor(Port.A) of pybricks.pupdevices, with Port of pybricks.par"),
                (2, "Motor", "Motor(Port.A) of pybricks.pupdevices, with Port of pybricks.par"),
                (3, "start_at_power", "dc(percent)"),
            ],
        ),
        (
            "import hub\nhub.sound.beep(440)\nx = hub.port.A\n",
            [
                (2, "hub.sound", "hub.speaker.beep(frequency, duration)"),
                (3, "hub.port", "Motor(Port.A), ColorSensor(Port.A) ... of pybricks.pupdevices"),
            ],
        ),
        (
            "from ev3dev2.motor import OUTPUT_A, LargeMotor\nm = LargeMotor(OUTPUT_A)\nm.off()\n",
            [
                (1, "LargeMotor", "Motor(Port.A) of pybricks.ev3devices"),
                (1, "OUTPUT_A", "Port.A of pybricks.parameters"),
                (2, "LargeMotor", "Motor(Port.A) of pybricks.ev3devices"),
                (3, "off", "stop() lets it roll, brake() and hold() are methods of their own"),
            ],
        ),
        (
            "from mindstorms import MSHub\nhub = MSHub()\nhub.right_button.is_pressed()\n",
            [
                (1, "MSHub", "InventorHub() of pybricks.hubs, or PrimeHub(), which is the same"),
                (2, "MSHub", "InventorHub() of pybricks.hubs, or PrimeHub(), which is the same"),
                (3, "is_pressed", "pressed() of a ForceSensor; for the hub's buttons"),
                (3, "right_button", "Button.RIGHT in hub.buttons.pressed()"),
            ],
        ),
    ],
)
def test_lines_of_each_language(source: str, lines: list[tuple[int, str, str]]) -> None:
    program = HubProgram(source, 0)
    language = language_of(program)
    assert language is not None
    found = other_lines(program, language)
    assert [(line, what) for line, what, _ in found] == [(line, what) for line, what, _ in lines]
    for (_, _, instead), (_, _, begins) in zip(found, lines, strict=True):
        assert instead.startswith(begins)
