"""Driving of a drawn robot: our tasks of driving robots, with its own motors and sensors."""

import math
from collections.abc import Mapping
from dataclasses import replace

from brickhub.hub.interface import (
    Channel,
    Command,
    Distance,
    DriveSpeed,
    Interface,
    MotorAngle,
    RunAngle,
    UntilDone,
    Wait,
)
from brickhub.robot import DriveBase, Sense
from brickhub.robot.line_edge import edge_of
from bricksrl.envs.task import Task, Tensor
from bricksrl.envs.tasks.line_follow import LINE_FOLLOW, as_seen_by
from bricksrl.envs.tasks.on_robots import gyroscope_of, interface_on
from bricksrl.envs.tasks.park import PARK
from bricksrl.envs.tasks.run_away import RUN_AWAY, metrics_without_tilt
from bricksrl.envs.tasks.spinning import SPINNING
from bricksrl.errors import DescriptionError, counted
from bricktwin.plans.mechanism.motor_role import Role
from bricktwin.plans.planned_robot import planned_robot
from bricktwin.robots.as_drawn import DrawnRobot
from bricktwin.twin.models.balance import lean_on_one_axle_deg
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.objects import Line
from bricktwin.twin.physics import Physics
from bricktwin.twin.scene import OPEN_FLOOR, Scene
from bricktwin.twin.senses import spot_mm

_LENGTH_MM = 100.0
"""Longest way of a step of a robot that drives without a drive base, as that of RunAway-v0."""
_TURNS_DEG_S = 500
_SEES_FLOOR_MM = 24.0
"""Height of a color sensor up to which LEGO's tell a line from the floor."""
_NEAR_MM = 8.0
"""Nearer to the axle, not even the slowest robot finds back to the edge before it has left it."""
_SWING_DEG = 3.0
"""Turn that the lag and the play of motors make a robot swing by: one that such a turn takes off
the edge loses it again and again."""
_START_MM = (5.0, 2.0)
"""The sensor starts at the line's edge: so far off at most, along and across it."""
_STOP_STEPS = 40
_GAP_MM = 150.0
"""Where a robot is to stop before a wall."""
_THIRD_MM = 200.0
"""So far off, the reward is a third of the best."""
_TOO_NEAR = 3.0
"""How much worse too near is than too far."""
_CLOSE_MM = 50.0
"""Farthest from its place that a robot has stopped well."""


def drive_away(drawn: DrawnRobot) -> Task:
    """Drive away from a wall that its distance sensor sees, as in RunAway-v0. Raises
    DescriptionError if no motor turns a wheel or no sensor looks ahead."""
    eyes = _eyes(drawn)
    wheels = drawn.motors_with(Role.WHEEL)
    if not wheels:
        raise DescriptionError("no motor turns a wheel")
    _check_stands(drawn)
    if drawn.robot.drive_base is not None:
        names = {**_base_names(drawn.robot.drive_base), "eyes": eyes}
        interface = interface_on(RUN_AWAY.interface, drawn.robot, names)
    else:
        commands: list[Command] = []
        for wheel in wheels:
            turn_deg = 360.0 * _LENGTH_MM / (math.pi * wheel.facts.wheel_mm)
            # A motor without gears of its own may turn a wheel through a differential.
            if wheel.facts.ratio and not wheel.facts.gears:
                turn_deg /= wheel.facts.ratio
            commands.append(RunAngle(wheel.name, -turn_deg, turn_deg, speed_deg_s=_TURNS_DEG_S))
        channels: list[Channel] = [MotorAngle(wheel.name) for wheel in wheels]
        channels.append(Distance(eyes))
        bare = Interface(tuple(commands), tuple(channels), UntilDone())
        interface = interface_on(bare, drawn.robot)
    return replace(
        RUN_AWAY,
        id="Away-v0",
        doc=f"{drawn.robot.name} drives away from a wall: 1 for each step farther from it.",
        robot=drawn.robot,
        interface=interface,
        metrics=metrics_without_tilt,
    )


def spin(drawn: DrawnRobot) -> Task:
    """Spin on the spot, to the left or to the right, as in Spinning-v0. Raises DescriptionError
    without a drive base, or if nothing measures its turns."""
    base = _base(drawn)
    if not drawn.robot.needs_imu and not gyroscope_of(drawn.robot):
        has_imu = drawn.robot.hub.model.has_imu
        remedy = "put the hub in straight" if has_imu else "add a gyro sensor"
        raise DescriptionError(f"nothing measures its turns; {remedy}")
    return replace(
        SPINNING,
        id="Spin-v0",
        doc=f"{drawn.robot.name} spins to the side that it is told: the yaw rate there, in deg/s.",
        robot=drawn.robot,
        interface=interface_on(SPINNING.interface, drawn.robot, _base_names(base)),
    )


def follow_line(drawn: DrawnRobot) -> Task:
    """Follow the left edge of a black line, as in LineFollow-v0. Raises DescriptionError without a
    drive base or a color sensor that looks down, or if that sees no line from its height."""
    _base(drawn)
    light = drawn.sensor_looking(Sense.SURFACE, "down")
    if light is None:
        raise DescriptionError("no color sensor looks down at a line")
    ahead_mm, left_mm, above_mm = _place_mm(drawn, light)
    if above_mm > _SEES_FLOOR_MM:
        raise DescriptionError(
            f"its color sensor '{light}' is {above_mm:.0f} mm above the floor, too high to see a "
            f"line; let it look from {_SEES_FLOOR_MM:.0f} mm or less"
        )
    interface = interface_on(LINE_FOLLOW.interface, drawn.robot, {"light": light})
    objects = LINE_FOLLOW.scene.objects
    is_backwards = ahead_mm < 0.0
    # A turn towards the line takes a sensor that goes behind the wheels away from it. It goes ahead
    # of them where the robot drives backwards.
    if is_backwards:
        speed, turn = interface.commands
        assert isinstance(speed, DriveSpeed)  # noqa: S101
        interface = replace(interface, commands=(DriveSpeed(-speed.high, -speed.low), turn))
        objects = tuple(_turned_round(line) for line in objects if isinstance(line, Line))
    along_mm, across_mm = _START_MM
    scene = replace(
        LINE_FOLLOW.scene,
        start_mm=(
            (-ahead_mm - along_mm, -ahead_mm + along_mm),
            (-left_mm - across_mm, -left_mm + across_mm),
        ),
        objects=objects,
    )
    how = ", backwards" if is_backwards else ""
    return replace(
        as_seen_by(LINE_FOLLOW, edge_of(drawn.robot, light), is_backwards=is_backwards),
        id="Line-v0",
        doc=f"{drawn.robot.name} follows the left edge of a black line, clockwise{how}.",
        robot=drawn.robot,
        interface=interface,
        scene=scene,
        # A trial is a whole episode: the next one begins at the line again.
        settings={
            "structure": "edge",
            "trial_steps": LINE_FOLLOW.max_steps,
            "settle_steps": 0,
        },
    )


def _turned_round(line: Line) -> Line:
    """A line half a turn about the origin."""
    return replace(line, points_mm=tuple((-x_mm, -y_mm) for x_mm, y_mm in line.points_mm))


def remark_on_line(drawn: DrawnRobot) -> str:
    """What the place of the color sensor of a robot that can follow a line makes of that, in a
    clause; "" for nothing."""
    light = drawn.sensor_looking(Sense.SURFACE, "down")
    if light is None:
        return ""
    ahead_mm, _, above_mm = _place_mm(drawn, light)
    where = "behind" if ahead_mm < 0.0 else "ahead of"
    place = f"its color sensor is {abs(ahead_mm):.0f} mm {where} its wheels"
    if abs(ahead_mm) < _NEAR_MM:
        return f"hard, as {place}, where turns hardly move it; put it 20 to 100 mm ahead of them"
    farthest_mm = spot_mm(above_mm) / math.tan(math.radians(_SWING_DEG))
    if abs(ahead_mm) > farthest_mm:
        return (
            f"hard, as {place} and {above_mm:.0f} mm above the floor, where small turns take it "
            f"off the edge; put it at most {farthest_mm:.0f} mm ahead of them, or higher"
        )
    if ahead_mm < 0.0:
        return f"backwards, as {place}; put it ahead of them to see it drive forwards"
    return ""


def _place_mm(drawn: DrawnRobot, sensor: str) -> tuple[float, float, float]:
    """Where a sensor's eye is: ahead of the wheels, to the left of their middle, above the
    floor."""
    # A body that was just made stands at the origin.
    return MujocoBody(drawn.robot, OPEN_FLOOR, Physics(), 0).sensor_place_mm(sensor)


def park(drawn: DrawnRobot) -> Task:
    """Drive into a bay and stand still there, as in Park-v0. Raises DescriptionError without a
    drive base."""
    base = _base(drawn)
    return replace(
        PARK,
        doc=f"{drawn.robot.name} drives into a bay and stands still there.",
        id="Parking-v0",
        robot=drawn.robot,
        interface=interface_on(PARK.interface, drawn.robot, _base_names(base)),
    )


def stop_before_wall(drawn: DrawnRobot) -> Task:
    """Drive up to a wall, and stop 150 mm before it. Raises DescriptionError without a drive base
    or a sensor that looks ahead."""
    _base(drawn)
    eyes = _eyes(drawn)
    return Task(
        id="Stop-v0",
        doc=f"{drawn.robot.name} drives up to a wall, and stops {_GAP_MM:.0f} mm before it.",
        robot=drawn.robot,
        interface=Interface(
            (DriveSpeed(-300, 300),),
            (Distance(eyes, 0.0, 1000.0),),
            Wait(100),
        ),
        max_steps=_STOP_STEPS,
        reward=_nearness,
        success=lambda observations: (_off_mm(observations[..., -1, :]).abs() < _CLOSE_MM)[..., 0],
        metrics=lambda observations: {"final_off_mm": _off_mm(observations[..., -1, :])[..., 0]},
        # A trial is a whole approach.
        settings={"structure": "approach", "trial_steps": _STOP_STEPS, "settle_steps": 0},
        scene=Scene(wall_distance_mm=(500.0, 700.0), heading_deg=(-5.0, 5.0)),
    )


def _off_mm(observation: Tensor) -> Tensor:
    """How much farther from the wall a robot is than where it is to stop."""
    return observation[..., :1] - _GAP_MM


def _nearness(
    _previous: Tensor,
    _action: Tensor,
    observation: Tensor,
) -> Tensor:
    """Nearness to the place before the wall, at most 1; ``[*batch, 1]``."""
    off_mm = _off_mm(observation)
    # Who is too near may have hit the wall.
    cost_mm = off_mm.where(off_mm > 0, -_TOO_NEAR * off_mm)
    return (-cost_mm / _THIRD_MM).exp()


def _base(drawn: DrawnRobot) -> DriveBase:
    """The robot's drive base. Raises DescriptionError if it has none, or stands on it alone."""
    base = drawn.robot.drive_base
    if base is not None:
        _check_stands(drawn)
        return base
    count = len(drawn.motors_with(Role.WHEEL))
    if not count:
        raise DescriptionError("no motor turns a wheel")
    if count == 2:
        raise DescriptionError("its two driven wheels are not alike on both sides of one axle")
    raise DescriptionError(
        f"it has {counted(count, 'driven wheel')}, but needs one on the left and one on the right"
    )


def _check_stands(drawn: DrawnRobot) -> None:
    """Raise DescriptionError for a robot that stands on one axle alone."""
    if lean_on_one_axle_deg(planned_robot(drawn.path)) is not None:
        raise DescriptionError("it stands on one axle alone; add a caster")


def _eyes(drawn: DrawnRobot) -> str:
    """The robot's distance sensor. Raises DescriptionError if none looks ahead."""
    eyes = drawn.sensor_looking(Sense.DISTANCE, "ahead")
    if eyes is None:
        raise DescriptionError("no distance sensor looks ahead")
    return eyes


def _base_names(base: DriveBase) -> Mapping[str, str]:
    """Names of the motors of a drive base, by those in our tasks."""
    return {"left": base.left, "right": base.right}
