"""Robots of this package, each with its building plan."""

from dataclasses import replace

from brickhub.errors import UnknownNameError
from brickhub.robot import (
    BENCH,
    Direction,
    DriveBase,
    HubKind,
    KitKind,
    Motor,
    MotorKind,
    Mount,
    PoweredUpSensor,
    Robot,
    SensorKind,
    UltrasonicSensor,
)

__all__ = [
    "BENCH",
    "CART",
    "EV3_DRIVER",
    "ROBOTS",
    "ROBO_ARM",
    "SCOUT",
    "TWO_WHEELER",
    "WALKER",
    "get",
]

TWO_WHEELER = Robot(
    name="two-wheeler",
    hub=HubKind.PRIME,
    # The motors are mirrored: turned the same way, seen from outside, they would spin the robot.
    motors=(Motor("left", "E", direction=Direction.COUNTERCLOCKWISE), Motor("right", "A")),
    sensors=(UltrasonicSensor("eyes", "C"),),
    drive_base=DriveBase(
        "left",
        "right",
        wheel_diameter_mm=56,
        axle_track_mm=130,
    ),
    needs_imu=True,
    model="bricktwin.robots.plans:two_wheeler.ldr",
)
"""The 2Wheeler: two driven wheels, a ball caster, and an ultrasonic sensor facing forward."""

SCOUT = replace(
    TWO_WHEELER,
    name="scout",
    sensors=(
        *TWO_WHEELER.sensors,
        PoweredUpSensor(
            "light",
            "B",
            SensorKind.COLOR,
            Mount((56.0, 0.0, 18.0), "down"),
        ),
    ),
)
"""The scout: a 2Wheeler with a color sensor that faces the floor in front of its axle."""

CART = Robot(
    name="cart",
    hub=KitKind.DOUBLE_MOTOR,
    motors=(Motor("left", "A", direction=Direction.COUNTERCLOCKWISE), Motor("right", "B")),
    sensors=(
        PoweredUpSensor(
            "light",
            "C",
            SensorKind.COLOR,
            Mount((56.0, 0.0, 18.0), "down"),
        ),
    ),
    drive_base=DriveBase(
        "left",
        "right",
        wheel_diameter_mm=56,
        axle_track_mm=112,
    ),
    needs_imu=True,
)
"""The cart of LEGO's kits of 2026: wheels on a Double Motor, a ball caster, and a Color Sensor that
faces the floor in front of its axle. It has no building plan, as the parts of the kits are not in
LDraw's library yet: its sizes and masses are estimates."""

EV3_DRIVER = Robot(
    name="ev3-driver",
    hub=HubKind.EV3,
    # Their hubs show outwards on both sides, so both turn forwards when they count up.
    motors=(
        Motor("left", "B", MotorKind.EV3_LARGE),
        Motor("right", "C", MotorKind.EV3_LARGE),
    ),
    sensors=(
        PoweredUpSensor("eyes", "4", SensorKind.EV3_ULTRASONIC),
        PoweredUpSensor("light", "3", SensorKind.EV3_COLOR),
        PoweredUpSensor("gyro", "2", SensorKind.EV3_GYRO),
        PoweredUpSensor("touch", "1", SensorKind.EV3_TOUCH),
    ),
    drive_base=DriveBase(
        "left",
        "right",
        wheel_diameter_mm=56,
        axle_track_mm=120,
    ),
    model="bricktwin.robots.plans:ev3_driver.ldr",
)
"""The EV3 driver, of the Education set 45544: two large motors, a ball caster, an ultrasonic sensor
that looks ahead, a color sensor that faces the floor, a gyro sensor, and a touch sensor at its
front."""

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
    # The two sides of the body are alike, so what is learned on one holds on the other.
    mirrored=(("left_front", "right_front"), ("left_back", "right_back")),
)
"""The Walker: four legs on cranks, a motor for each, and an ultrasonic sensor facing forward."""

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
    model="bricktwin.robots.plans:robo_arm.ldr",
)
"""The RoboArm: a turntable, two joints and a gripper on a fixed base."""

ROBOTS = {
    robot.name: robot for robot in (TWO_WHEELER, SCOUT, CART, EV3_DRIVER, WALKER, ROBO_ARM, BENCH)
}


def get(name: str) -> Robot:
    """The robot of that name. Raises UnknownNameError if there is no such robot."""
    try:
        return ROBOTS[name]
    except KeyError:
        raise UnknownNameError(
            f"there is no robot '{name}'; choose one of {', '.join(sorted(ROBOTS))}"
        ) from None
