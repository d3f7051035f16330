"""Device ids of LEGO's motors and sensors, and their names.

Source: the firmware's list of devices (``lego_device_type_id_t``), Pybricks 4.
"""

from __future__ import annotations

import re

from brickhub.robot import Motor, MotorKind, PoweredUpSensor, Sensor, SensorKind

MOTOR_IDS = {
    MotorKind.INTERACTIVE: 38,
    MotorKind.TECHNIC_L: 46,
    MotorKind.TECHNIC_XL: 47,
    MotorKind.SPIKE_MEDIUM: 48,
    MotorKind.SPIKE_LARGE: 49,
    MotorKind.SPIKE_SMALL: 65,
    MotorKind.TECHNIC_M_ANGULAR: 75,
    MotorKind.TECHNIC_L_ANGULAR: 76,
}
SENSOR_IDS = {
    SensorKind.LIGHT: 8,
    SensorKind.TILT: 34,
    SensorKind.INFRARED: 35,
    SensorKind.COLOR_DISTANCE: 37,
    SensorKind.COLOR: 61,
    SensorKind.FORCE: 63,
    SensorKind.COLOR_LIGHT_MATRIX: 64,
}
ULTRASONIC_ID = 62
DC_MOTOR_ID = 1
NOTHING = 0
"""No device, or one that does not identify itself."""

_OTHER_NAMES = {
    DC_MOTOR_ID: "medium linear motor without angle",
    2: "train motor",
    ULTRASONIC_ID: "ultrasonic sensor",
    NOTHING: "nothing",
}
_NAMES = (
    {number: f"motor {kind.value}" for kind, number in MOTOR_IDS.items()}
    | {number: re.sub("(?<!^)([A-Z])", r" \1", kind.value).lower() for kind, number in SENSOR_IDS.items()}
    | _OTHER_NAMES
)


def device_id(device: Motor | Sensor) -> int:
    """Device id of a described device."""
    if isinstance(device, Motor):
        return MOTOR_IDS[device.kind]
    return SENSOR_IDS[device.kind] if isinstance(device, PoweredUpSensor) else ULTRASONIC_ID


def device_name(number: int) -> str:
    """Readable name of a device id."""
    return _NAMES.get(number, f"device {number}")


def have_encoders(*device_ids: int) -> bool:
    """True if all are motors with an encoder, so that a program for one also drives the others."""
    return set(device_ids) <= set(MOTOR_IDS.values())
