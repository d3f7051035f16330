"""Robots and tasks of the paper as bare descriptions, without bodies: what runs on a hub."""

from __future__ import annotations

from brickhub.hub.interface import (
    Distance,
    DriveStraight,
    Interface,
    MotorAngle,
    Pitch,
    Roll,
    RunAngle,
    UntilDone,
    Wait,
    YawRate,
)
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
        Motor(
            "low",
            "D",
            range_deg=(10, 70),
            speed_limit_deg_s=500,
            acceleration_deg_s2=1000,
            torque_limit_mnm=900,
        ),
        Motor("high", "A", range_deg=(-150, 10)),
        Motor("grab", "E", range_deg=(-148, -45)),
    ),
    needs_imu=False,
)

RUN_AWAY = Interface(
    commands=(DriveStraight(-100, 100),),
    channels=(MotorAngle("left"), MotorAngle("right"), Pitch(), Roll(), Distance("eyes")),
    settle=UntilDone(),
)
SPINNING = Interface(
    commands=(RunAngle("left", -100, 100, 400), RunAngle("right", -100, 100, 400)),
    channels=(MotorAngle("left"), MotorAngle("right"), Pitch(), Roll(), YawRate()),
    settle=Wait(100),
)
LEGS = ("left_front", "right_front", "left_back", "right_back")
WALKING = Interface(
    commands=tuple(RunAngle(leg, -100, 0, 600) for leg in LEGS),
    channels=(*(MotorAngle(leg) for leg in LEGS), Pitch(), Roll(), Distance("eyes")),
    settle=Wait(250),
)
REACHING = Interface(
    commands=(
        RunAngle("rotation", -100, 100, 250),
        RunAngle("low", -30, 30, 250),
        RunAngle("high", -60, 60, 250),
        RunAngle("grab", -25, 25, 250),
    ),
    channels=(
        MotorAngle("rotation"),
        MotorAngle("low", 10, 70),
        MotorAngle("high", -150, 10),
        MotorAngle("grab", -148, -45),
    ),
    settle=Wait(250),
)
REACHING_BY_SIGHT = Interface(
    commands=(RunAngle("rotation", -90, 90, 250), *REACHING.commands[1:3]),
    channels=REACHING.channels[:3],
    settle=Wait(250),
)
TASKS = {
    "RoboArm-v0": (ROBO_ARM, REACHING),
    "RoboArm_mixed-v0": (ROBO_ARM, REACHING_BY_SIGHT),
    "RunAway-v0": (TWO_WHEELER, RUN_AWAY),
    "Spinning-v0": (TWO_WHEELER, SPINNING),
    "Walker-v0": (WALKER, WALKING),
    "Walker-v1": (WALKER, WALKING),
}
"""Robot and interface of environments, by id."""
