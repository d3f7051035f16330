"""Conventions between a model and the body that stands on it: the timestep, the groups of
geometries, and names.

Names define the wiring: the joint and actuator ``motor_E`` belong to port E, the site
``ultrasonic_C`` to port C. In an arena several robots share one model, and the names of each begin
with a prefix, ``"ROBOT/"``.
"""

from brickhub.robot import Sensor

TIMESTEP_S = 0.0025
"""Time of a physics step; it divides the hub's control loop of 5 ms."""
OBSTACLE_GROUP = 0
"""Group of the geometries that ultrasound detects."""
FLOOR_GROUP = 1
LOOKS_GROUP = 2
"""Group of what is drawn only."""
SHAPE_GROUP = 3
"""Group of the robot's shapes that collide."""
FOOT = "foot_"
"""First letters of the names of the geometries that a robot may stand on."""
BACKLASH = "backlash_"
"""First letters of the name of a joint between a motor's shaft and what it drives."""
SPINNER = "spin_"
"""First letters of the names of shafts and gears, which turn visually only: they are found by
these, as a compiled model keeps nothing else of what they are."""
SPINNER_USER = 4
"""Numbers of a shaft's or gear's user data: ratio and axis [3]."""
ROD = "rod_"
"""First letters of the names of rods, which turn visually only."""


def motor_name(port: str) -> str:
    """Name of a motor's joint and of its actuator."""
    return f"motor_{port}"


def site_name(sensor: Sensor) -> str:
    """Name of a sensor's site."""
    kind = "sensor" if sensor.kind.model.range_mm is None else "ultrasonic"
    return f"{kind}_{sensor.port}"


def object_name(number: int) -> str:
    """Name of the geometry of a scene's solid, and of the joint of one that can be pushed."""
    return f"object_{number}"
