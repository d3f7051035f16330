"""Robots of the paper as bare descriptions, without bodies."""

from __future__ import annotations

from brickhub.robot import Direction, DriveBase, HubKind, Motor, Robot, UltrasonicSensor

TWO_WHEELER = Robot(
    name="two-wheeler",
    hub=HubKind.PRIME,
    motors=(Motor("left", "E", direction=Direction.COUNTERCLOCKWISE), Motor("right", "A")),
    sensors=(UltrasonicSensor("eyes", "C"),),
    drive_base=DriveBase("left", "right", wheel_diameter_mm=56, axle_track_mm=130),
    needs_imu=True,
)
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
)
ROBO_ARM = Robot(
    name="robo-arm",
    hub=HubKind.PRIME,
    motors=(
        Motor("rotation", "B", gears=(20, 60)),
        Motor("low", "D", range_deg=(10, 70), speed_limit_deg_s=500, acceleration_deg_s2=1000, torque_limit_mnm=900),
        Motor("high", "A", range_deg=(-150, 10)),
        Motor("grab", "E", range_deg=(-148, -45)),
    ),
    needs_imu=False,
)
