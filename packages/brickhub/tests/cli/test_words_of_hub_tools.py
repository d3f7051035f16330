"""What the tools for hubs print, word by word, of hubs that a test plays."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import described
import pytest
from described import ROBO_ARM, TWO_WHEELER, WALKER

from brickhub import target
from brickhub.cli import hub_tools
from brickhub.cli.hub_tools import Calibrate, Check
from brickhub.errors import HubNotFoundError
from brickhub.finding import Finding, Outcome
from brickhub.hub.diagnostics.calibration import Calibration, load_calibration, save_calibration
from brickhub.hub.diagnostics.preflight import Latency
from brickhub.hub.transports.address import HubAddress
from brickhub.hub.transports.ble import FoundHub
from brickhub.hub.transports.profile import Status, StatusReport
from brickhub.robot import HubKind, KitKind, Motor, MotorKind, Robot
from brickhub.target import Target, whole_interface
from brickhub.virtual.bench_body import BenchBody

CAR = f"{described.__file__}:TWO_WHEELER"
Told = Callable[..., tuple[int | str | None, str]]


def known(monkeypatch: pytest.MonkeyPatch, *robots: Robot) -> None:
    """Let commands find robots by their names."""
    targets = {
        robot.name: Target(robot.name, robot, whole_interface(robot), lambda: None)  # type: ignore[arg-type,return-value]
        for robot in robots
    }
    monkeypatch.setattr(target, "_finder", lambda: targets.__getitem__)


HUBS = [
    FoundHub("Rover", "C0:01:02:03:04:05", -61, HubKind.PRIME),
    FoundHub("Crane", "C0:01:02:03:04:06", -100, None),
]


def test_scan_prints_a_table(told: Told, monkeypatch: pytest.MonkeyPatch) -> None:
    heard = []
    monkeypatch.setattr(hub_tools, "scan", lambda seconds: heard.append(seconds) or HUBS)
    code, out = told("scan")
    assert (code, heard) == (0, [5.0])
    address = " " * (36 - len("address"))
    assert out.splitlines() == [
        f"name              address{address}    signal  kind",
        f"Rover             C0:01:02:03:04:05{' ' * 19}   -61 dBm  prime",
        f"Crane             C0:01:02:03:04:06{' ' * 19}  -100 dBm  unknown",
    ]
    code, out = told("scan", "--seconds", "2.5", "--json")
    assert (code, heard[-1]) == (0, 2.5)
    assert json.loads(out) == [
        {"name": "Rover", "address": "C0:01:02:03:04:05", "rssi_dbm": -61, "kind": "prime"},
        {"name": "Crane", "address": "C0:01:02:03:04:06", "rssi_dbm": -100, "kind": None},
    ]


def test_scan_on_usb(told: Told, monkeypatch: pytest.MonkeyPatch) -> None:
    from brickhub.hub.transports import usb

    monkeypatch.setattr(usb, "list_usb_hubs", lambda: [usb.UsbHub("COM3", "39AF", 0x0005)])
    code, out = told("scan", "--hub", "usb")
    assert code == 0
    assert out.splitlines()[1] == f"COM3              39AF{' ' * 32}     cable  ev3"
    monkeypatch.setattr(usb, "list_usb_hubs", list)
    nothing = "no hub of LEGO is on USB; plug it in and switch it on, with Pybricks 4.1 or later\n"
    assert told("scan", "--hub", "usb") == (1, nothing)


@pytest.mark.parametrize("seconds", ["0", "-1", "600.1", "nan"])
def test_scan_takes_up_to_ten_minutes(fails: Any, seconds: str) -> None:
    fails("scan", "--seconds", seconds, says="give a number above 0, and up to 600")


def test_scan_of_ten_minutes(told: Told, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hub_tools, "scan", lambda seconds: HUBS[:1])
    assert told("scan", "--seconds", "600")[0] == 0


class PlayedHub:
    """A transport to a hub, which runs a program or not."""

    def __init__(self, flags: Status | None, name: str | None = "Rover") -> None:
        self.status = None if flags is None else StatusReport(flags)
        self.identity = None if name is None else SimpleNamespace(name=name)
        self.calls: list[str] = []

    def open(self) -> None:
        self.calls.append("open")

    def stop(self) -> None:
        self.calls.append("stop")
        self.status = StatusReport(Status(0))

    def close(self) -> None:
        self.calls.append("close")


@pytest.mark.parametrize(
    ("flags", "name", "said"),
    [
        (Status.USER_PROGRAM_RUNNING, "Rover", "Rover: the program was stopped"),
        (Status.BATTERY_LOW, "Rover", "Rover: no program ran"),
        (None, None, "the hub: no program ran"),
    ],
)
def test_stop_says_what_was_stopped(
    told: Told,
    monkeypatch: pytest.MonkeyPatch,
    flags: Status | None,
    name: str | None,
    said: str,
) -> None:
    hub = PlayedHub(flags, name)
    monkeypatch.setattr(HubAddress, "transport", lambda self: hub)
    assert told("stop") == (0, f"{said}, no motor is driven\n")
    assert hub.calls == ["open", "stop", "close"]


def test_stop_of_a_hub_that_is_not_found(fails: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    hub = PlayedHub(None)

    def open_nothing() -> None:
        raise HubNotFoundError("no hub was found")

    hub.open = open_nothing  # type: ignore[method-assign]
    monkeypatch.setattr(HubAddress, "transport", lambda self: hub)
    button = "no hub was found; a hub whose program runs without a computer hears only its button"
    fails("stop", says=button)
    assert hub.calls == ["close"]


@pytest.mark.parametrize(
    ("latency", "options", "lines"),
    [
        (
            Latency(7, 90.04, 120.06, 45.0, 0.643),
            ("--hub", "virtual"),
            [
                "round trip           p50 90.0 ms, p99 120.1 ms, of 7 exchanges",
                "of a step            64 % is the link",
                "connection interval  45 ms (inferred: half a round trip)",
                (
                    "faster               as this link is played; another one with --link, such "
                    "as --link mac"
                ),
            ],
        ),
        (
            Latency(7, 30.0, 31.0, 15.0, None),
            ("--hub", "virtual", "--link", "mac"),
            [
                "round trip           p50 30.0 ms, p99 31.0 ms, of 7 exchanges",
                "connection interval  15 ms (inferred: half a round trip)",
            ],
        ),
    ],
)
def test_latency_in_words(
    told: Told,
    monkeypatch: pytest.MonkeyPatch,
    latency: Latency,
    options: tuple[str, ...],
    lines: list[str],
) -> None:
    monkeypatch.setattr(hub_tools, "measure", lambda link, interface, exchanges: latency)
    code, out = told("latency", CAR, "--exchanges", "7", *options)
    assert (code, out.splitlines()) == (0, lines)
    code, out = told("latency", CAR, "--json", *options)
    assert json.loads(out) == {
        "exchanges": 7,
        "p50_ms": latency.p50_ms,
        "p99_ms": latency.p99_ms,
        "interval_ms": latency.interval_ms,
        "link_share": latency.link_share,
    }


def test_slow_real_link_has_advice(told: Told, monkeypatch: pytest.MonkeyPatch) -> None:
    class NoLink:
        def __init__(self, *_: object) -> None: ...

        def __enter__(self) -> None: ...

        def __exit__(self, *_: object) -> None: ...

    monkeypatch.setattr(hub_tools, "HubLink", NoLink)
    monkeypatch.setattr(HubAddress, "transport", lambda self, kind: None)
    monkeypatch.setattr(hub_tools, "advice", lambda: "buy another one")
    slow = Latency(7, 90.0, 120.0, 45.0, None)
    monkeypatch.setattr(hub_tools, "measure", lambda link, interface, exchanges: slow)
    assert told("latency", CAR)[1].splitlines()[-1] == "faster               buy another one"


@pytest.mark.parametrize(
    ("check", "command"),
    [
        (Check("car.py"), "brickhub calibrate car.py"),
        (Check("car.py", hub="ble:Rover"), "brickhub calibrate car.py --hub ble:Rover"),
        (
            Check("my car.py", hub="usb", calibrations=Path("kept")),
            "brickhub calibrate 'my car.py' --hub usb --calibrations kept",
        ),
    ],
)
def test_command_that_calibrates(check: Check, command: str) -> None:
    assert check._calibration().replace('"', "'") == command


@pytest.mark.parametrize(
    ("outcome", "code", "last"),
    [
        (Outcome.WARNING, 0, "ready for two-wheeler"),
        (Outcome.ERROR, 1, "not ready: see the errors above"),
    ],
)
def test_check_prints_its_findings_in_columns(
    told: Told, monkeypatch: pytest.MonkeyPatch, outcome: Outcome, code: int, last: str
) -> None:
    asked = {}

    def check_robot(transport: object, robot: Robot, interface: object, **options: Any) -> Any:
        asked.update(options)
        yield Finding("hub", Outcome.OK, "it is there")
        yield Finding("battery", outcome, "6.2 V")

    monkeypatch.setattr(hub_tools, "check_robot", check_robot)
    done = told("check", CAR, "--hub", "virtual", "--yes")
    assert done[0] == code
    assert done[1].splitlines() == [
        "ok       hub               it is there",
        f"{outcome.value:9}battery           6.2 V",
        last,
    ]
    assert asked["may_move"]()
    assert asked["is_right"] is None
    assert asked["command"] == f"brickhub calibrate {CAR} --hub virtual"
    _, out = told("check", CAR, "--hub", "virtual", "--json")
    written = json.loads(out)
    assert (written["env"], written["hub"], written["ok"]) == ("two-wheeler", "virtual", not code)
    assert not asked["may_move"]()
    assert asked["is_right"] is not None


def test_looking_for_a_real_hub_is_said(brickhub: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(HubAddress, "transport", lambda self, kind: (self.which, kind))

    def check_robot(transport: object, robot: Robot, *_: object, **options: object) -> Any:
        asked.extend((transport, robot.name))
        return iter(())

    monkeypatch.setattr(hub_tools, "check_robot", check_robot)
    done = brickhub("check", CAR, "--hub", "ble:Rover")
    assert asked == [("Rover", HubKind.PRIME), "two-wheeler"]
    assert done.err == "looking for the hub (ble:Rover), which can take some seconds\n"
    assert done.out == "ready for two-wheeler\n"


KIT = Robot("cart", KitKind.DOUBLE_MOTOR, (Motor("left", "A"), Motor("right", "B")))


def test_kit_has_no_use_for_some_tools(fails: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    known(monkeypatch, KIT)
    none = "'cart' has devices of LEGO's kits, which need none of this; `check` checks them"
    for tool in ("latency", "calibrate"):
        fails(tool, "cart", "--hub", "virtual", says=none)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--fault", "battery=6.2"), "a real robot has faults of its own; leave out --fault, or"),
        (("--link", "mac"), "a real hub has a link of its own; leave out --link, or take"),
        (("--link", "linus"), "there is no link 'linus' (did you mean 'linux'?)"),
    ],
)
def test_real_hub_is_not_played(fails: Any, options: tuple[str, ...], says: str) -> None:
    fails("latency", CAR, "--hub", "ble", *options, says=says)


def test_program_is_written_or_printed(told: Told, fails: Any, tmp_path: Path) -> None:
    _, printed = told("program", CAR)
    path = tmp_path / "hub.py"
    lines = printed.count("\n")
    assert told("program", CAR, "--out", str(path)) == (0, f"{lines} lines: {path}\n")
    assert path.read_text() == printed
    assert not printed.endswith("\n\n")
    other = tmp_path / "hub.txt"
    fails("program", CAR, "--out", str(other), says="is not a name of a program; end it in .py")
    assert not other.exists()


@pytest.fixture
def place(tmp_path: Path) -> tuple[str, ...]:
    return ("--hub", "virtual", "--calibrations", str(tmp_path))


def played_survey(monkeypatch: pytest.MonkeyPatch, robot: Robot, **found: Any) -> list[Robot]:
    """Let a survey find these angles, and the joints these stops. Returns the robots that were
    surveyed."""
    targets = {
        robot.name: Target(robot.name, robot, whole_interface(robot), lambda: BenchBody(robot))
    }
    monkeypatch.setattr(target, "_finder", lambda: targets.__getitem__)
    surveyed: list[Robot] = []

    def survey(transport: object, robot: Robot) -> Any:
        surveyed.append(robot)
        return SimpleNamespace(angles_deg=found.get("angles", {}))

    def find_stops(transport: object, robot: Robot) -> Any:
        surveyed.append(robot)
        return found.get("stops", {})

    monkeypatch.setattr(hub_tools, "survey", survey)
    monkeypatch.setattr(hub_tools, "find_stops", find_stops)
    return surveyed


def test_calibration_by_hand_and_by_stops(
    told: Told, monkeypatch: pytest.MonkeyPatch, place: tuple[str, ...], tmp_path: Path
) -> None:
    surveyed = played_survey(
        monkeypatch,
        ROBO_ARM,
        angles={"rotation": -7, "low": 99},
        # Each range is centred between its stops.
        stops={"low": (0, 70), "high": (-150, 20), "grab": (-148, -45)},
    )
    before = Calibration({"rotation": 50, "low": 60}, frozenset({"high"}))
    save_calibration("virtual", ROBO_ARM, before, tmp_path)
    code, out = told("calibrate", "robo-arm", "--by-hand", "--yes", *place)
    assert code == 0
    assert out.splitlines() == [
        "zero     grab        0 deg",
        "zero     high        5 deg",
        "zero     low         -5 deg",
        "zero     rotation    -7 deg",
        "reversed high",
        f"saved    {tmp_path / 'virtual' / 'robo-arm.json'}",
    ]
    # What is measured is measured without the zeros before, but in the directions that hold.
    for robot in surveyed:
        assert [motor.zero_deg for motor in robot.motors] == [0] * 4
        directions = [motor.direction for motor in robot.motors]
        described_ones = [motor.direction for motor in ROBO_ARM.motors]
        differ = [one is not other for one, other in zip(directions, described_ones, strict=True)]
        assert differ == [False, False, True, False]


def test_motors_that_are_not_measured_keep_their_zeros(
    told: Told, monkeypatch: pytest.MonkeyPatch, place: tuple[str, ...], tmp_path: Path
) -> None:
    played_survey(
        monkeypatch,
        ROBO_ARM,
        stops={"low": (10, 70), "high": (-150, 10), "grab": (-148, -45)},
    )
    save_calibration("virtual", ROBO_ARM, Calibration({"rotation": 50}), tmp_path)
    assert told("calibrate", "robo-arm", "--yes", *place)[0] == 0
    kept = load_calibration("virtual", ROBO_ARM, tmp_path)
    assert kept.zeros_deg == {"rotation": 50, "low": 0, "high": 0, "grab": 0}


@pytest.mark.parametrize(
    ("robot", "options", "says"),
    [
        (
            WALKER,
            (),
            "no motor of 'walker' has stops; put its motors at their zeros and add --by-hand",
        ),
        (ROBO_ARM, ("--yes",), "motor 'low' meets no stops; look whether it drives its joint"),
        (ROBO_ARM, (), "nothing was moved and nothing calibrated; clear the way and say yes"),
        (
            replace(WALKER, motors=(Motor("left_front", "D", MotorKind.INTERACTIVE),)),
            ("--by-hand",),
            "the motor 'left_front' counts from where it stands when a program begins",
        ),
    ],
)
def test_robot_that_cannot_be_calibrated(
    fails: Any,
    monkeypatch: pytest.MonkeyPatch,
    place: tuple[str, ...],
    tmp_path: Path,
    robot: Robot,
    options: tuple[str, ...],
    says: str,
) -> None:
    played_survey(monkeypatch, robot, stops={"low": None})
    fails("calibrate", robot.name, *options, *place, says=says)
    assert not list(tmp_path.iterdir())


def test_forgotten_calibration(
    told: Told, monkeypatch: pytest.MonkeyPatch, place: tuple[str, ...], tmp_path: Path
) -> None:
    played_survey(monkeypatch, TWO_WHEELER)
    save_calibration("virtual", TWO_WHEELER, Calibration({"left": 3}), tmp_path)
    said = "two-wheeler on virtual: as described\n"
    assert told("calibrate", "two-wheeler", "--forget", *place) == (0, said)
    assert load_calibration("virtual", TWO_WHEELER, tmp_path) == Calibration()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--forget", "--by-hand"), "--by-hand has no effect with --forget; omit it"),
        (("--forget", "--as-described", "left"), "--as-described has no effect with --forget"),
        (("--as-described", "left", "--by-hand"), "--by-hand has no effect with --reverse"),
        (("--as-described", "tail"), "robot 'two-wheeler' has no motor 'tail'"),
    ],
)
def test_options_of_a_calibration_that_do_not_go_together(
    fails: Any, place: tuple[str, ...], options: tuple[str, ...], says: str
) -> None:
    fails("calibrate", CAR, *place, *options, says=says)


def test_modes_take_where_and_how() -> None:
    """What is needed for a hub goes with each mode."""
    place = {"hub": "virtual", "fault": ("battery=6.2",), "yes": True, "calibrations": Path("x")}
    Calibrate("car.py", forget=True, **place)._check_modes()
    Calibrate("car.py", reverse=("left",), as_described=("right",), **place)._check_modes()
    Calibrate("car.py", by_hand=True, **place)._check_modes()
