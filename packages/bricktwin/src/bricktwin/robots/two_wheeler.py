"""The 2Wheeler: two driven wheels, a ball caster, and an ultrasonic sensor facing forward."""

from __future__ import annotations

from brickhub.robot import Direction, DriveBase, HubKind, Motor, Robot, UltrasonicSensor

TWO_WHEELER = Robot(
    name="two-wheeler",
    hub=HubKind.PRIME,
    motors=(Motor("left", "E", direction=Direction.COUNTERCLOCKWISE), Motor("right", "A")),
    sensors=(UltrasonicSensor("eyes", "C"),),
    drive_base=DriveBase("left", "right", wheel_diameter_mm=56, axle_track_mm=130),
    needs_imu=True,
    model="bricktwin.robots.plans:two_wheeler.ldr",
)
