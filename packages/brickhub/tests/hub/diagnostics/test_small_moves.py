"""Preflight check of moves, wheels and sensors by readings that are made up, and its words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, cast

import pytest
from described import ROBO_ARM, TWO_WHEELER

from brickhub.finding import Finding, Outcome
from brickhub.hub.diagnostics.preflight import (
    Latency,
    _reversing,
    check_angles,
    check_battery,
    check_distances,
    check_hub,
    check_imu,
    check_latency,
    check_moves,
    check_ports,
    check_wheels,
    judged,
    latency,
    small_move,
)
from brickhub.hub.diagnostics.survey import Survey, WheelTurn
from brickhub.hub.interface import (
    Command,
    Distance,
    DriveSpeed,
    DriveStraight,
    HubLight,
    Interface,
    MotorAngle,
    Pitch,
    RunAngle,
    RunSpeed,
    TrackTarget,
    Turn,
    UntilDone,
    Wait,
)
from brickhub.hub.link.robot_link import Reading, RobotLink
from brickhub.hub.transports.connection import HubIdentity
from brickhub.robot import Direction, DriveBase, HubKind, Motor, Robot

CART = Robot(
    "cart",
    HubKind.PRIME,
    (Motor("left", "A"), Motor("right", "B"), Motor("arm", "C", range_deg=(0, 100))),
    drive_base=DriveBase("left", "right", 50.0, 100.0),
)
ANGLES = (MotorAngle("left"), MotorAngle("right", -999, 999), MotorAngle("arm", 0, 100))


class PlayedLink:
    """A link whose angles change by what is given, at the first commands."""

    def __init__(
        self, before: Sequence[float] = (350.0, 0.0, 20.0), turns: Sequence[float] = ()
    ) -> None:
        self.values = list(before)
        self.turns = turns
        self.acted: list[list[float]] = []
        self.reads = 0
        self._now_s = 100.0

    def now_s(self) -> float:
        return self._now_s

    def read(self) -> Reading:
        self.reads += 1
        self._now_s += 0.1
        return Reading(tuple(self.values), 0, 0.1)

    def act(self, values: Iterable[float]) -> Reading:
        if not self.acted:
            for index, turn in enumerate(self.turns):
                self.values[index] += turn
        self.acted.append(list(values))
        return self.read()


def moved(
    link: PlayedLink,
    *commands: Command,
    answer: bool | None = None,
    advise: Any = None,
    channels: Any = ANGLES,
) -> list[Finding]:
    """Findings of a check that a person allows, and answers so."""
    found = check_moves(
        cast("RobotLink", link),
        CART,
        Interface(commands, channels, Wait(100)),
        lambda: True,
        lambda question: answer,
        advise,
    )
    return list(found)


def test_nothing_moves_without_a_yes() -> None:
    link = PlayedLink()
    interface = Interface((RunAngle("left", -90, 90, 100),), ANGLES, Wait(100))
    found = list(check_moves(cast("RobotLink", link), CART, interface, lambda: False, None))
    nothing = "nothing was moved, because nobody said yes"
    assert found == [Finding("directions", Outcome.SKIPPED, nothing)]
    assert link.acted == []


def test_motor_that_turned_is_right_and_a_person_is_asked() -> None:
    questions = []

    def is_right(question: str) -> bool:
        questions.append(question)
        return True

    link = PlayedLink(turns=(30.0,))
    commands = (RunAngle("left", -90, 90, 100), RunAngle("right", -90, 90, 100))
    interface = Interface(commands[:1], ANGLES, Wait(100))
    found = list(check_moves(cast("RobotLink", link), CART, interface, lambda: True, is_right))
    assert found == [Finding("motor left", Outcome.OK, "moved by 30 deg")]
    assert questions == ["motor left moved by 30 deg"]
    assert link.acted == [[30.0]]
    # It is watched for 1.2 s after the step: a reading takes 0.1 s here.
    assert 12 <= link.reads - 2 <= 13


def test_nobody_watches() -> None:
    link = PlayedLink(turns=(30.0,))
    interface = Interface((RunAngle("left", -90, 90, 100),), ANGLES, Wait(100))
    found = list(check_moves(cast("RobotLink", link), CART, interface, lambda: True, None))
    assert found == [Finding("motor left", Outcome.OK, "moved by 30 deg, nobody watched")]
    assert moved(PlayedLink(turns=(30.0,)), RunAngle("left", -90, 90, 100)) == found


@pytest.mark.parametrize(
    ("turned_deg", "is_right"),
    [(30.0, True), (15.0, True), (14.9, False), (0.0, False), (-30.0, False), (50.0, True)],
)
def test_motor_turns_by_half_of_the_move_at_least(turned_deg: float, is_right: bool) -> None:
    (found,) = moved(PlayedLink(turns=(0.0, turned_deg)), RunAngle("right", -90, 90, 100))
    assert (found.outcome is Outcome.OK) is is_right
    if not is_right:
        what = f"'right' (port B) turned by {turned_deg:.0f} deg after 30 deg"
        assert found.detail == f"{what}; it is blocked, or its cable is loose"


@pytest.mark.parametrize(
    ("turned_deg", "is_right"),
    # An endless move turns by 10 degrees or more, whichever way round a wrapped angle goes.
    [(10.0, True), (5.0, True), (4.9, False), (170.0, True), (190.0, False)],
)
def test_endless_move_turns_the_right_way(turned_deg: float, is_right: bool) -> None:
    link = PlayedLink(turns=(turned_deg,))
    (found,) = moved(link, RunSpeed("left", -90, 90))
    assert (found.outcome is Outcome.OK) is is_right
    # It is ended by zeros.
    assert link.acted == [[30.0], [0.0]]


def test_whole_turns_are_added_to_a_wrapped_angle() -> None:
    """30 mm of wheels of 10 mm are 344 degrees, which look like 16 the other way."""
    cart = replace(CART, drive_base=DriveBase("left", "right", 10.0, 100.0))
    link = PlayedLink(turns=(344.0, 344.0))
    interface = Interface((DriveStraight(-90, 90),), ANGLES[:2], UntilDone())
    found = list(check_moves(cast("RobotLink", link), cart, interface, lambda: True, None))
    assert found == [Finding("straight", Outcome.OK, "moved by 30 mm, nobody watched")]
    link = PlayedLink(turns=(344.0, 170.0))
    (found_blocked,) = check_moves(cast("RobotLink", link), cart, interface, lambda: True, None)
    assert found_blocked.outcome is Outcome.ERROR
    assert "'right' (port B) turned by 170 deg after 30 mm" in found_blocked.detail


def test_other_commands_stay_at_zero() -> None:
    link = PlayedLink(turns=(30.0, 30.0, 30.0))
    commands = (
        RunAngle("left", -90, 90, 100),
        RunAngle("right", -20, 20, 100),
        TrackTarget("arm", 0, 100),
    )
    names = [finding.name for finding in moved(link, *commands)]
    assert names == ["motor left", "motor right", "motor arm"]
    assert link.acted[0] == [30.0, 0.0, 0.0]
    # The angles change at the first commands only, so what follows stands still.
    assert link.acted[1] == [0.0, 20.0, 0.0]
    # A target may be reached already, and a step that goes on is ended.
    assert link.acted[2:] == [[0.0, 0.0, 30.0], [0.0, 0.0, 0.0]]


def test_light_is_looked_at() -> None:
    link = PlayedLink()
    assert moved(link, HubLight()) == [Finding("light", Outcome.OK, "359 deg, look or listen")]
    assert link.acted == [[359.0]]


def test_motor_whose_angle_nobody_reads_is_watched_only() -> None:
    link = PlayedLink(before=(1.0,), turns=(0.0,))
    (found,) = moved(link, RunAngle("right", -90, 90, 100), channels=(Pitch(),), answer=True)
    assert found == Finding("motor right", Outcome.OK, "moved by 30 deg")


def wrong(*commands: Command, advise: Any = None) -> str:
    """What is said to a person who says that a move was wrong."""
    link = PlayedLink(turns=(30.0 / 3.14159 / 50.0 * 360.0, 30.0 / 3.14159 / 50.0 * 360.0))
    (found,) = moved(link, *commands, answer=False, advise=advise)
    assert found.outcome is Outcome.ERROR
    return found.detail


def advice_for(names: Sequence[str]) -> str:
    return f"reverse {'+'.join(names)}"


def test_words_for_who_says_no() -> None:
    says = "and you say that it was another motor or the wrong way"
    one = f"moved by 30 deg, {says}; if it was another motor, swap the cables (port A)"
    assert wrong(RunAngle("left", -90, 90, 100)) == one
    reverse = "; if it was the wrong way, reverse left"
    assert wrong(RunAngle("left", -90, 90, 100), advise=advice_for) == one + reverse
    two = f"moved by 30 mm, {says}; if it was another motor, swap the cables (port A and B)"
    assert wrong(DriveStraight(-90, 90)) == two
    each = (
        "; for each motor, and only one, that turned the wrong way: "
        "'left': reverse left, 'right': reverse right"
    )
    assert wrong(DriveStraight(-90, 90), advise=advice_for) == two + each


@pytest.mark.parametrize(
    ("command", "range_deg", "angle_deg", "value"),
    [
        (RunAngle("arm", -90, 90, 9), None, None, 30.0),
        (RunAngle("arm", -90, 90, 9), None, 80.0, 30.0),
        (RunAngle("arm", -90, 90, 9), (0, 100), None, 30.0),
        (RunAngle("arm", -90, 90, 9), (0, 100), 50.0, 30.0),
        (RunAngle("arm", -90, 90, 9), (0, 100), 50.1, -30.0),
        (RunAngle("arm", -10, 90, 9), (0, 100), 80.0, 30.0),
        (RunAngle("arm", -20, 20, 9), (0, 100), 80.0, -20.0),
        (RunAngle("arm", -100, 0, 9), None, None, -30.0),
        (RunAngle("arm", 0, 100, 9), (0, 100), 80.0, 30.0),
        (RunAngle("arm", 50, 100, 9), None, None, 50.0),
        (DriveSpeed(-20, 10), None, None, -20.0),
        (Turn(-10, 10), None, None, 10.0),
    ],
)
def test_small_move_of_a_command(
    command: Command, range_deg: tuple[int, int] | None, angle_deg: float | None, value: float
) -> None:
    assert small_move(command, range_deg, angle_deg) == value


def wheels(left_deg: float, right_deg: float, turned_deg: float = 90.0) -> list[Finding]:
    """Findings of wheels that turn by 90 degrees, by which the robot turns 22.5."""
    turns = [WheelTurn("left", turned_deg, left_deg), WheelTurn("right", turned_deg, right_deg)]
    return list(check_wheels(CART, turns, advice_for))


def test_words_about_wheels() -> None:
    by = "by its gyroscope"
    assert wheels(22.4, -22.6) == [
        Finding("wheel left", Outcome.OK, f"turned the robot by 22 of 22 deg, {by}"),
        Finding("wheel right", Outcome.OK, f"turned the robot by -23 of -22 deg, {by}"),
    ]
    slipped, turned_wrongly = wheels(10.0, 20.0)
    assert slipped.outcome is Outcome.WARNING
    assert slipped.detail.startswith(f"turned the robot by 10 of 22 deg, {by}; it slips, or is")
    wrong_way = "it turns the wrong way (port B): reverse right"
    assert turned_wrongly.outcome is Outcome.ERROR
    assert turned_wrongly.detail == f"turned the robot by 20 of -22 deg, {by}; {wrong_way}"
    stayed = wheels(1.0, -1.0)[0]
    assert stayed.outcome is Outcome.SKIPPED
    assert stayed.detail.startswith(f"the robot stayed as it was, {by}: on the bench, or its")


@pytest.mark.parametrize(
    ("share", "outcome"),
    [
        (0.81, Outcome.OK),
        (0.8, Outcome.OK),
        (0.79, Outcome.WARNING),
        (0.0, Outcome.WARNING),
        (-0.14, Outcome.WARNING),
        (-0.15, Outcome.ERROR),
        (1.5, Outcome.OK),
    ],
)
def test_wheel_by_its_share_of_the_turn(share: float, outcome: Outcome) -> None:
    assert [finding.outcome for finding in wheels(22.5, -22.5 * share)] == [Outcome.OK, outcome]


@pytest.mark.parametrize(
    ("share", "outcome"),
    [(0.15, Outcome.WARNING), (0.14, Outcome.SKIPPED), (-0.14, Outcome.SKIPPED)],
)
def test_robot_that_hardly_turned_at_all_is_on_the_bench(share: float, outcome: Outcome) -> None:
    assert [finding.outcome for finding in wheels(22.5 * share, 0.0)] == [
        outcome,
        Outcome.SKIPPED if outcome is Outcome.SKIPPED else Outcome.WARNING,
    ]


def test_wheel_that_hardly_turned_has_no_second_finding() -> None:
    # A turn of the wheel by 4 degrees turns the robot by 1.
    assert len(wheels(1.0, -1.0, turned_deg=4.0)) == 2
    assert wheels(1.0, -1.0, turned_deg=3.9) == []
    assert list(check_wheels(ROBO_ARM, [], advice_for)) == []


def test_advice_for_motors_that_turn_wrongly() -> None:
    turned = replace(CART.motor("left"), direction=Direction.COUNTERCLOCKWISE)
    calibrated = replace(CART, motors=(turned, *CART.motors[1:]))
    said = {
        names: _reversing("brickhub calibrate cart", CART, calibrated, names)
        for names in (("right",), ("left",), ("right", "arm"), ("left", "right"))
    }
    assert said == {
        ("right",): "`brickhub calibrate cart --reverse right`",
        ("left",): "`brickhub calibrate cart --as-described left`",
        ("right", "arm"): "`brickhub calibrate cart --reverse right arm`",
        ("left", "right"): (
            "`brickhub calibrate cart --reverse right` and "
            "`brickhub calibrate cart --as-described left`"
        ),
    }


@pytest.mark.parametrize(
    ("hub", "battery_mv", "outcome", "detail"),
    [
        (HubKind.PRIME, 6800, Outcome.OK, "6.80 V"),
        (
            HubKind.PRIME,
            6799,
            Outcome.WARNING,
            "6.80 V, it is low and the motors are weak; charge it",
        ),
        (
            HubKind.PRIME,
            6000,
            Outcome.WARNING,
            "6.00 V, it is low and the motors are weak; charge it",
        ),
        (HubKind.PRIME, 5999, Outcome.ERROR, "6.00 V, it is empty; charge it"),
        (HubKind.TECHNIC, 5400, Outcome.OK, "5.40 V"),
        (
            HubKind.TECHNIC,
            4800,
            Outcome.WARNING,
            "4.80 V, it is low and the motors are weak; put fresh batteries in",
        ),
        (HubKind.TECHNIC, 4799, Outcome.ERROR, "4.80 V, it is empty; put fresh batteries in"),
    ],
)
def test_battery_at_its_limits(
    hub: HubKind, battery_mv: int, outcome: Outcome, detail: str
) -> None:
    assert check_battery(hub, battery_mv) == Finding("battery", outcome, detail)


def test_first_problem_is_the_one_that_is_said() -> None:
    first = (True, Outcome.ERROR, ", bad")
    second = (True, Outcome.WARNING, ", poor")
    none = (False, Outcome.ERROR, ", worse")
    assert judged("it", "is", none, first, second) == Finding("it", Outcome.ERROR, "is, bad")
    assert judged("it", "is", none, second) == Finding("it", Outcome.WARNING, "is, poor")
    assert judged("it", "is", none) == Finding("it", Outcome.OK, "is")


SURVEY = Survey({"A": 48}, {}, 8000, "4.0.1", "hub", True, True, -3, 12)


@pytest.mark.parametrize(
    ("ready", "still", "outcome", "detail"),
    [
        (True, True, Outcome.OK, "ready, pitch -3, roll 12 deg"),
        (True, False, Outcome.OK, "ready, pitch -3, roll 12 deg, moving"),
        (
            False,
            True,
            Outcome.WARNING,
            (
                "pitch -3, roll 12 deg, not ready; leave the robot still for some seconds and "
                "check again"
            ),
        ),
        (
            None,
            None,
            Outcome.ERROR,
            (
                "the hub did not say anything about its IMU; update its firmware on "
                "code.pybricks.com"
            ),
        ),
    ],
)
def test_words_about_the_imu(
    ready: bool | None, still: bool | None, outcome: Outcome, detail: str
) -> None:
    survey = replace(SURVEY, imu_ready=ready, imu_still=still)
    assert list(check_imu(TWO_WHEELER, survey)) == [Finding("imu", outcome, detail)]


@pytest.mark.parametrize(
    ("angle_deg", "outcome"),
    [(2.0, Outcome.OK), (1.9, Outcome.ERROR), (78.0, Outcome.OK), (78.1, Outcome.ERROR)],
)
def test_joint_yields_by_eight_degrees(angle_deg: float, outcome: Outcome) -> None:
    interface = Interface((), (Pitch(), MotorAngle("low", 10, 70)), Wait(9))
    (found,) = check_angles(ROBO_ARM, interface, [0.0, angle_deg])
    assert found.name == "angle low"
    assert found.outcome is outcome
    assert found.detail.startswith(f"{angle_deg:.0f} deg, range 10 to 70")
    assert found.detail.endswith("`brickhub calibrate`") is (outcome is Outcome.ERROR)


def test_distance_without_an_end_is_doubtful_and_no_error() -> None:
    interface = Interface((), (Pitch(), Distance("eyes")), Wait(9))
    near = list(check_distances(interface, [0.0, 1999.4]))
    assert near == [Finding("reading distance", Outcome.OK, "1999 mm")]
    (far,) = check_distances(interface, [0.0, 2000.0])
    assert far.outcome is Outcome.OK
    assert far.detail.startswith("2000 mm, nothing in sight; hold a hand before it")


SLOW = Latency(100, 90.4, 120.6, 45.0, 0.25)


def test_words_about_the_round_trip() -> None:
    base = "90 ms, p99 121 ms, connection interval 45 ms, 25 % of a step"
    slow = check_latency(SLOW)
    assert (slow.name, slow.outcome) == ("round trip", Outcome.WARNING)
    assert slow.detail.startswith(f"{base}; ")
    played = f"{base}, as played; another link is played with --link, such as --link mac"
    assert check_latency(SLOW, is_virtual=True) == Finding("round trip", Outcome.OK, played)
    cable = "90 ms, p99 121 ms, 25 % of a step"
    assert check_latency(SLOW, has_radio=False) == Finding("round trip", Outcome.OK, cable)
    quick = replace(SLOW, interval_ms=20.0, link_share=None)
    assert not quick.is_slow
    words = "90 ms, p99 121 ms, connection interval 20 ms"
    assert check_latency(quick) == Finding("round trip", Outcome.OK, words)
    assert check_latency(quick, is_virtual=True) == Finding("round trip", Outcome.OK, words)
    assert replace(SLOW, interval_ms=21.25).is_slow


def test_interval_is_half_of_a_round_trip_in_bluetooths_units() -> None:
    interface = Interface((), (Pitch(),), Wait(100))
    found = latency([0.0319] * 10, interface)
    assert found.exchanges == 10
    assert (found.p50_ms, found.p99_ms) == (pytest.approx(31.9), pytest.approx(31.9))
    # 15.95 ms are 12.76 units of 1.25 ms.
    assert found.interval_ms == 16.25
    assert found.link_share == pytest.approx(31.9 / 131.9)


def identity(**changed: Any) -> HubIdentity:
    """A prime hub with the firmware that this was written for."""
    told: dict[str, Any] = {
        "name": "Rover",
        "address": "C0:01",
        "kind": HubKind.PRIME,
        "firmware": "4.0.1",
        "profile_version": (1, 5, 0),
    }
    return cast("HubIdentity", type("Told", (), told | changed))


def test_words_about_a_hub() -> None:
    assert list(check_hub(None, TWO_WHEELER)) == []
    assert list(check_hub(identity(), TWO_WHEELER)) == [
        Finding("hub", Outcome.OK, "'Rover', prime, C0:01"),
        Finding("firmware", Outcome.OK, "Pybricks 4.0.1, profile 1.5.0"),
    ]
    other, _ = check_hub(identity(kind=HubKind.EV3), TWO_WHEELER)
    words = "it is an ev3 hub, 'two-wheeler' has a prime hub; take that one, or describe your robot"
    assert other == Finding("hub", Outcome.ERROR, words)


@pytest.mark.parametrize(
    ("firmware", "profile_version", "outcome", "words"),
    [
        ("2.0.0", (1, 0, 0), Outcome.WARNING, "; BricksRL was written for version 4, update it"),
        ("3.6.1", (1, 4, 0), Outcome.WARNING, "; BricksRL was written for version 4, update it"),
        ("3.6.1", (9, 0, 0), Outcome.WARNING, "; BricksRL was written for version 4, update it"),
        ("30.1", (1, 5, 0), Outcome.OK, ""),
        ("5.0.0", (9, 0, 0), Outcome.WARNING, ", which is newer than this brickhub; update it"),
    ],
)
def test_firmware_of_another_version(
    firmware: str, profile_version: tuple[int, ...], outcome: Outcome, words: str
) -> None:
    told = identity(firmware=firmware, profile_version=profile_version)
    _, found = check_hub(told, TWO_WHEELER)
    assert found.outcome is outcome
    version = ".".join(map(str, profile_version))
    assert found.detail.startswith(f"Pybricks {firmware}, profile {version}{words}")


def test_words_about_ports() -> None:
    survey = replace(SURVEY, ports={"A": 48, "B": 48, "C": 0, "D": 62, "E": 49, "F": 99})
    found = {finding.name: finding for finding in check_ports(TWO_WHEELER, survey)}
    assert found["port A"] == Finding("port A", Outcome.OK, "'right', motor spike-medium")
    harmless = "nothing is expected, motor spike-medium is there, which does no harm"
    assert found["port B"] == Finding("port B", Outcome.OK, harmless)
    moved_away = "'eyes', ultrasonic sensor is expected, nothing is there; move it from port D to C"
    assert found["port C"] == Finding("port C", Outcome.ERROR, moved_away)
    other = (
        "'left', motor spike-medium is expected, motor spike-large is there; it works, but the "
        "virtual robot has the other one's strength"
    )
    assert found["port E"] == Finding("port E", Outcome.WARNING, other)
    assert found["port F"].detail == "nothing is expected, device 99 is there, which does no harm"
    unplugged = replace(SURVEY, ports={})
    missing = {finding.name: finding for finding in check_ports(TWO_WHEELER, unplugged)}
    assert missing["port B"] == Finding("port B", Outcome.OK, "nothing is expected")
    plug_in = "nothing is there; plug it into port C until it clicks"
    assert missing["port C"].detail == f"'eyes', ultrasonic sensor is expected, {plug_in}"


def test_motor_without_encoder_in_place_of_one_is_an_error() -> None:
    survey = replace(SURVEY, ports={"A": 1, "C": 62, "E": 48})
    found = {finding.name: finding for finding in check_ports(TWO_WHEELER, survey)}
    assert found["port A"].outcome is Outcome.ERROR
    assert "motor medium-linear is there; plug it into port A" in found["port A"].detail
