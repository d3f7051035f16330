"""Kinds of hubs, motors and sensors: what their numbers have to be together."""

from __future__ import annotations

import pytest

from brickhub.robot import HubKind, MotorKind, SensorKind

# Numbers by which devices introduce themselves, as LEGO's description of its wireless protocol
# lists them ("IO type ID"), and Pybricks its `PBDRV_LEGODEV_TYPE_ID`.
PUBLISHED = {
    MotorKind.MEDIUM_LINEAR: 0x01,
    MotorKind.TRAIN: 0x02,
    MotorKind.INTERACTIVE: 0x26,
    MotorKind.MOVE_HUB: 0x27,
    MotorKind.TECHNIC_L: 0x2E,
    MotorKind.TECHNIC_XL: 0x2F,
    MotorKind.SPIKE_MEDIUM: 0x30,
    MotorKind.SPIKE_LARGE: 0x31,
    MotorKind.SPIKE_SMALL: 0x41,
    MotorKind.TECHNIC_M_ANGULAR: 0x4B,
    MotorKind.TECHNIC_L_ANGULAR: 0x4C,
}


@pytest.mark.parametrize(("kind", "number"), PUBLISHED.items(), ids=str)
def test_devices_introduce_themselves_by_published_numbers(kind: MotorKind, number: int) -> None:
    assert kind.model.device_id == number


def test_no_two_devices_of_a_family_have_one_number() -> None:
    kinds = [*MotorKind, *SensorKind]
    # An EV3 Brick takes a motor of the NXT for its own large one.
    plain = [kind.model for kind in kinds if kind is not MotorKind.NXT]
    numbers = [(model.module, model.device_id) for model in plain]
    assert len(set(numbers)) == len(numbers)


@pytest.mark.parametrize("hub", HubKind)
def test_ports_of_a_hub_are_for_motors_or_sensors(hub: HubKind) -> None:
    model = hub.model
    assert model.motor_ports and set(model.sensor_ports) <= set(model.ports)
    assert not set(model.motor_ports) & set(model.sensor_ports)
    usual = MotorKind(model.usual_motor).model
    assert model.takes(usual) == model.motor_ports
    strange = MotorKind.SPIKE_LARGE if usual.module == "ev3devices" else MotorKind.EV3_LARGE
    assert model.takes(strange.model) == "", "has another plug"
