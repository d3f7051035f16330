"""Faults of virtual robots: each kind changes what a program and a check see."""

from __future__ import annotations

import io
import random
from pathlib import Path

import pytest
from described import RUN_AWAY, SPINNING, TWO_WHEELER

from brickhub.errors import DescriptionError, HubError
from brickhub.finding import Outcome
from brickhub.hub.diagnostics.preflight import check_robot
from brickhub.hub.link.lockstep import HubLink
from brickhub.kits.virtual_kit import virtual_robot
from brickhub.robot import Sense
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.faults import (
    FAULT_KINDS,
    BreakingLink,
    FaultyBody,
    parse_fault,
    sound_body,
    with_faults,
)
from brickhub.virtual.run import run_file


def faulty(*faults: str) -> FaultyBody:
    body = with_faults(BenchBody(TWO_WHEELER, {"eyes": lambda angles: 300.0}), faults)
    assert isinstance(body, FaultyBody) or not faults
    return body  # type: ignore[return-value]


def checked(*faults: str) -> dict[str, tuple[Outcome, str]]:
    """Findings of a check that are not ok."""
    found = check_robot(
        virtual_robot(faulty(*faults)), TWO_WHEELER, SPINNING, may_move=lambda: True
    )
    return {
        f.name: (f.outcome, f.detail)
        for f in found
        if f.outcome not in (Outcome.OK, Outcome.SKIPPED)
    }


def test_a_sound_robot_is_its_own_body() -> None:
    body = BenchBody(TWO_WHEELER)
    assert with_faults(body, ()) is body and sound_body(body) is body and sound_body(None) is None
    assert sound_body(with_faults(body, ("battery=6",))) is body
    assert checked() == {}


@pytest.mark.parametrize(
    ("fault", "finding", "outcome", "says"),
    [
        ("battery=6.2", "battery", Outcome.WARNING, "6.20 V, it is low"),
        ("battery=5V", "battery", Outcome.ERROR, "it is empty"),
        ("port:left=C", "port E", Outcome.ERROR, "move it from port C to E"),
        ("port:left=d", "port E", Outcome.ERROR, "move it from port D to E"),
        ("absent:eyes", "port C", Outcome.ERROR, "nothing is there; plug it into port C"),
        ("absent:left", "port E", Outcome.ERROR, "nothing is there; plug it into port E"),
        ("dead:left", "motor left", Outcome.ERROR, "turned by 0 deg"),
        ("link=1s", "program", Outcome.ERROR, "out of reach"),
    ],
)
def test_a_check_finds_the_fault(fault: str, finding: str, outcome: Outcome, says: str) -> None:
    found = checked(fault)
    assert found[finding][0] is outcome and says in found[finding][1]


def test_a_reversed_motor_turns_the_other_way_and_tells_nothing() -> None:
    body = faulty("reversed:left")
    body.set_voltage("E", 5000)
    body.advance_to(500)
    assert body.angle_mdeg("E") > 0 > body.sound.angle_mdeg("E")
    assert faulty("reversed:left", "reversed:left").directions["E"] == 1


def test_a_slipping_wheel_loses_a_share_of_its_turn() -> None:
    body = faulty("slip:left=0.5")
    body.set_voltage("E", 5000)
    body.advance_to(500)
    assert body.angle_mdeg("E") == pytest.approx(2 * body.sound.angle_mdeg("E"), abs=2)


def test_a_weak_battery_makes_motors_slow() -> None:
    strong, weak = faulty("battery=7.2"), faulty("battery=5.4")
    for body in (strong, weak):
        body.set_voltage("E", 9000)
        body.advance_to(500)
    assert weak.angle_mdeg("E") < 0.8 * strong.angle_mdeg("E")


def test_a_dead_sensor_tells_that_there_is_nothing() -> None:
    assert faulty("dead:right").distance_mm("C") == 300
    body = faulty("dead:eyes")
    assert body.distance_mm("C") == body.sensed("C", Sense.DISTANCE) == 2000


def test_devices_are_found_where_they_are_plugged_in() -> None:
    body = faulty("port:left=C", "reversed:left")
    assert {motor.name: motor.port for motor in body.robot.motors} == {"left": "C", "right": "A"}
    assert body.robot.sensor("eyes").port == "E" and body.distance_mm("E") == 300
    body.set_voltage("C", 5000)
    body.advance_to(200)
    assert body.angle_mdeg("C") > 0 > body.sound.angle_mdeg("E"), "the left motor, reversed"
    assert TWO_WHEELER.motor("left").port == "E", "the description is as it was"
    body.reset(random.Random(0))


def test_a_link_breaks_once(tmp_path: Path) -> None:
    hub = virtual_robot(faulty("link=2s"))
    link = HubLink(hub, TWO_WHEELER, RUN_AWAY)
    link.open()
    while link.now_s() < 1.9:
        link.read()
    with pytest.raises(HubError, match="out of reach"):
        [link.read() for _ in range(10)]
    for _ in range(3):
        try:
            link.open()
        except HubError:
            continue
    assert link.read().values[0] == 0.0
    link.close()


def test_a_program_misses_what_is_not_plugged_in(tmp_path: Path) -> None:
    path, err = tmp_path / "main.py", io.StringIO()
    path.write_text(
        "from pybricks.pupdevices import UltrasonicSensor\nfrom pybricks.parameters import Port\n"
        "UltrasonicSensor(Port.C)\n"
    )
    assert run_file(path, faulty("absent:eyes"), stdout=io.BytesIO(), stderr=err) == 1
    assert "ENODEV" in err.getvalue()
    hint = (
        "The robot 'two-wheeler' has on its ports: A 'right' (spike-medium), E 'left' "
        "(spike-medium); use these"
    )
    assert hint in err.getvalue()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is no fault"),
        ("batery=6", "did you mean 'battery'"),
        ("battery", "write it as battery=6.2"),
        ("battery:left=6", "write it as battery=6.2"),
        ("battery=12", "give a number from 3 to 9"),
        ("battery=nan", "give a number from 3 to 9"),
        ("battery=6,2", "give a number from 3 to 9"),
        ("slip:left=1", "give a number from 0.01 to 0.95"),
        ("slip:left", "write it as slip:left=0.5"),
        ("link=0", "give a number from 0.1"),
        ("reversed:eyes", "one of a motor; choose left, right"),
        ("reversed:lft", "did you mean 'left'"),
        ("port:left=X", "no such port; choose A, B, C, D, E, F"),
    ],
)
def test_what_is_no_fault_is_refused(text: str, says: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        faulty(text)
    assert says in str(caught.value) and "\n" not in str(caught.value)


def test_every_kind_has_an_example_that_is_one() -> None:
    assert {parse_fault(kind.example).kind for kind in FAULT_KINDS.values()} == set(FAULT_KINDS)


class Recorded:
    """A sound body that notes what reaches it."""

    def __init__(self) -> None:
        self.robot = TWO_WHEELER
        self.battery_mv = 8000
        self.link = "cable"
        self.voltages: list[tuple[str, int | None]] = []
        self.angles = {"E": 90_000, "A": -30_000}

    def set_voltage(self, port: str, voltage_mv: int | None) -> None:
        self.voltages.append((port, voltage_mv))

    def angle_mdeg(self, port: str) -> int:
        return self.angles[port]

    def tilt_deg(self) -> tuple[float, float]:
        return 1.0, 2.0

    def heading_deg(self) -> float:
        return 33.0


@pytest.mark.parametrize(
    ("faults", "voltage_mv", "sound"),
    [
        ((), 5000, ("E", 5000)),
        (("reversed:left",), 5000, ("E", -5000)),
        (("slip:left=0.25",), 4000, ("E", 3000)),
        (("slip:left=0.25", "reversed:left"), 4000, ("E", -3000)),
        # A weak battery limits what the motor gets, before the share that is lost.
        (("battery=6",), 9000, ("E", 6000)),
        (("battery=6",), -9000, ("E", -6000)),
        (("battery=6", "slip:left=0.5"), 9000, ("E", 3000)),
        (("battery=6",), 5000, ("E", 5000)),
        (("dead:left",), 5000, ("E", None)),
        (("slip:left=0.25",), None, ("E", None)),
        (("reversed:right",), 5000, ("E", 5000)),
    ],
)
def test_a_motor_gets_what_its_faults_leave_of_its_voltage(
    faults: tuple[str, ...], voltage_mv: int | None, sound: tuple[str, int | None]
) -> None:
    recorded = Recorded()
    body = FaultyBody(recorded)  # type: ignore[arg-type]
    for text in faults:
        fault = parse_fault(text)
        FAULT_KINDS[fault.kind].apply(body, fault)
    body.set_voltage("E", voltage_mv)
    assert recorded.voltages == [sound]


def test_a_motor_tells_its_own_turn_and_not_that_of_the_floor() -> None:
    recorded = Recorded()
    body = FaultyBody(recorded)  # type: ignore[arg-type]
    slip = parse_fault("slip:left=0.75")
    FAULT_KINDS["slip"].apply(body, slip)
    # It does not jump when it begins to slip, and four degrees are one on the floor from then on.
    assert body.angle_mdeg("E") == 90_000
    recorded.angles["E"] = 90_000 + 25_000
    assert body.angle_mdeg("E") == 90_000 + 100_000
    FAULT_KINDS["reversed"].apply(body, parse_fault("reversed:left"))
    assert body.angle_mdeg("E") == -190_000 and body.angle_mdeg("A") == -30_000
    # What no fault changes is the sound body's, also what is set.
    assert (body.tilt_deg(), body.heading_deg(), body.battery_mv) == ((1.0, 2.0), 33.0, 8000)
    body.battery_mv, body.link = 7500, "air"  # type: ignore[assignment]
    assert (recorded.battery_mv, recorded.link) == (7500, "air") == (body.battery_mv, body.link)
    FAULT_KINDS["battery"].apply(body, parse_fault("battery=6.25V"))
    assert (body.battery_mv, recorded.battery_mv) == (6250, 7500)


def test_a_link_that_breaks_refuses_two_calls() -> None:
    now_s = 1.0
    reaches = BreakingLink(2.0, lambda: now_s)
    assert [reaches() for _ in range(3)] == [True] * 3
    now_s = 2.0
    assert [reaches() for _ in range(4)] == [False, False, True, True]
