"""The Walker: four legs on cranks, a motor for each, and an ultrasonic sensor facing forward."""

from __future__ import annotations

from brickhub.robot import Direction, HubKind, Motor, Robot, UltrasonicSensor

WALKER = Robot(
    name="walker",
    hub=HubKind.PRIME,
    motors=(
        Motor("left_front", "D", direction=Direction.COUNTERCLOCKWISE),
        Motor("right_front", "C"),
        Motor("left_back", "B", direction=Direction.COUNTERCLOCKWISE),
        Motor("right_back", "A"),
    ),
    sensors=(UltrasonicSensor("eyes", "E"),),
    needs_imu=True,
    model="bricktwin.robots.plans:walker.ldr",
)
