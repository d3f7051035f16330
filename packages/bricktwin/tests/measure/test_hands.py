"""A simulated person: how long a deed takes, and what it leaves the robot in."""

from __future__ import annotations

import numpy as np
import pytest

from brickhub.virtual.virtual_transport import VirtualHub
from bricktwin.measure.hands import Deed, SimulatedPerson
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin.make_body import make_body
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics


@pytest.fixture
def body() -> MujocoBody:
    body = make_body(TWO_WHEELER, physics=Physics())
    assert isinstance(body, MujocoBody)
    return body


@pytest.fixture
def hub(body: MujocoBody) -> VirtualHub:
    return VirtualHub(body)


def seconds_until_done(hub: VirtualHub, person: SimulatedPerson, deed: Deed) -> float:
    """Time of a deed, looked at every 20 ms."""
    start_s = hub.now_s()
    person.begin(deed)
    while not person.is_done():
        assert hub.now_s() - start_s < 10.0
        hub.run_on_until(hub.machine.time_ms + 20)
    return hub.now_s() - start_s


@pytest.mark.parametrize("turn_deg", [90.0, -180.0, 360.0])
def test_turn_takes_the_time_of_a_hand(hub: VirtualHub, body: MujocoBody, turn_deg: float) -> None:
    exact = SimulatedPerson(hub, np.random.default_rng(0), error_deg=0.0, error_s=0.0)
    before_deg = body.pose().heading_deg
    took_s = seconds_until_done(hub, exact, Deed("turn it", turn_deg=turn_deg))
    assert took_s == pytest.approx(abs(turn_deg) / 120.0, abs=0.05)
    turned_deg = body.pose().heading_deg - before_deg - turn_deg
    assert (turned_deg + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=0.1)


def test_person_hesitates_and_errs_a_little(hub: VirtualHub, body: MujocoBody) -> None:
    person = SimulatedPerson(hub, np.random.default_rng(1), error_deg=3.0, error_s=2.0)
    before_deg = body.pose().heading_deg
    times_s = []
    for number in range(1, 6):
        times_s.append(seconds_until_done(hub, person, Deed("turn it", turn_deg=30.0)))
        off_deg = body.pose().heading_deg - before_deg - 30.0 * number
        assert abs((off_deg + 180.0) % 360.0 - 180.0) < 3.1, "errors do not add up"
    assert min(times_s) >= 0.25 and max(times_s) < 0.25 + 2.1
    assert max(times_s) - min(times_s) > 0.3


def test_person_who_has_nothing_to_turn_is_waited_for(hub: VirtualHub) -> None:
    """As long as it hesitates, though the robot is where it is to be."""
    person = SimulatedPerson(hub, np.random.default_rng(2), error_deg=0.0, error_s=2.0)
    hesitates_s = np.random.default_rng(2).uniform(0.0, 2.0, 2)[1]
    took_s = seconds_until_done(hub, person, Deed("wait"))
    assert took_s == pytest.approx(hesitates_s, abs=0.05) and took_s > 0.1


def test_lifted_robot_stays_in_the_hand_and_its_shaft_is_held(
    hub: VirtualHub, body: MujocoBody
) -> None:
    person = SimulatedPerson(hub, np.random.default_rng(0), error_s=0.0)
    angles = {}
    for holds in ("", "left"):
        seconds_until_done(hub, person, Deed("lift it", is_lifted=True, holds=holds))
        before = {motor.name: body.angle_mdeg(motor.port) for motor in TWO_WHEELER.motors}
        height_m = float(body.data.qpos[2])
        for motor in TWO_WHEELER.motors:
            body.set_voltage(motor.port, 4000)
        hub.run_on_until(hub.machine.time_ms + 500)
        for motor in TWO_WHEELER.motors:
            turned = abs(body.angle_mdeg(motor.port) - before[motor.name]) / 1000
            angles[holds, motor.name] = turned
            body.set_voltage(motor.port, None)
        assert float(body.data.qpos[2]) == pytest.approx(height_m, abs=0.01) and height_m > 0.2
    assert min(angles["", "left"], angles["", "right"], angles["left", "right"]) > 60
    assert angles["left", "left"] < 20, "is held"
