"""Calibration from end stops to zeros, program and observations."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest
from bench_arm import BenchArm
from described import REACHING, ROBO_ARM, SPINNING, TWO_WHEELER
from hypothesis import given
from hypothesis import strategies as st

from brickhub.errors import DescriptionError, WriteError
from brickhub.hub.diagnostics.calibration import (
    Calibration,
    CalibrationError,
    calibrated,
    calibration_folder,
    calibration_of,
    forget_calibration,
    load_calibration,
    save_calibration,
    zero_between,
)
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.program.generate import generate
from brickhub.robot import Direction, Motor
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.body import Body
from brickhub.virtual.virtual_transport import VirtualHub


class MisbuiltHub(VirtualHub):
    """A robot with motors mounted at an angle or reversed."""

    def __init__(
        self, shifts_deg: dict[str, int], mirrored: tuple[str, ...] = (), body: Body | None = None
    ) -> None:
        body = body or BenchArm()
        super().__init__(body)
        angle, apply = body.angle_mdeg, body.set_voltage
        self.true_angle_mdeg = angle
        sign = {motor.port: -1 if motor.port in mirrored else 1 for motor in body.robot.motors}
        body.angle_mdeg = lambda port: sign[port] * angle(port) + 1000 * shifts_deg.get(port, 0)
        body.set_voltage = lambda port, mv: apply(port, None if mv is None else sign[port] * mv)


def test_calibrated_targets_stay_in_range() -> None:
    """Without its calibration the arm would drive against its stops."""
    for calibration, low_end in ((None, True), (Calibration({"low": 35}), False)):
        hub = MisbuiltHub({"D": 35})
        calibrate = (
            None
            if calibration is None
            else lambda robot: calibrated(robot, Calibration({"low": 35}))
        )
        with HubLink(hub, ROBO_ARM, REACHING, calibrate=calibrate) as link:
            for _ in range(6):
                link.act([0, -30, 0, 0])
            shaft_deg = hub.body.angle_mdeg("D") / 1000 - 35
        assert (shaft_deg < 5) is low_end, "stops at 0; the range begins at 10"


def test_mirrored_motor_direction_is_reversed() -> None:
    hub = MisbuiltHub({}, mirrored=("A",), body=BenchBody(TWO_WHEELER))
    turned = []
    for calibration in (Calibration(), Calibration({}, frozenset({"right"}))):
        with HubLink(
            hub, TWO_WHEELER, SPINNING, calibrate=lambda robot, c=calibration: calibrated(robot, c)
        ) as link:
            before = hub.true_angle_mdeg("A")
            for _ in range(5):
                link.act([0, 100])
            turned.append(hub.true_angle_mdeg("A") - before)
    assert turned[0] * turned[1] < 0


def test_program_without_calibration_is_unchanged() -> None:
    assert calibrated(ROBO_ARM, Calibration()) == ROBO_ARM
    program = generate(ROBO_ARM, REACHING)
    assert generate(calibrated(ROBO_ARM, Calibration({"low": 0})), REACHING).hash == program.hash
    other = generate(calibrated(ROBO_ARM, Calibration({"low": 7})), REACHING)
    assert other.hash != program.hash
    assert "motor_low.reset_angle((motor_low.angle() - -133) % 360 + -140)" in other.source


@given(zero=st.integers(-360, 360), angle=st.integers(10, 70))
def test_hub_computes_angle_from_zero(zero: int, angle: int) -> None:
    motor = replace(ROBO_ARM.motor("low"), zero_deg=zero)
    shown = (angle + zero + 180) % 360 - 180
    line = generate(
        replace(ROBO_ARM, motors=(motor, *[m for m in ROBO_ARM.motors if m.name != "low"])),
        REACHING,
    ).source
    if zero:
        expression = line.split("motor_low.reset_angle(")[1].splitlines()[0][:-1]
        # our own line
        assert eval(expression.replace("motor_low.angle()", str(shown))) == angle  # noqa: S307


def test_geared_motor_position_within_shaft_turn() -> None:
    assert ROBO_ARM.motor("rotation").turn_deg == 120.0
    source = generate(calibrated(ROBO_ARM, Calibration({"rotation": 10})), REACHING).source
    assert "motor_rotation.reset_angle((motor_rotation.angle() - -50) % 120 + -60)" in source
    odd = replace(
        ROBO_ARM, motors=(Motor("rotation", "B", gears=(20, 28), zero_deg=4), *ROBO_ARM.motors[1:])
    )
    assert (
        "motor_rotation.reset_angle(motor_rotation.angle() - 4)" in generate(odd, REACHING).source
    )


@given(st.integers(-500, 500), st.integers(0, 40))
def test_range_is_centred_between_stops(zero: int, margin: int) -> None:
    motor = ROBO_ARM.motor("high")
    low, high = motor.range_deg
    assert zero_between((low + zero - margin, high + zero + margin), motor) == zero


def test_early_block_is_not_calibrated() -> None:
    with pytest.raises(
        CalibrationError, match="blocked after 100 degrees and has to turn by 160; clear its way"
    ):
        zero_between((0, 100), ROBO_ARM.motor("high"))
    with pytest.raises(CalibrationError, match="by hand"):
        zero_between((0, 100), ROBO_ARM.motor("rotation"))


def test_unknown_motors_and_directions() -> None:
    robot = calibrated(TWO_WHEELER, Calibration({}, frozenset({"left"})))
    assert robot.motor("left").direction is Direction.CLOCKWISE
    assert calibrated(robot, Calibration({}, frozenset({"left"}))) == TWO_WHEELER
    for stranger in (Calibration({"tail": 1}), Calibration({}, frozenset({"tail"}))):
        with pytest.raises(DescriptionError, match="no motor 'tail'; calibrate"):
            calibrated(TWO_WHEELER, stranger)


def test_calibration_is_per_hub_and_robot(tmp_path: Path) -> None:
    hub_id, one = "C0:01:02:03:04:05", Calibration({"low": -3}, frozenset({"high"}))
    assert load_calibration(hub_id, ROBO_ARM, tmp_path) == Calibration()
    path = save_calibration(hub_id, ROBO_ARM, one, tmp_path)
    assert path.is_relative_to(tmp_path) and ":" not in path.name
    assert load_calibration(hub_id, ROBO_ARM, tmp_path) == one
    for other in (("C0:01:02:03:04:06", ROBO_ARM), (hub_id, TWO_WHEELER)):
        assert load_calibration(*other, tmp_path) == Calibration()
    forget_calibration(hub_id, ROBO_ARM, tmp_path)
    forget_calibration(hub_id, ROBO_ARM, tmp_path)
    assert load_calibration(hub_id, ROBO_ARM, tmp_path) == Calibration()


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "{}",
        '{"zeros_deg": [1], "reversed": []}',
        '{"zeros_deg": {"low": "x"}, "reversed": []}',
    ],
)
def test_damaged_calibration_file_raises(tmp_path: Path, text: str) -> None:
    path = save_calibration("hub", ROBO_ARM, Calibration(), tmp_path)
    path.write_text(text)
    with pytest.raises(CalibrationError, match="delete the file and calibrate again"):
        load_calibration("hub", ROBO_ARM, tmp_path)


def test_link_does_not_open_without_its_calibration(tmp_path: Path) -> None:
    path = save_calibration("virtual", ROBO_ARM, Calibration({"low": 7}), tmp_path)
    text = path.read_text()
    path.write_text("")
    hub = VirtualHub(BenchArm())
    link = HubLink(hub, ROBO_ARM, REACHING, calibrate=calibration_of(hub, tmp_path))
    for _ in range(2):
        with pytest.raises(CalibrationError, match="delete the file and calibrate again"):
            link.open()
    path.write_text(text)
    with link:
        assert link.program == generate(calibrated(ROBO_ARM, Calibration({"low": 7})), REACHING)


def test_unwritable_folder_raises(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(WriteError, match="name another place"):
        save_calibration("hub", ROBO_ARM, Calibration(), tmp_path / "file")


def test_calibration_folder_is_in_user_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    for platform in ("linux", "darwin", "win32"):  # so that tests can have one of their own
        monkeypatch.setattr("sys.platform", platform)
        assert calibration_folder() == tmp_path / "bricksrl" / "calibrations"
    monkeypatch.delenv("XDG_CONFIG_HOME")
    monkeypatch.setattr("sys.platform", "linux")
    assert calibration_folder() == Path.home() / ".config" / "bricksrl" / "calibrations"
    monkeypatch.setattr("sys.platform", "darwin")
    assert calibration_folder().relative_to(Path.home()).parts[:2] == (
        "Library",
        "Application Support",
    )
    if os.name == "posix":
        monkeypatch.setattr("sys.platform", "win32")
        monkeypatch.setenv("APPDATA", str(tmp_path / "roaming"))
        assert calibration_folder() == tmp_path / "roaming" / "bricksrl" / "calibrations"
