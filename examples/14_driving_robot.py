"""Your own driving robot: a Technic hub with two large motors and a color sensor learns to stop on
a grey stripe.

bricksrl check examples/14_driving_robot.py
bricksrl train examples/14_driving_robot.py --episodes 15

Because it has a drive base, its virtual body follows from these numbers. It drives on a floor, and
its sensor sees the floor.
"""

from bricksrl.envs import Task
from bricksrl.hub.interface import DriveStraight, Interface, SensorReading, UntilDone
from bricksrl.robots import (
    Direction,
    DriveBase,
    HubKind,
    Motor,
    MotorKind,
    Mount,
    PoweredUpSensor,
    Robot,
    SensorKind,
)
from bricksrl.twin.objects import Field
from bricksrl.twin.scene import Scene

left = Motor("left", "A", MotorKind.TECHNIC_L_ANGULAR, Direction.COUNTERCLOCKWISE)
right = Motor("right", "B", MotorKind.TECHNIC_L_ANGULAR)
light = PoweredUpSensor("light", "C", SensorKind.COLOR, Mount(at_mm=(60, 0, 12), looks="down"))
base = DriveBase("left", "right", wheel_diameter_mm=62.4, axle_track_mm=128)
ROVER = Robot("rover", HubKind.TECHNIC, motors=(left, right), sensors=(light,), drive_base=base)
FLOOR = (Field((300, 0), (400, 400), "black"), Field((100, 0), (60, 400), "grey"))

STOP = Task(
    id="StopOnGrey-v0",
    doc="A robot drives ahead and back until its color sensor is over the grey stripe.",
    robot=ROVER,
    interface=Interface(
        (DriveStraight(-80, 80),), (SensorReading("light", "reflection", 0, 100, "%"),), UntilDone()
    ),
    scene=Scene(objects=FLOOR, start_mm=((-150, 250), (0, 0))),
    max_steps=15,
    reward=lambda previous, action, observation: -(observation - 40.0).abs() / 40.0,
    success=lambda observations: (observations[..., -1, 0] - 40.0).abs() < 15.0,
    metrics=lambda observations: {"final_off_pct": (observations[..., -1, 0] - 40.0).abs()},
)
