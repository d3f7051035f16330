"""Faults of virtual robots: numbers just within their ranges and just beyond, and what a faulty
body passes on of a sound one."""

from __future__ import annotations

from typing import Any

import pytest
from described import TWO_WHEELER

from brickhub.errors import DescriptionError
from brickhub.robot import HubKind, PoweredUpSensor, Robot, Sense, SensorKind
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.faults import BreakingLink, Fault, FaultyBody, parse_fault, with_faults


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("battery=3", Fault("battery", value=3.0)),
        ("battery=9", Fault("battery", value=9.0)),
        ("battery=6.25V", Fault("battery", value=6.25)),
        (" BATTERY = 7v ", Fault("battery", value=7.0)),
        ("slip:left=0.01", Fault("slip", "left", 0.01)),
        ("slip:left=0.95", Fault("slip", "left", 0.95)),
        ("link=0.1", Fault("link", value=0.1)),
        ("link=1000000s", Fault("link", value=1e6)),
        ("link=12s", Fault("link", value=12.0)),
        ("reversed:left", Fault("reversed", "left")),
        ("dead : eyes", Fault("dead", "eyes")),
        ("absent:eyes", Fault("absent", "eyes")),
        ("port:left=c", Fault("port", "left", port="C")),
    ],
)
def test_faults(text: str, fault: Fault) -> None:
    assert parse_fault(text) == fault


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("battery=2.99", "give a number from 3 to 9, such as battery=6.2"),
        ("battery=9.01", "give a number from 3 to 9, such as battery=6.2"),
        ("battery=6s", "give a number from 3 to 9, such as battery=6.2"),
        ("slip:left=0.009", "give a number from 0.01 to 0.95, such as slip:left=0.5"),
        ("slip:left=0.96", "give a number from 0.01 to 0.95, such as slip:left=0.5"),
        ("link=0.09", "give a number from 0.1 to 1e+06, such as link=12s"),
        ("link=1000001", "give a number from 0.1 to 1e+06, such as link=12s"),
        ("link=5V", "give a number from 0.1 to 1e+06, such as link=12s"),
        ("slip=0.5", "is not a whole fault; write it as slip:left=0.5"),
        ("reversed", "is not a whole fault; write it as reversed:left"),
        ("reversed:left=1", "is not a whole fault; write it as reversed:left"),
        ("reversed=1", "is not a whole fault; write it as reversed:left"),
        ("port:left", "is not a whole fault; write it as port:left=C"),
    ],
)
def test_texts_that_are_no_faults(text: str, says: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        parse_fault(text)
    assert str(caught.value).endswith(says)


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        (
            "dead:lamp",
            (
                "fault dead:lamp: robot 'two-wheeler' has no 'lamp' plugged in; "
                "choose left, right, eyes"
            ),
        ),
        ("slip:eyes=0.5", "fault slip:eyes is one of a motor; choose left, right"),
        ("port:eyes=H", "fault port:eyes=H: the hub has no such port; choose A, B, C, D, E, F"),
    ],
)
def test_faults_that_do_not_suit_the_robot(fault: str, says: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        with_faults(sound(), [fault])
    assert str(caught.value) == says


def sound() -> BenchBody:
    return BenchBody(TWO_WHEELER, {"eyes": lambda angles: 300.0})


def faulty(*faults: str) -> FaultyBody:
    body = with_faults(sound(), faults)
    assert isinstance(body, FaultyBody)
    return body


def ports(body: FaultyBody) -> dict[str, str]:
    return {device.name: device.port for device in (*body.robot.motors, *body.robot.sensors)}


@pytest.mark.parametrize(
    ("faults", "expected"),
    [
        (["battery=6"], {"left": "E", "right": "A", "eyes": "C"}),
        (["port:left=E"], {"left": "E", "right": "A", "eyes": "C"}),
        (["port:left=D"], {"left": "D", "right": "A", "eyes": "C"}),
        (["port:left=A"], {"left": "A", "right": "E", "eyes": "C"}),
        (["port:eyes=A"], {"left": "E", "right": "C", "eyes": "A"}),
        (["absent:left"], {"right": "A", "eyes": "C"}),
        (["absent:eyes"], {"left": "E", "right": "A"}),
        (["port:left=A", "absent:right"], {"left": "A", "eyes": "C"}),
        (["port:left=A", "port:left=C"], {"left": "C", "right": "E", "eyes": "A"}),
    ],
)
def test_wiring(faults: list[str], expected: dict[str, str]) -> None:
    assert ports(faulty(*faults)) == expected


def test_angles_come_from_the_motor_wherever_it_is_plugged_in() -> None:
    body = faulty("port:left=A")
    body.set_voltage("A", 6000)
    body.set_voltage("E", -3000)
    body.advance_to(300)
    assert body.angle_mdeg("A") == body.sound.angle_mdeg("E") > 0
    assert body.angle_mdeg("E") == body.sound.angle_mdeg("A") < 0
    assert (body.sound_port("A"), body.sound_port("E"), body.sound_port("B")) == ("E", "A", "B")


class Moving(BenchBody):
    """A body that is somewhere, and moves."""

    note = "of the sound body"

    def acceleration_mm_s2(self) -> tuple[float, float, float]:
        return 1.0, 2.0, 3.0

    def angular_velocity_deg_s(self) -> tuple[float, float, float]:
        return 4.0, 5.0, 6.0

    def rotation_deg(self) -> tuple[float, float, float]:
        return 7.0, 8.0, 9.0

    def heading_deg(self) -> float:
        return 10.0

    def tilt_deg(self) -> tuple[float, float]:
        return 11.0, 12.0

    def true_place(self) -> tuple[float, float, float]:
        return 13.0, 14.0, 15.0


def test_what_no_fault_changes_is_that_of_the_sound_body() -> None:
    body: Any = with_faults(Moving(TWO_WHEELER), ["battery=5"])
    assert body.acceleration_mm_s2() == (1.0, 2.0, 3.0)
    assert body.angular_velocity_deg_s() == (4.0, 5.0, 6.0)
    assert body.rotation_deg() == (7.0, 8.0, 9.0)
    assert body.heading_deg() == 10.0
    assert body.tilt_deg() == (11.0, 12.0)
    assert body.true_place() == (13.0, 14.0, 15.0)
    assert body.note == "of the sound body"
    assert body.distance_mm("C") == 2000
    assert body.battery_mv == 5000 and body.sound.battery_mv == 7200
    with pytest.raises(AttributeError):
        body.nothing  # noqa: B018


def test_a_body_in_the_making_has_nothing_yet() -> None:
    """Copies and pickles ask for attributes before there are any."""
    empty = object.__new__(FaultyBody)
    with pytest.raises(AttributeError, match="^sound$"):
        empty.anything  # noqa: B018


@pytest.mark.parametrize(
    ("kind", "sense", "stimulus", "nothing"),
    [
        (SensorKind.COLOR, Sense.SURFACE, (120.0, 50.0, 60.0), (0.0, 0.0, 0.0)),
        (SensorKind.COLOR, Sense.AMBIENT, 30.0, 0.0),
        (SensorKind.FORCE, Sense.FORCE, 5.0, 0.0),
        (SensorKind.TILT, Sense.TILT, (10.0, 20.0), (0.0, 0.0)),
        (SensorKind.INFRARED, Sense.DISTANCE, 40.0, 100.0),
        (SensorKind.INFRARED, Sense.COUNT, 7.0, 0.0),
        (SensorKind.ULTRASONIC, Sense.DISTANCE, 300.0, 2000.0),
        (SensorKind.EV3_ULTRASONIC, Sense.DISTANCE, 300.0, 2550.0),
        (SensorKind.EV3_GYRO, Sense.ROTATION, (30.0, 5.0), (0.0, 0.0)),
        (SensorKind.EV3_INFRARED, Sense.BEACON, (40.0, 10.0), ()),
    ],
)
def test_a_dead_sensor_senses_nothing(
    kind: SensorKind, sense: Sense, stimulus: Any, nothing: Any
) -> None:
    hub, port = (HubKind.EV3, "2") if kind.value.startswith("Ev3") else (HubKind.PRIME, "B")
    robot = Robot("one", hub, sensors=(PoweredUpSensor("it", port, kind),))
    first = kind.model.senses[0]
    readings = {"it" if sense is first else f"it.{sense}": lambda angles: stimulus}
    if sense is not first and first not in (Sense.DISTANCE, Sense.ROTATION):
        readings["it"] = lambda angles: 0.0
    elif first is Sense.DISTANCE and "it" not in readings:
        readings["it"] = lambda angles: 1.0
    alive = with_faults(BenchBody(robot, readings), ["battery=7"])
    assert alive.sensed(port, sense) == stimulus
    dead = with_faults(BenchBody(robot, readings), ["dead:it"])
    assert dead.sensed(port, sense) == nothing
    if kind.model.range_mm is not None:
        assert (alive.distance_mm(port), dead.distance_mm(port)) == (300, nothing)
    elif sense is Sense.DISTANCE:
        assert dead.distance_mm(port) == 2000


def test_a_broken_link_is_out_of_reach_for_two_calls_from_its_time_on() -> None:
    now_s = 4.999
    in_reach = BreakingLink(5.0, lambda: now_s)
    assert in_reach()
    now_s = 5.0
    assert [in_reach() for _ in range(4)] == [False, False, True, True]
    assert with_faults(sound(), ["link=5"]).link_breaks_s == 5.0  # type: ignore[attr-defined]


def test_a_slipping_motor_begins_where_it_is() -> None:
    body = sound()
    body.set_voltage("E", 5000)
    body.advance_to(300)
    start = body.angle_mdeg("E")
    assert start > 1000
    slipping = with_faults(body, ["slip:left=0.5", "reversed:left"])
    assert slipping.angle_mdeg("E") == -start
    body.advance_to(600)
    gone = body.angle_mdeg("E") - start
    assert slipping.angle_mdeg("E") == -(start + 2 * gone)
