"""Programs from files on a bench: that of a described robot, and the one that adapts to the
program."""

from __future__ import annotations

import io
import signal
import time
from pathlib import Path
from typing import Any

import pytest
from described import TWO_WHEELER, WALKER

from brickhub.errors import ProgramError, TwinError
from brickhub.robot import BENCH, Robot
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.given_readings import parse_reading
from brickhub.virtual.machine import Machine, Pace
from brickhub.virtual.micropython.exceptions import HostStop
from brickhub.virtual.panel import Panel, parse_press
from brickhub.virtual.run import Operation, interruptible, run_file


def run(
    folder: Path,
    source: str,
    robot: Robot | None = None,
    stdin: bytes | str | None = None,
    time_limit_s: float | None = None,
) -> tuple[int, str, str]:
    path = folder / "main.py"
    path.write_text(source)
    out, err = io.BytesIO(), io.StringIO()
    data = (
        io.StringIO(stdin)
        if isinstance(stdin, str)
        else io.BytesIO(stdin)
        if stdin is not None
        else None
    )
    code = run_file(
        path,
        None if robot is None else BenchBody(robot),
        stdout=out,
        stderr=err,
        stdin=data,
        time_limit_s=time_limit_s,
    )
    return code, out.getvalue().decode(), err.getvalue()


def test_a_program_prints_clean_lines(tmp_path: Path) -> None:
    assert run(tmp_path, "print('a')\nprint(1/3)") == (0, "a\n0.33333334\n", "")


def test_the_two_wheeler_turns_its_wheels(tmp_path: Path) -> None:
    source = """
from pybricks.pupdevices import Motor, UltrasonicSensor
from pybricks.parameters import Port, Direction
from pybricks.robotics import DriveBase
from pybricks.hubs import PrimeHub
hub = PrimeHub()
base = DriveBase(Motor(Port.E, Direction.COUNTERCLOCKWISE), Motor(Port.A), 56, 130)
eyes = UltrasonicSensor(Port.C)
base.straight(100)
print(abs(base.distance() - 100) <= 3, eyes.distance())
base.turn(90)
print(abs(base.angle() - 90) <= 3, hub.imu.heading())
"""
    assert run(tmp_path, source, TWO_WHEELER) == (0, "True 2000\nTrue 0.0\n", "")


class ClosedPipe(io.RawIOBase):
    """An output whose reader has left."""

    def write(self, data: object) -> int:
        raise BrokenPipeError


@pytest.mark.parametrize("handler", ["except OSError", "except BaseException", "except"])
def test_program_whose_reader_has_left_ends(tmp_path: Path, handler: str) -> None:
    path, err = tmp_path / "main.py", io.StringIO()
    path.write_text(
        f"for i in range(5):\n    try:\n        print(i)\n    {handler}:\n        pass\n"
    )
    with pytest.raises(BrokenPipeError):
        run_file(path, stdout=ClosedPipe(), stderr=err)
    assert err.getvalue() == ""


def test_error_has_traceback(tmp_path: Path) -> None:
    source = (
        "from pybricks.pupdevices import Motor\nfrom pybricks.parameters import Port\n"
        "print(1)\nMotor(Port.B)\nprint(2)"
    )
    code, out, err = run(tmp_path, source, TWO_WHEELER)
    assert (code, out) == (1, "1\n")
    assert err.startswith(
        'Traceback (most recent call last):\n  File "main.py", line 4, in <module>\n'
        "OSError: [Errno 19] ENODEV: "
    )


@pytest.mark.parametrize("base", ["BaseException", "KeyboardInterrupt", "GeneratorExit"])
def test_any_program_exception_is_reported(tmp_path: Path, base: str) -> None:
    code, _, err = run(tmp_path, f"class Mine({base}):\n    pass\nraise Mine(3)")
    assert (code, err.splitlines()[-1]) == (1, "Mine: 3")


def test_program_may_exit(tmp_path: Path) -> None:
    source = "print(1)\nclass Over(SystemExit):\n    pass\nraise {}\nprint(2)"
    assert run(tmp_path, source.format("SystemExit(3)")) == (
        0,
        "1\n",
        "The program was stopped (SystemExit).\n",
    )
    assert run(tmp_path, source.format("Over")) == (0, "1\n", "The program was stopped (Over).\n")


_CALM_LOOP = """
    class Calm:
        def __enter__(self):
            pass
        def __exit__(self, *error):
            return True
    with Calm():
        wait(10)
"""


@pytest.mark.parametrize(
    "loop",
    [
        "wait(100)",
        "pass",
        "watch.time()",
        "print(end='')",
        "try:\n        wait(10)\n    except:\n        pass",
        _CALM_LOOP,
    ],
)
def test_the_time_limit_stops_any_loop(tmp_path: Path, loop: str) -> None:
    source = (
        "from pybricks.tools import wait, StopWatch\nwatch = StopWatch()\nprint('go')\n"
        f"while True:\n    {loop}\n"
    )
    assert run(tmp_path, source, time_limit_s=0.5) == (
        124,
        "go\n",
        "The program was stopped at the time limit of 0.5 s.\n",
    )


def test_input_is_passed(tmp_path: Path) -> None:
    source = "import usys\nprint(usys.stdin.buffer.read(3))\nprint(input())"
    assert run(tmp_path, source, stdin=b"abcdef\r") == (0, "b'abc'\ndef\ndef\n", "")
    code, _, err = run(tmp_path, source)
    assert code == 1
    assert "EOFError: the program waits for input" in err


@pytest.mark.parametrize(
    ("source", "typed", "read"),
    [
        ("print([input(), input()])", "ab\ncd\n", "['ab', 'cd']"),
        ("print([input(), input()])", b"ab\r\ncd\r\n", "['ab', 'cd']"),
        ("print(repr(input()))", "abc\x7f\x08d\xe4e\n", "'ade'"),
        (
            "try:\n    input()\nexcept KeyboardInterrupt:\n    print('interrupt')",
            "ab\x03",
            "abinterrupt",
        ),
        ("try:\n    input()\nexcept EOFError:\n    print('end')", "\x04", "end"),
        (
            "import usys\nprint([usys.stdin.readline(), usys.stdin.read(3)])",
            "ab\ncd\n",
            "['ab\\n', 'cd\\n']",
        ),
        (
            "import usys\nprint(len(usys.stdin.read(2)), usys.stdin.buffer.read(2))",
            "\xe4bcd",
            "2 b'cd'",
        ),
        ("import usys\nprint(usys.stdin.buffer.read(3))", b"a\nb", "b'a\\nb'"),
    ],
)
def test_typed_input(tmp_path: Path, source: str, typed: bytes | str, read: str) -> None:
    """By ``shared/readline/readline.c`` and ``sys_stdio_mphal.c`` of MicroPython 1.26."""
    code, out, err = run(tmp_path, source, stdin=typed)
    assert (code, out.splitlines()[-1], err) == (0, read, "")


def test_syntax_error(tmp_path: Path) -> None:
    code, out, err = run(tmp_path, "print(1)\nx = = 2\n")
    assert (code, out) == (1, "")
    assert err.splitlines()[1:] == ['  File "main.py", line 2', "SyntaxError: invalid syntax"]


def test_syntax_error_in_a_module_is_found_before_the_program_runs(tmp_path: Path) -> None:
    (tmp_path / "arm.py").write_text("x = 1\ny = = 2\n", encoding="utf-8")
    code, out, err = run(tmp_path, "print(1)\nimport arm")
    assert (code, out) == (1, "")
    assert err == (
        'Traceback (most recent call last):\n  File "arm.py", line 2\nSyntaxError: invalid syntax\n'
    )


def test_long_integer_in_a_module_is_found_when_it_is_imported(tmp_path: Path) -> None:
    (tmp_path / "arm.py").write_text("x = 12345678901\n", encoding="utf-8")
    code, out, err = run(tmp_path, "print(1)\nimport arm")
    assert (code, out) == (1, "1\n")
    assert err.endswith("OverflowError: long int not supported in this build\n")


def test_missing_program_file_raises(tmp_path: Path) -> None:
    with pytest.raises(ProgramError, match="nowhere.py"):
        run_file(tmp_path / "nowhere.py", stdout=io.BytesIO(), stderr=io.StringIO())


def test_modules_beside_program_are_importable(tmp_path: Path) -> None:
    (tmp_path / "helper.py").write_text(
        "def halve(x):\n    return x / 0\nthird = 1 / 3\nprint(__name__)\n"
    )
    code, out, err = run(
        tmp_path, "import helper\nfrom helper import halve, third\nprint(third)\nhalve(1)\n"
    )
    assert (code, out) == (1, "helper\n0.33333334\n")
    assert err == (
        "Traceback (most recent call last):\n"
        '  File "main.py", line 4, in <module>\n'
        '  File "helper.py", line 2, in halve\n'
        "ZeroDivisionError: divide by zero\n"
    )


def fitted(
    folder: Path, source: str, *, press: str = "", reading: str = "", **operation: Any
) -> tuple[int, str, str]:
    path = folder / "main.py"
    path.write_text(
        (
            "from pybricks.pupdevices import *\nfrom pybricks.parameters import *\n"
            "from pybricks.tools import *\n"
        )
        + source
    )
    out, err = io.BytesIO(), io.StringIO()
    done = Operation(
        [*map(parse_press, press.split())], [*map(parse_reading, reading.split())], **operation
    )
    code = run_file(path, stdout=out, stderr=err, time_limit_s=60, operation=done)
    return code, out.getvalue().decode(), err.getvalue()


@pytest.mark.parametrize(
    ("name", "ports"),
    [
        ("PrimeHub", "ABCDEF"),
        ("InventorHub", "ABCDEF"),
        ("EssentialHub", "AB"),
        ("TechnicHub", "ABCD"),
        ("CityHub", "AB"),
    ],
)
def test_bench_has_imported_hub(tmp_path: Path, name: str, ports: str) -> None:
    source = (
        f"from pybricks.hubs import {name}\nhub = {name}()\n"
        "print([hasattr(Port, p) for p in 'ABCDEF'].count(True))"
    )
    assert fitted(tmp_path, source) == (0, f"{len(ports)}\n", "")


def test_hub_import_in_module_counts(tmp_path: Path) -> None:
    (tmp_path / "parts.py").write_text("from pybricks.hubs import CityHub\nhub = CityHub()\n")
    assert fitted(tmp_path, "from parts import hub\nprint(hub)") == (0, "<CityHub>\n", "")


def test_bench_has_used_devices(tmp_path: Path) -> None:
    source = """
motor, color, eyes = Motor(Port.A), ColorSensor(Port.B), UltrasonicSensor(Port.C)
force, tilt, infrared = ForceSensor(Port.D), TiltSensor(Port.E), InfraredSensor(Port.F)
print(color.color(), color.reflection(), color.ambient(), eyes.distance(), force.force(), tilt.tilt(), infrared.distance())
motor.run_angle(500, 90)
print(motor.angle() in (89, 90))
for kind in (ColorSensor, Motor):
    try:
        print(kind(Port.C))
    except OSError as e:
        print(e.errno)
remote = Remote()
print(remote.buttons.pressed())
"""  # noqa: E501
    assert fitted(tmp_path, source) == (
        0,
        "Color.NONE 0 0.0 2000 0.0 (0, 0) 100\nTrue\n19\n19\nset()\n",
        "",
    )


def test_sensors_have_given_readings(tmp_path: Path) -> None:
    source = """
color, eyes, force = ColorSensor(Port.A), UltrasonicSensor(Port.B), ForceSensor(Port.C)
tilt, both, infrared = TiltSensor(Port.D), ColorDistanceSensor(Port.E), InfraredSensor(Port.F)
print(color.color(), color.ambient(), eyes.distance(), force.force(), force.pressed(), tilt.tilt())
print(both.color(), both.distance(), infrared.distance())
"""
    reading = "A=red A.ambient=30% B=200mm C=5N D=10,-5deg E=blue E.distance=40% F=20%"
    printed = "Color.RED 3.0 200 5.0 True (10, -5)\nColor.BLUE 40 20\n"
    assert fitted(tmp_path, source, reading=reading) == (0, printed, "")


def test_readings_from_file_over_time(tmp_path: Path) -> None:
    (tmp_path / "colors.csv").write_text(
        "0, red\n# seconds, color\n1.5, green\n3, 240,100,100\n", "utf-8-sig"
    )
    source = (
        "color = ColorSensor(Port.A)\nfor i in range(4):\n    print(color.color())\n    wait(1000)"
    )
    done = fitted(tmp_path, source, reading=f"A=@{tmp_path / 'colors.csv'}")
    assert done == (0, "Color.RED\nColor.RED\nColor.GREEN\nColor.BLUE\n", "")


@pytest.mark.parametrize(
    ("reading", "says"),
    [
        ("A", "'A' is not a reading"),
        ("A=purple", "'A=purple' is not a reading"),
        ("A.smell=3", "nothing senses 'smell'"),
        ("A=1,2,3,4", "is not a reading"),
        ("A=nan", "is not a reading"),
        ("A=@nowhere", "cannot read the readings"),
    ],
)
def test_invalid_readings_raise(tmp_path: Path, reading: str, says: str) -> None:
    with pytest.raises(TwinError, match=says):
        fitted(tmp_path, "ColorSensor(Port.A)", reading=reading)


@pytest.mark.parametrize(
    ("reading", "says"),
    [
        ("A=200mm", "the ColorSensor on port A senses surface or ambient, not distance"),
        ("A=1,2", "(1.0, 2.0) is not a surface"),
    ],
)
def test_mismatched_readings_raise_at_sensor(tmp_path: Path, reading: str, says: str) -> None:
    code, _, err = fitted(tmp_path, "ColorSensor(Port.A)", reading=reading)
    assert code == 1 and "line 4" in err and says in err


def test_hub_menu_without_presses_has_traceback(tmp_path: Path) -> None:
    code, _, err = fitted(tmp_path, "hub_menu('A', 'B')")
    assert code == 1 and "line 4" in err and "--press" in err


def test_module_in_a_folder_above_is_named(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "arm.py").write_text("up = 5")
    (tmp_path / "runs").mkdir()
    code, _, err = run(tmp_path / "runs", "import parts.arm")
    assert code == 1
    assert err.endswith(
        "no module named 'parts.arm'\n"
        f"A program imports what lies beside it; move it to {tmp_path}, where parts.arm is.\n"
    )
    assert run(tmp_path / "runs", "import parts.leg")[2].endswith("no module named 'parts.leg'\n")


def test_readings_need_bench_and_valid_port(tmp_path: Path) -> None:
    with pytest.raises(TwinError, match="the city hub has no port E"):
        fitted(tmp_path, "from pybricks.hubs import CityHub", reading="E=red")
    (tmp_path / "main.py").write_text("")
    operation = Operation(readings=[parse_reading("A=red")])
    with pytest.raises(TwinError, match="--robot bench"):
        run_file(
            tmp_path / "main.py",
            BenchBody(WALKER),
            stdout=io.BytesIO(),
            stderr=io.StringIO(),
            operation=operation,
        )


def test_bench_motors_with_end_stops_or_without_sensor(tmp_path: Path) -> None:
    source = (
        "arm, plain = Motor(Port.A), DCMotor(Port.B)\n"
        "print(arm.run_until_stalled(300, duty_limit=50))\n"
    )
    source += (
        "plain.dc(50)\nprint(plain, plain.settings())\nplain.brake()\nplain.stop()\nplain.close()"
    )
    printed = "120\nDCMotor(Port.B, Direction.CLOCKWISE) (9000,)\n"
    assert fitted(tmp_path, source, end_stops={"A": (-90.0, 120.0)}) == (0, printed, "")


def test_bench_blocks_motors_that_run_until_stalled(tmp_path: Path) -> None:
    source = """
from pybricks.parameters import Direction
from pybricks.robotics import Car
arm = Motor(Port.A, Direction.COUNTERCLOCKWISE)
for speed in (200, -200, 200):
    print(round(arm.run_until_stalled(speed, duty_limit=50) / 10))
car = Car(Motor(Port.C), Motor(Port.D))
car.steer(100)
"""
    code, printed, told = fitted(tmp_path, source)
    assert (code, printed) == (0, "9\n0\n9\n")
    assert [line.partition(" after")[0] for line in told.splitlines()] == [
        f"The bench blocks the motor on port {port}" for port in "AC"
    ]


def test_xbox_controller_is_near(tmp_path: Path) -> None:
    source = """
from pybricks.iodevices import XboxController
box = XboxController()
def show():
    print(box.joystick_left(), box.joystick_right(), box.triggers(), box.dpad(), box.state(), box.buttons.pressed())
print(box.name(), box.profile(), box.rumble(50))
show()
wait(500)
show()
box.disconnect()
try:
    show()
except OSError as e:
    print(e.errno)
"""  # noqa: E501
    names = (
        "a rb p2 up right right_trigger joystick_left_up joystick_left_right joystick_right_down"
    )
    code, out, err = fitted(
        tmp_path, source, press=" ".join(f"xbox.{name}@0.9s+1s" for name in names.split())
    )
    assert (code, err) == (0, "")
    name, at_rest, used, errno = out.splitlines()
    assert (name, errno) == ("Xbox Wireless Controller 0 None", "19")
    assert at_rest == "(0, 0) (0, 0) (0, 0) 0 (0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0) set()"
    assert used.startswith(
        "(100, 100) (0, -100) (0, 100) 2 (32768, -32767, 0, 32768, 0, 1023, 2, 129, 0, 0, 0, 2) "
        "{Button."
    )
    assert sorted(used.partition("{")[2].strip("}").split(", ")) == [
        f"Button.{b}" for b in ("A", "P2", "RB", "RIGHT", "UP")
    ]


def test_operation_presses_buttons(tmp_path: Path) -> None:
    source = (
        "from pybricks.hubs import PrimeHub\nhub = PrimeHub()\nprint(hub_menu('A', 'B'))\n"
        "wait(9000)"
    )
    done = fitted(tmp_path, source, press="right@1s center@2s center@3s")
    assert done == (0, "B\n", "The program was stopped (SystemExit).\n")


def test_panel_can_be_watched(tmp_path: Path) -> None:
    seen: list[str] = []

    def watch(panel: Panel) -> None:
        panel.on_change = lambda changed: seen.append(f"{changed.now_s} {changed.describe()}")

    source = (
        "from pybricks.hubs import PrimeHub\nhub = PrimeHub()\nwait(500)\n"
        "hub.light.on(Color.BLUE)\nhub.display.number(7)\n"
    )
    source += "hub.display.pixel(0, 0)\nhub.speaker.beep(440, 100)"
    assert fitted(tmp_path, source, watch=watch)[0] == 0
    assert seen[0] == "0.5 light hue 240, 100 %, 100 %; display off; sound off"
    assert seen[1].endswith("display 7; sound off")
    assert (
        seen[3].endswith("sound 440")
        and seen[4].startswith("0.6 ")
        and seen[4].endswith("sound off")
    )


def test_realtime_program_takes_real_time(tmp_path: Path) -> None:
    start_s = time.monotonic()
    assert fitted(tmp_path, "wait(300)", realtime=True)[0] == 0
    assert 0.29 < time.monotonic() - start_s < 2.0


def test_realtime_advances_in_small_steps() -> None:
    now_s, pieces = [0.0], []

    def sleep(duration_s: float) -> None:
        pieces.append(duration_s)
        now_s[0] += duration_s

    machine = Machine(BenchBody(BENCH))
    machine.pace = Pace(lambda: now_s[0], sleep)
    machine.advance(300)
    assert max(pieces) <= 0.015 and sum(pieces) == pytest.approx(0.3)


class Ended(HostStop):
    """An end of the host, in a module that the virtual hub does not know."""


def ending(error: type[BaseException]) -> Operation:
    """A host that raises an error after half a second."""

    def attend(machine: Machine) -> None:
        machine.alarm_ms = 500
        machine.on_alarm = end

    def end() -> None:
        raise error

    return Operation(attend=attend)


@pytest.mark.parametrize(
    "handler",
    ["except:", "except BaseException:", "except Exception:", "except KeyboardInterrupt:"],
)
def test_an_end_from_the_host_passes_a_program(handler: str, tmp_path: Path) -> None:
    path, out, err = tmp_path / "main.py", io.BytesIO(), io.StringIO()
    path.write_text(
        f"from pybricks.tools import wait\ntry:\n    wait(1000)\n{handler}\n    print('caught')\n"
        "print('on')\n"
    )
    with pytest.raises(Ended):
        run_file(path, stdout=out, stderr=err, operation=ending(Ended))
    assert (out.getvalue(), err.getvalue()) == (b"", "")


def test_an_interrupt_at_the_end_of_a_run_is_an_interrupt(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the handlers are just being set back."""
    before = signal.getsignal(signal.SIGINT)
    handle = signal.signal
    late = [signal.SIGINT]

    def interrupted(number: int, handler: Any) -> Any:
        if handler is before and late:
            signal.raise_signal(late.pop())
        return handle(number, handler)

    with pytest.raises(KeyboardInterrupt), interruptible():
        monkeypatch.setattr(signal, "signal", interrupted)
    assert signal.getsignal(signal.SIGINT) is before


def test_a_program_that_is_too_large_for_the_hub_is_refused(tmp_path: Path) -> None:
    program = tmp_path / "main.py"
    lines = [f"text_{n} = '{n:0200}'" for n in range(110)]
    program.write_text("\n".join(["from pybricks.hubs import CityHub", *lines]), encoding="utf-8")
    with pytest.raises(ProgramError, match="the program has .* bytes, the city hub takes 20480"):
        run_file(program, stdout=io.BytesIO())
    program.write_text("\n".join(["from pybricks.hubs import CityHub", *lines[:80]]))
    assert run_file(program, stdout=io.BytesIO()) == 0
