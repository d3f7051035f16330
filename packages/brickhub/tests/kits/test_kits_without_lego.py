"""Robots of LEGO's kits, as far as LEGO's package is not needed."""

from __future__ import annotations

import io
import logging
import math
import sys
import time
import types
from dataclasses import replace
from pathlib import Path

import pytest
from kit_world import DRIVE, ROBOT

from brickhub.errors import (
    DescriptionError,
    HubTimeoutError,
    MediumUnavailableError,
    ProgramError,
    TwinError,
    UnknownNameError,
)
from brickhub.hub.interface import (
    Command,
    DriveSpeed,
    DriveStraight,
    DriveTurnRate,
    Interface,
    RunAngle,
    RunDuty,
    RunSpeed,
    SensorReading,
    Turn,
    Wait,
)
from brickhub.hub.link.profiles import DEFAULT_LINK, PROFILES
from brickhub.hub.program.generate import generate
from brickhub.hub.transports.address import parse_hub
from brickhub.kits import link as kit_link
from brickhub.kits.kit_protocol import Product
from brickhub.kits.link import KitLink
from brickhub.kits.radio import KitPart, RealRadio, lego_package, parts_of, real_radio
from brickhub.kits.virtual_kit import VirtualKit, virtual_robot
from brickhub.robot import DriveBase, KitKind, Motor, Robot
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.room import HubProgramFile, Room
from brickhub.virtual.run import run_file


def test_devices_of_a_robot() -> None:
    double, single, color = parts_of(ROBOT)
    assert (double, single) == (
        KitPart(Product.DOUBLE_MOTOR, "AB"),
        KitPart(Product.SINGLE_MOTOR, "C"),
    )
    assert color == KitPart(Product.COLOR_SENSOR, "D")
    assert parts_of(Robot("one", KitKind.SINGLE_MOTOR, (Motor("a", "A"),))) == (
        KitPart(Product.SINGLE_MOTOR, "A"),
    )


def test_double_motor_has_two() -> None:
    with pytest.raises(DescriptionError, match="port B"):
        parts_of(Robot("half", KitKind.DOUBLE_MOTOR, (Motor("a", "A"),)))


def test_no_program_runs_on_a_device() -> None:
    with pytest.raises(ProgramError, match="runs no programs"):
        generate(ROBOT, DRIVE)


def test_program_of_a_hub_is_refused_on_a_kit(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text("from pybricks.hubs import PrimeHub\nprint(PrimeHub().battery.voltage())\n")
    printed = io.BytesIO()
    body = BenchBody(Robot("one", KitKind.SINGLE_MOTOR, (Motor("a", "A"),)))
    says = "^'one' is of LEGO's kits, .* imports legoeducation[^\n]*$"
    with pytest.raises(TwinError, match=says):
        run_file(program, body, stdout=printed)
    room = Room(
        [HubProgramFile(program), HubProgramFile(program, body)],
        stdout=printed,
        stderr=io.StringIO(),
    )
    with pytest.raises(TwinError, match=says):
        room.run()
    assert printed.getvalue() == b""


def test_command_without_an_end_is_refused() -> None:
    duty = Interface((RunDuty("arm"),), DRIVE.channels, Wait(100))
    with pytest.raises(DescriptionError, match="ends by itself"):
        KitLink(RealRadio(), ROBOT, duty)


def test_reading_that_no_device_reports_is_refused() -> None:
    ambient = Interface(
        DRIVE.commands, (SensorReading("light", "ambient", 0, 100, "%"),), Wait(100)
    )
    with pytest.raises(DescriptionError, match="reports it"):
        KitLink(RealRadio(), ROBOT, ambient)


def test_motor_with_a_range_is_refused() -> None:
    arm = replace(ROBOT, motors=(*ROBOT.motors[:2], Motor("arm", "C", range_deg=(0, 90))))
    with pytest.raises(DescriptionError, match="range"):
        KitLink(RealRadio(), arm, DRIVE)


def test_radio_ends_what_never_answers() -> None:
    with pytest.raises(HubTimeoutError):
        RealRadio().run(lambda: time.sleep(5), limit_s=0.1)
    assert RealRadio().run(lambda: 3, limit_s=1.0) == 3


def test_address() -> None:
    assert real_radio(parse_hub("ble:azure-3683")) == RealRadio("azure-3683")
    with pytest.raises(UnknownNameError):
        real_radio(parse_hub("usb"))
    with pytest.raises(UnknownNameError, match="connection card"):
        RealRadio("pink-1").search(KitPart(Product.COLOR_SENSOR, "D"))


def test_missing_package_is_named_with_its_licence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "legoeducation", None)
    with pytest.raises(MediumUnavailableError, match="BUSL-1.1"):
        lego_package()


def test_devices_have_the_interval_of_the_link_that_is_asked_for() -> None:
    intervals_ms = []
    for link in (None, PROFILES["mac"]):
        kit = virtual_robot(BenchBody(ROBOT, readings={"light": lambda angles: 50.0}), link=link)
        assert isinstance(kit, VirtualKit)
        intervals_ms.append(kit.link.interval_ms)
    assert (
        intervals_ms
        == [PROFILES[DEFAULT_LINK].interval_ms, PROFILES["mac"].interval_ms]
        == [45.0, 15.0]
    )


def test_clock_of_real_devices_tells_milliseconds_on_windows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its monotonic clock has steps of 15.6 ms, the period of their reports."""
    monkeypatch.setattr(time, "monotonic", lambda: 7.0)
    start_s = RealRadio().now_s()
    time.sleep(0.002)
    assert RealRadio().now_s() - start_s >= 0.002


def lego_stub(monkeypatch: pytest.MonkeyPatch) -> types.ModuleType:
    """LEGO's package, of which only the colors are there."""
    stub = types.ModuleType("legoeducation")
    vars(stub).update(LEGO_COLOR_AZURE=11, LEGO_COLOR_RED=9)
    monkeypatch.setitem(sys.modules, "legoeducation", stub)
    return stub


def test_what_legos_package_logs_is_silent_only_where_errors_say_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    logger = logging.getLogger("legoeducation")
    monkeypatch.setattr(logger, "handlers", [])
    monkeypatch.setattr(logger, "propagate", False)
    stub = lego_stub(monkeypatch)
    assert lego_package() is stub
    logger.warning("the device left")
    assert "the device left" in capsys.readouterr().err
    for _ in range(2):
        assert lego_package(is_silent=True) is stub
    logger.warning("the device left")
    assert capsys.readouterr().err == "" and len(logger.handlers) == 1


@pytest.mark.parametrize("card", ["azure-3683", "RED-7", None])
def test_a_card_finds_devices_by_its_color_and_serial(
    card: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    lego_stub(monkeypatch)
    wanted = {
        "azure-3683": {"card_color": 11, "card_serial": "3683"},
        "RED-7": {"card_color": 9, "card_serial": "7"},
        None: {},
    }
    assert RealRadio(card).search(KitPart(Product.COLOR_SENSOR, "D")) == wanted[card]


@pytest.mark.parametrize("card", ["azure", "azure-", "azure-12345", "azure-1a", "black-1", "-1"])
def test_what_is_on_no_card_is_refused(card: str, monkeypatch: pytest.MonkeyPatch) -> None:
    lego_stub(monkeypatch)
    with pytest.raises(UnknownNameError, match=f"^'{card}' is no connection card; give its color"):
        RealRadio(card).search(KitPart(Product.COLOR_SENSOR, "D"))


CART = Robot(
    "cart",
    KitKind.DOUBLE_MOTOR,
    (Motor("left", "A"), Motor("right", "B"), Motor("arm", "C")),
    drive_base=DriveBase("left", "right", 50.0, 100.0),
)
ROLLED_DEG = 360.0 / (math.pi * 50.0)


@pytest.mark.parametrize(
    ("command", "amount", "moves"),
    [
        # Speed, and the turn after which it ends by itself.
        (RunAngle("arm", -90, 90, 300), -45.0, {"arm": (300, -45.0)}),
        (RunSpeed("arm", -500, 500), -200.0, {"arm": (-200.0, None)}),
        (
            DriveSpeed(-100, 100),
            60.0,
            {"left": (60 * ROLLED_DEG, None), "right": (60 * ROLLED_DEG, None)},
        ),
        (DriveTurnRate(-90, 90), 45.0, {"left": (90.0, None), "right": (-90.0, None)}),
        (
            DriveStraight(-100, 100),
            30.0,
            {"left": (400.0, 30 * ROLLED_DEG), "right": (400.0, 30 * ROLLED_DEG)},
        ),
        (Turn(-90, 90), 45.0, {"left": (400.0, 90.0), "right": (400.0, -90.0)}),
    ],
)
def test_motors_of_a_kit_move_as_the_command_says(
    command: Command, amount: float, moves: dict[str, tuple[float, float | None]]
) -> None:
    found = kit_link._MOVES[type(command)](CART, command, amount)
    assert found.keys() == moves.keys()
    for name, (speed, turn) in moves.items():
        assert found[name][0] == pytest.approx(speed)
        assert found[name][1] == (None if turn is None else pytest.approx(turn))
