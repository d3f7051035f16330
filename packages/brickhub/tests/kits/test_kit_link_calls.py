"""What a link to LEGO's kits tells LEGO's package, call by call, and what it makes of reports."""

from __future__ import annotations

import logging
import math
import sys
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
from kit_world import DRIVE, ROBOT
from played_lego import PlayedRadio, link_over, linked, package_of

from brickhub import errors
from brickhub.finding import Finding, Outcome
from brickhub.hub.interface import (
    DriveSpeed,
    DriveStraight,
    Interface,
    MotorAngle,
    Pitch,
    Roll,
    RunAngle,
    RunSpeed,
    SensorReading,
    UntilDone,
    Wait,
    YawRate,
)
from brickhub.hub.link.states import LinkState
from brickhub.hub.protocol import EncodingError
from brickhub.kits.kit_preflight import check_kit
from brickhub.robot import Direction, Motor

LIGHT = SensorReading("light", "reflection", 0, 100, "%")
ANGLES = (MotorAngle("left", -999, 999), MotorAngle("right", -999, 999), MotorAngle("arm"))
SPEEDS = Interface(
    (RunSpeed("left", -900, 900), RunSpeed("right", -900, 2000), RunSpeed("arm", -900, 900)),
    (*ANGLES, LIGHT),
    Wait(100),
)
TURNS = Interface(
    (RunAngle("left", -90, 90, 300), RunAngle("arm", -720, 720, 55)), ANGLES, UntilDone(500)
)


@pytest.fixture
def radio(monkeypatch: pytest.MonkeyPatch) -> Iterator[PlayedRadio]:
    """A radio whose devices are those of the package that is imported."""
    played = PlayedRadio()
    monkeypatch.setitem(sys.modules, "legoeducation", package_of(played))
    yield played
    played.close()


def how(motor: int, speed: int, direction: int) -> dict[str, Any]:
    return {"motor": motor, "direction": direction, "blocking": False, "speed": speed}


def test_devices_are_connected_once_with_the_shortest_period(radio: PlayedRadio) -> None:
    link = link_over(radio, SPEEDS)
    assert link.devices == {}
    link.open()
    link.open()
    assert list(link.devices) == ["AB", "C", "D"]
    kinds = [type(device).__name__ for device in radio.devices]
    assert kinds == ["DoubleMotor", "SingleMotor", "ColorSensor"]
    for device, ports in zip(radio.devices, link.devices, strict=True):
        assert device.calls == [("connect", {"device_notification_delay": 15, "part": ports})]
    assert radio.limits_s == [20.0] * 3
    assert radio.attached == 1
    assert link.state is LinkState.READY


def test_move_of_a_fixed_time_ends_by_itself(radio: PlayedRadio) -> None:
    link, (double, single, color) = linked(radio, SPEEDS)
    link.act([300, -200, 0])
    # Of the step's 100 ms and 0.4 s more; the left motor counts the other way round.
    assert double.calls == [
        ("batch", {"blocking": False}),
        ("time", 500, how(0, 30, 1)),
        ("time", 500, how(1, 20, 1)),
        ("batch ends",),
    ]
    assert single.calls == [
        ("batch", {"blocking": False}),
        ("stop", {"motor": 0, "blocking": False}),
        ("batch ends",),
    ]
    assert color.calls == []


@pytest.mark.parametrize(
    ("speed_deg_s", "percent"),
    [(4, 0), (6, 1), (14, 1), (16, 2), (994, 99), (996, 100), (1500, 100), (2500, 100)],
)
def test_speed_is_a_whole_percent_up_to_a_hundred(
    radio: PlayedRadio, speed_deg_s: float, percent: int
) -> None:
    link, (double, _, _) = linked(radio, SPEEDS)
    link.act([0, speed_deg_s, 0])
    stop = ("stop", {"motor": 1, "blocking": False})
    run = ("time", 500, how(1, percent, 0))
    assert double.calls[2] == (run if percent else stop)


@pytest.mark.parametrize(
    ("values", "left", "arm"),
    [
        ([45, 90], (45, how(0, 30, 1)), (90, how(0, 6, 0))),
        ([-45, -90], (45, how(0, 30, 0)), (90, how(0, 6, 1))),
        # Beyond the range is its end.
        ([100, -999], (90, how(0, 30, 1)), (720, how(0, 6, 1))),
        ([0.4, 0.6], (0, how(0, 30, 1)), (1, how(0, 6, 0))),
    ],
)
def test_move_by_an_angle(radio: PlayedRadio, values: list[float], left: Any, arm: Any) -> None:
    link, (double, single, _) = linked(radio, TURNS)
    link.act(values)
    assert double.calls[1] == ("degrees", *left)
    assert single.calls[1] == ("degrees", *arm)


def test_gears_and_directions_are_those_of_the_shaft(radio: PlayedRadio) -> None:
    arm = Motor("arm", "C", direction=Direction.COUNTERCLOCKWISE, gears=(12, 36))
    robot = replace(ROBOT, motors=(*ROBOT.motors[:2], arm))
    link = link_over(radio, TURNS, robot)
    link.open()
    single = radio.devices[1]
    single.calls.clear()
    reading = link.act([0, 20])
    assert single.calls[1] == ("degrees", 60, how(0, 16, 1))
    # -400 of the shaft are 133 of the output, clockwise.
    assert reading.values[2] == pytest.approx(400 / 3)


def test_speed_and_turn_of_a_drive_add_up(radio: PlayedRadio) -> None:
    link, (double, _, _) = linked(radio, DRIVE)
    rolled_deg = 360.0 / (math.pi * 56.0)
    link.act([100, 45])
    left_pct = round((100 * rolled_deg + 45 * 2) / 10)
    right_pct = round((100 * rolled_deg - 45 * 2) / 10)
    assert [call[2]["speed"] for call in double.calls[1:3]] == [left_pct, right_pct]
    assert [call[2]["direction"] for call in double.calls[1:3]] == [1, 0]


def test_drive_by_a_distance_turns_both_wheels_at_400_degrees_a_second(radio: PlayedRadio) -> None:
    interface = Interface((DriveStraight(-100, 100),), ANGLES, UntilDone(500))
    link, (double, single, _) = linked(radio, interface)
    link.act([56 * math.pi / 4])
    assert double.calls[1:3] == [("degrees", 90, how(0, 40, 1)), ("degrees", 90, how(1, 40, 0))]
    assert single.calls == []


def test_readings_are_the_latest_reports(radio: PlayedRadio) -> None:
    parts = [SensorReading("light", "hsv", 0, 360, "deg", part) for part in ("hue", "value")]
    interface = Interface((), (*ANGLES, LIGHT, *parts, Pitch(), Roll(), YawRate()), Wait(100))
    link, _ = linked(radio, interface)
    # The left motor counts counterclockwise, and the arm's angle wraps.
    assert link.read().values == (-30.0, -400.0, 320.0, 42.0, 200.0, 35.0, 7.0, -8.0, 55.0)


def test_reading_waits_for_a_report_of_each_device(radio: PlayedRadio) -> None:
    link, _ = linked(radio, SPEEDS)
    started_s = radio.now_s()
    reading = link.read()
    assert 0 < reading.round_trip_s <= 0.02
    assert reading.round_trip_s == pytest.approx(radio.now_s() - started_s)
    assert reading.age_s == pytest.approx(radio.now_s() - 1.005)
    assert reading.hub_time_ms == round(1000 * (radio.now_s() - 1.0))
    assert link.statistics.exchanges == 1
    assert list(link.statistics.ages_s) == [reading.age_s]
    assert list(link.statistics.round_trips_s) == [reading.round_trip_s]


def test_steps_are_as_long_as_they_say_whatever_the_caller_takes(radio: PlayedRadio) -> None:
    link, _ = linked(radio, SPEEDS)
    link.act([0, 0, 0])
    began_s = radio.now_s()
    for _ in range(5):
        radio.sleep(0.04)
        link.act([0, 0, 0])
    assert radio.now_s() - began_s == pytest.approx(0.5, abs=0.02)
    # Who took longer than a step begins anew.
    radio.sleep(0.3)
    began_s = radio.now_s()
    link.act([0, 0, 0])
    assert radio.now_s() - began_s == pytest.approx(0.1, abs=0.02)


def test_step_until_its_moves_are_done(radio: PlayedRadio) -> None:
    link, (double, single, color) = linked(radio, TURNS)
    double.moves_left = 3
    color.moves_left = 10**6
    began_s = radio.now_s()
    link.act([45, 90])
    assert 0.03 < radio.now_s() - began_s < 0.1
    assert single.calls[-1] == ("batch ends",)


def test_moves_that_take_too_long_are_stopped(radio: PlayedRadio) -> None:
    link, (double, single, color) = linked(radio, TURNS)
    double.moves_left = 10**6
    began_s = radio.now_s()
    link.act([45, 90])
    assert radio.now_s() - began_s == pytest.approx(0.5, abs=0.03)
    assert double.calls[-1] == ("stop both", {"blocking": False})
    assert single.calls[-1] == ("stop", {"blocking": False})
    assert color.calls == []


@pytest.mark.parametrize(
    "values", [[1.0], [1.0, 2.0, 3.0, 4.0], [1.0, math.nan, 0.0], [math.inf, 0.0, 0.0]]
)
def test_values_that_are_no_commands_move_nothing(radio: PlayedRadio, values: list[float]) -> None:
    link, (double, single, _) = linked(radio, SPEEDS)
    with pytest.raises(EncodingError, match="are no 3 numbers; give one for each command"):
        link.act(values)
    assert double.calls == single.calls == []
    assert link.state is LinkState.READY


def test_rest_and_stop_and_close(radio: PlayedRadio) -> None:
    link, (double, single, color) = linked(radio, SPEEDS)
    link.act([300, 300, 300])
    assert link.state is LinkState.ARMED
    for device in radio.devices:
        device.calls.clear()
    link.rest()
    assert link.state is LinkState.READY
    assert double.calls == [("stop both", {"blocking": False})]
    assert single.calls == [("stop", {"blocking": False})]
    link.close()
    assert link.state is LinkState.DISCONNECTED
    assert [device.calls[-1] for device in radio.devices] == [("disconnect",)] * 3
    assert color.calls == [("disconnect",)]
    assert not any(device.connected for device in radio.devices)
    assert radio.limits_s[-3:] == [3.0] * 3
    link.close()
    assert len(color.calls) == 1


def test_disconnecting_that_fails_counts_as_done(
    radio: PlayedRadio, caplog: pytest.LogCaptureFixture
) -> None:
    link, (double, _, _) = linked(radio, SPEEDS)
    double.fails = RuntimeError("gone")
    link.close()
    assert not double.connected
    assert link.state is LinkState.DISCONNECTED
    gone = "the Double Motor takes no command (gone); call open()"
    assert caplog.messages == [f"closing the link to LEGO's devices: could not stop ({gone})"]


def test_device_that_is_gone_is_a_fault(radio: PlayedRadio) -> None:
    link, (_, single, _) = linked(radio, SPEEDS)
    single.connected = False
    gone = "^the Single Motor is gone; bring it near, and call open()"
    with pytest.raises(errors.HubDisconnectedError, match=gone):
        link.act([0, 0, 0])
    assert link.state is LinkState.FAULT
    with pytest.raises(errors.HubError, match="the link failed before"):
        link.read()
    link.open()
    # Only the one that was lost is connected anew.
    assert [device.calls.count(("disconnect",)) for device in radio.devices] == [0, 0, 0]
    connects = [[call[0] for call in device.calls].count("connect") for device in radio.devices]
    assert connects == [0, 1, 0]
    assert link.state is LinkState.READY


def test_reading_of_a_device_that_is_gone_is_a_fault(radio: PlayedRadio) -> None:
    link, (_, _, color) = linked(radio, SPEEDS)
    color.connected = False
    with pytest.raises(errors.HubDisconnectedError, match="the Color Sensor is gone; bring it"):
        link.read()


def test_silent_device_is_lost_after_a_second_and_connected_anew(radio: PlayedRadio) -> None:
    link, (_, _, color) = linked(radio, SPEEDS)
    link.read()
    color.is_silent = True
    began_s = radio.now_s()
    with pytest.raises(errors.HubTimeoutError, match="the Color Sensor has been silent for 1 s;"):
        link.read()
    assert radio.now_s() - began_s == pytest.approx(1.0, abs=0.03)
    color.is_silent = False
    link.open()
    assert [call[0] for call in color.calls] == ["disconnect", "connect"]
    assert link.read().values[3] == 42.0


def test_command_that_a_device_does_not_take_is_a_fault(radio: PlayedRadio) -> None:
    link, (double, _, _) = linked(radio, SPEEDS)
    double.fails = RuntimeError("no link")
    with pytest.raises(errors.HubDisconnectedError, match=r"takes no command \(no link\); call"):
        link.act([300, 0, 0])
    assert link.state is LinkState.FAULT


@pytest.mark.parametrize("mistake", [TypeError("no such argument"), ValueError("no such speed")])
def test_mistake_in_a_call_is_raised_as_it_is(radio: PlayedRadio, mistake: Exception) -> None:
    link, (double, _, _) = linked(radio, SPEEDS)
    double.fails = mistake
    with pytest.raises(type(mistake), match="no such"):
        link.act([300, 0, 0])


def test_device_out_of_reach_is_not_found(radio: PlayedRadio) -> None:
    link, (double, _, _) = linked(radio, SPEEDS)
    link.close()
    double.is_in_reach = False
    with pytest.raises(errors.HubNotFoundError, match="no Double Motor is in reach; switch it on"):
        link.open()
    assert link.state is not LinkState.READY


def test_device_that_refuses_the_connection_says_why(radio: PlayedRadio) -> None:
    link, (double, _, _) = linked(radio, SPEEDS)
    link.close()
    double.fails = RuntimeError("RPC 9.0")
    with pytest.raises(errors.HubRefusedError, match="Double Motor refuses the connection: RPC 9"):
        link.open()
    double.fails = errors.HubTimeoutError("no answer within 20 s")
    with pytest.raises(errors.HubTimeoutError, match="no answer within 20 s"):
        link.open()


def test_emergency_stop_ends_a_step_and_holds_until_release(radio: PlayedRadio) -> None:
    link, (double, single, _) = linked(radio, SPEEDS)
    link.act([300, 300, 300])
    double.calls.clear()

    def stop_later() -> None:
        radio.at_next_sleep = link.emergency_stop

    radio.at_next_sleep = stop_later
    with pytest.raises(errors.StoppedError):
        link.act([300, 300, 300])
    assert ("stop both", {"blocking": False}) in double.calls
    assert single.calls[-1] == ("stop", {"blocking": False})
    for call in (link.open, link.read, lambda: link.act([0, 0, 0])):
        with pytest.raises(errors.StoppedError):
            call()
    link.release()
    link.open()
    assert link.read().values[3] == 42.0


def test_closed_link_sends_nothing(radio: PlayedRadio) -> None:
    link = link_over(radio, SPEEDS)
    link.emergency_stop()
    link.release()
    link.stop()
    assert link.state is LinkState.DISCONNECTED
    for call in (link.read, link.rest, lambda: link.act([0, 0, 0])):
        with pytest.raises(errors.HubError, match=r"not open; call open\(\) first"):
            call()
    assert radio.devices == []


def checked(radio: PlayedRadio) -> dict[str, Finding]:
    """Findings of the check of the robot, in which nothing moves."""
    found = check_kit(radio, ROBOT, SPEEDS, may_move=lambda: False)
    return {finding.name: finding for finding in found}


def test_check_of_a_kit_in_words(radio: PlayedRadio) -> None:
    found = checked(radio)
    assert list(found) == [
        "Double Motor AB",
        "reports AB",
        "Single Motor C",
        "reports C",
        "Color Sensor D",
        "reports D",
        "directions",
    ]
    assert found["Double Motor AB"].detail == "firmware 1.2.3, battery 80 %"
    assert found["reports AB"] == Finding("reports AB", Outcome.OK, "67 a second")
    assert found["directions"].outcome is Outcome.SKIPPED
    assert not any(device.connected for device in radio.devices)


@pytest.mark.parametrize(
    ("battery_pct", "outcome", "words"),
    [(20, Outcome.OK, "battery 20 %"), (19, Outcome.WARNING, "battery 19 %, charge it")],
)
def test_low_battery_of_a_device(
    radio: PlayedRadio, battery_pct: int, outcome: Outcome, words: str
) -> None:
    link, devices = linked(radio, SPEEDS)
    link.close()
    package = sys.modules["legoeducation"]
    devices[0].info_device.batteryLevel = battery_pct
    package.DoubleMotor = lambda: devices[0]  # type: ignore[attr-defined]
    found = checked(radio)["Double Motor AB"]
    assert found == Finding("Double Motor AB", outcome, f"firmware 1.2.3, {words}")


def test_few_reports_are_a_slow_link(radio: PlayedRadio, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = 0
    report = PlayedRadio._report

    async def every_third(self: PlayedRadio) -> None:
        nonlocal calls
        calls += 1
        if calls % 3 == 0:
            await report(self)

    monkeypatch.setattr(PlayedRadio, "_report", every_third)
    found = checked(radio)["reports AB"]
    assert found.outcome is Outcome.WARNING
    assert found.detail.startswith("22 a second, of 67; disconnect other Bluetooth devices")


def test_drive_of_one_argument_is_a_move_of_both_wheels(radio: PlayedRadio) -> None:
    interface = Interface((DriveSpeed(-100, 100),), ANGLES, Wait(200))
    link, (double, single, _) = linked(radio, interface)
    link.act([-50])
    percent = round(50 * 360 / (math.pi * 56) / 10)
    assert double.calls[1:3] == [
        ("time", 600, how(0, percent, 0)),
        ("time", 600, how(1, percent, 1)),
    ]
    assert single.calls == []


def test_what_legos_package_logs_is_not_printed(
    radio: PlayedRadio, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Errors of the link say it."""
    logger = logging.getLogger("legoeducation")
    monkeypatch.setattr(logger, "handlers", [])
    monkeypatch.setattr(logger, "propagate", False)
    linked(radio, SPEEDS)
    logger.warning("the device left")
    assert capsys.readouterr().err == ""


def test_step_ends_with_reports_of_the_second_event_after_its_commands(radio: PlayedRadio) -> None:
    """Reports come each 15 ms; those of the first event were made before the commands arrived."""
    link, _ = linked(radio, replace(SPEEDS, settle=Wait(10)))
    assert radio.time_ms % 15 == 10
    # 5 and 20 ms from here on.
    assert link.act([0, 0, 0]).round_trip_s == pytest.approx(0.02, abs=0.006)
