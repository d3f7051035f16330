"""What ``brickhub run`` makes of its options: the deeds of a person, and what it refuses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import described
import pytest

from brickhub import target
from brickhub.cli import run_command
from brickhub.hub.transports.address import HubAddress
from brickhub.robot import HubKind, MotorKind, SensorKind
from brickhub.target import Target, whole_interface
from brickhub.virtual import room, run
from brickhub.virtual.bench_body import BenchBody

CAR = f"{described.__file__}:TWO_WHEELER"
ARM = f"{described.__file__}:ROBO_ARM"


@pytest.fixture
def program(tmp_path: Path) -> str:
    path = tmp_path / "main.py"
    path.write_text("print(1)\n")
    return str(path)


Given = Callable[..., SimpleNamespace]


@pytest.fixture
def given(brickhub: Any, program: str, monkeypatch: pytest.MonkeyPatch) -> Given:
    """What a program is run with, by the options of the command."""

    def run_with(*options: str) -> SimpleNamespace:
        seen = SimpleNamespace()

        def run_file(file: Path, body: Any, **named: Any) -> int:
            seen.__dict__.update(file=file, body=body, **named)
            return 7

        monkeypatch.setattr(run, "run_file", run_file)
        seen.done = brickhub("run", program, *options)
        return seen

    return run_with


def test_plain_run(given: Given, program: str) -> None:
    seen = given()
    assert seen.done.code == 7
    assert seen.file == Path(program)
    assert (seen.body, seen.stdin, seen.time_limit_s) == (None, None, None)
    operation = seen.operation
    assert (operation.presses, operation.readings) == ([], [])
    assert (dict(operation.end_stops), dict(operation.starts)) == ({}, {})
    assert (dict(operation.devices), dict(operation.own_devices)) == ({}, {})
    assert (operation.hub_name, operation.storage) == ("Pybricks Hub", None)
    assert (operation.realtime, operation.firmware) == (False, "4.1")
    assert operation.attend is None


def test_deeds_of_a_person(given: Given, tmp_path: Path) -> None:
    device = tmp_path / "gauge.py"
    device.write_text(
        "from brickhub.virtual.own_devices import OwnI2c\nGAUGE = OwnI2c(5)\nOTHER = 3\n"
    )
    seen = given(
        *("--press", "left@2.5s", "--press", "center@4s+1s"),
        *("--reading", "B=red", "--end-stop", "C=-90..120", "--start", "A=90"),
        *("--port", "A=interactive", "--port", "D=nothing", "--port", "F=ColorSensor"),
        *("--port", f"e={device}:GAUGE"),
        *("--storage", "kept.bin", "--hub-name", "Rover", "--firmware", "4.0"),
        *("--realtime", "--time-limit-s", "12.5"),
    )
    operation = seen.operation
    assert seen.time_limit_s == 12.5
    assert [(press.button, press.start_s) for press in operation.presses] == [
        ("left", 2.5),
        ("center", 4.0),
    ]
    assert [(one.port, one.values) for one in operation.readings] == [("B", ((0, 100, 100),))]
    assert dict(operation.end_stops) == {"C": (-90.0, 120.0)}
    assert dict(operation.starts) == {"A": 90.0}
    assert dict(operation.devices) == {
        "A": MotorKind.INTERACTIVE,
        "D": None,
        "F": SensorKind.COLOR,
    }
    assert list(operation.own_devices) == ["E"]
    assert (operation.hub_name, operation.storage) == ("Rover", Path("kept.bin"))
    assert (operation.realtime, operation.firmware) == (True, "4.0")


def test_robot_has_its_end_stops_in_its_body(given: Given) -> None:
    seen = given("--robot", ARM, "--end-stop", "A=-150..10")
    assert seen.body.robot.name == "robo-arm"
    # They are not said twice.
    assert dict(seen.operation.end_stops) == {}
    assert given("--robot", "bench").body is None


def test_faulty_robot(given: Given) -> None:
    seen = given("--robot", CAR, "--fault", "battery=6.2")
    assert seen.body.battery_mv == 6200


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--robot", CAR, "--robot", CAR), "--robot is named 2 times for one program; name it"),
        (("--fault", "battery=6.2"), "faults are those of a robot; name one with --robot, or say"),
        (
            ("--robot", CAR, "--fault", "link=12s"),
            "a program of one's own runs without a link; leave out --fault link, or practise",
        ),
        (("--hub", "ble", "--panel"), "leave out --hub, or --panel"),
        (("--hub", "ble", "--storage", "x"), "leave out --hub, or --storage"),
        (("--hub", "pigeon"), "there is no hub 'pigeon'"),
        (("--port", "A=interactive", "--port", "a=interactive"), "--port"),
    ],
)
def test_options_that_do_not_go_together(
    fails: Any, program: str, options: tuple[str, ...], says: str
) -> None:
    fails("run", program, *options, says=says)


def test_real_hub_takes_a_program_and_a_time(
    brickhub: Any, program: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from brickhub.hub.program import run_program

    asked = []
    transport = SimpleNamespace(close=lambda: asked.append("closed"))

    def transport_to(self: HubAddress, kind: HubKind) -> Any:
        asked.append((self.medium, self.which, kind))
        return transport

    def run_it(transport: Any, loaded: Any, **options: Any) -> int:
        asked.append((loaded.source, options["time_limit_s"], options["stdin"]))
        options["stdout"].write(b"turned\n")
        options["stderr"].write("hot\n")
        return 1

    monkeypatch.setattr(HubAddress, "transport", transport_to)
    monkeypatch.setattr(run_program, "run_program", run_it)
    done = brickhub("run", program, "--hub", "ble:Rover", "--time-limit-s", "3")
    assert (done.code, done.out, done.err) == (1, "turned\n", "hot\n")
    assert asked == [("ble", "Rover", HubKind.PRIME), ("print(1)\n", 3.0, None), "closed"]


def test_file_in_the_output_is_saved_beside_the_program(
    brickhub: Any, program: str, tmp_path: Path
) -> None:
    lines = ["before", "PB_OF:log.csv", "1,2", "3,4", "PB_EOF", "after"]
    Path(program).write_text("".join(f"print({line!r})\n" for line in lines))
    done = brickhub("run", program)
    assert (done.code, done.out) == (0, "before\nafter\n")
    assert done.err == f"saved {tmp_path / 'log.csv'} (2 lines)\n"
    assert (tmp_path / "log.csv").read_text() == "1,2\n3,4\n"


def test_log_of_a_run(brickhub: Any, fails: Any, program: str, tmp_path: Path) -> None:
    Path(program).write_text(
        "from pybricks.parameters import Port\nfrom pybricks.pupdevices import Motor\n"
        "Motor(Port.A).run_angle(500, 90)\n1 / 0\n"
    )
    log = tmp_path / "new" / "run.csv"
    assert brickhub("run", program, "--log", str(log)).code == 1
    head, *rows = log.read_text().splitlines()
    assert head.startswith("time_s,A_angle_deg")
    assert len(rows) > 10
    fails("run", program, "--log", str(tmp_path), says="cannot write")


def test_panel_is_told_on_standard_error(brickhub: Any, program: str) -> None:
    Path(program).write_text(
        "from pybricks.hubs import CityHub\nfrom pybricks.parameters import Color\n"
        "hub = CityHub()\nhub.light.on(Color.RED)\n"
    )
    done = brickhub("run", program, "--panel")
    assert done.code == 0
    first = done.err.splitlines()[0]
    time, _, words = first.partition(" s  ")
    assert len(time) == 9
    assert float(time) < 1.0
    assert "light hue 0" in words


def test_keys_press_the_buttons_that_a_hub_has(
    given: Given, monkeypatch: pytest.MonkeyPatch
) -> None:
    from brickhub.cli import key_listener

    heard: list[Callable[[str], None]] = []

    class Heard:
        def __init__(self, press: Callable[[str], None]) -> None:
            heard.append(press)

        def __enter__(self) -> None: ...

        def __exit__(self, *_: object) -> None: ...

    monkeypatch.setattr(key_listener, "can_listen", lambda: True)
    monkeypatch.setattr(key_listener, "keys_heard", Heard)
    taps: list[str] = []
    panel: Any = SimpleNamespace(
        buttons=("center", "left"), tap=taps.append, is_watched=False, on_change=None
    )
    given("--realtime").operation.watch(panel)
    assert panel.is_watched
    assert panel.on_change is None
    (press,) = heard
    for key in ("left", "right", " ", "c-m", "b", "q"):
        press(key)
    assert taps == ["left", "center", "center"]
    # Without real time nobody listens to keys.
    panel.is_watched = False
    given("--panel").operation.watch(panel)
    assert not panel.is_watched
    assert len(heard) == 1
    assert panel.on_change is run_command._print_panel


def test_line_of_the_panel(capsys: pytest.CaptureFixture[str]) -> None:
    panel: Any = SimpleNamespace(now_s=1.5, describe=lambda: "light off")
    run_command._print_panel(panel)
    assert capsys.readouterr().err == "    1.500 s  light off\n"


@pytest.fixture
def roomful(tmp_path: Path) -> tuple[str, str]:
    """Two programs."""
    paths = (tmp_path / "left.py", tmp_path / "right.py")
    for path in paths:
        path.write_text("print(1)\n")
    return str(paths[0]), str(paths[1])


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--panel",), "several hubs have no --panel; run one program, or omit it"),
        (("--press", "left@1s"), "several hubs have no --press; run one program, or omit it"),
        (("--hub", "ble"), "several hubs have no --hub; run one program, or omit it"),
        (
            ("--robot", CAR),
            "there are 2 programs and 1 robot; name a robot for each program, in their order",
        ),
        (
            ("--robot", CAR, "--robot", CAR),
            "robots that share a world need bodies: use bricktwin run; or omit --robot",
        ),
    ],
)
def test_several_programs_have_fewer_options(
    fails: Any, roomful: tuple[str, str], options: tuple[str, ...], says: str
) -> None:
    fails("run", *roomful, *options, says=says)


@pytest.mark.parametrize(("codes", "code"), [([0, 0], 0), ([0, 3], 3), ([124, 1], 124)])
def test_several_programs_are_run_in_a_room(
    brickhub: Any,
    roomful: tuple[str, str],
    monkeypatch: pytest.MonkeyPatch,
    codes: list[int],
    code: int,
) -> None:
    made: dict[str, Any] = {}

    class PlayedRoom:
        def __init__(self, programs: Any, **options: Any) -> None:
            made.update(options, programs=programs)

        def run(self) -> list[int]:
            return codes

    monkeypatch.setattr(room, "Room", PlayedRoom)
    options = ("--time-limit-s", "9", "--realtime", "--firmware", "4.0")
    assert brickhub("run", *roomful, *options).code == code
    assert [str(one.path) for one in made["programs"]] == list(roomful)
    assert [one.body for one in made["programs"]] == [None, None]
    assert made["time_limit_s"] == 9.0
    assert made["distance_m"](0, 1) == room.on_benches_m(0, 1)
    for one in made["programs"]:
        assert (one.operation.realtime, one.operation.firmware) == (True, "4.0")


@pytest.mark.parametrize(
    ("options", "saved"),
    [((), "there was nothing to save"), (("--log", "run.csv"), "its log is in run.csv")],
)
def test_interrupted_run_says_what_is_saved(
    brickhub: Any,
    program: str,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    options: tuple[str, ...],
    saved: str,
) -> None:
    def interrupted(*_: object, **__: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(run, "run_file", interrupted)
    done = brickhub("run", program, *options)
    assert done.code == 130
    assert done.err == f"interrupted: the program was stopped; {saved}\n"


def test_file_without_an_end_is_saved_at_the_end_of_the_program(
    brickhub: Any, program: str, tmp_path: Path
) -> None:
    Path(program).write_text("print('PB_OF:log.csv')\nprint('1,2')\nprint('3,4', end='')\n")
    done = brickhub("run", program)
    assert (done.code, done.out) == (0, "")
    assert (tmp_path / "log.csv").read_text() == "1,2\n3,4\n"
    Path(program).write_text("print('PB_')\nprint('PB_O', end='')\n")
    assert brickhub("run", program).out == "PB_\nPB_O"


def test_note_on_a_robot_is_told(
    brickhub: Any, program: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = replace(described.TWO_WHEELER, name="rover")
    interface = whole_interface(robot)
    found = Target("rover", robot, interface, lambda: BenchBody(robot), note="it is a slow one")
    monkeypatch.setattr(target, "_finder", lambda: {"rover": found}.__getitem__)
    done = brickhub("run", program, "--robot", "rover")
    assert (done.code, done.out, done.err) == (0, "1\n", "it is a slow one\n")
    out = brickhub("program", "rover")
    assert out.err == "it is a slow one\n"
