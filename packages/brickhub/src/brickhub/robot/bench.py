"""Bench: a bare Prime hub with an unloaded medium motor on every port."""

from __future__ import annotations

from brickhub.robot.hardware import HubKind
from brickhub.robot.spec import Motor, Robot

BENCH = Robot(
    name="bench",
    hub=HubKind.PRIME,
    motors=tuple(Motor(f"motor_{port.lower()}", port) for port in HubKind.PRIME.model.ports),
    needs_imu=True,
)
