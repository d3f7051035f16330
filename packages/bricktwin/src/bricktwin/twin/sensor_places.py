"""Places of a robot's sensors, as it stands on the floor."""

from brickhub.errors import TwinError
from brickhub.robot import Robot
from bricktwin.twin.engines.conventions import site_name
from bricktwin.twin.make_body import make_body
from bricktwin.twin.mujoco_body import MujocoBody


def sensor_place_mm(robot: Robot, name: str) -> tuple[float, float, float]:
    """Where a sensor's eye is: ahead of the robot's origin, to the left of it, and above the floor.
    Raises TwinError if the robot has no body, PlanError if its plan cannot be read."""
    body = make_body(robot)
    if not isinstance(body, MujocoBody):
        raise TwinError(f"'{robot.name}' has no body that its sensors are on; give it a model")
    site = body.model.site(site_name(robot.sensor(name))).id
    x_m, y_m, z_m = (float(value) for value in body.data.site_xpos[site])
    return 1000 * x_m, 1000 * y_m, 1000 * z_m
