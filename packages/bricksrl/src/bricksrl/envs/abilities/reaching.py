"""Reaching of a drawn robot: its joints turn to angles that are drawn for each episode."""

from brickhub.hub.interface import Interface, MotorAngle, RunAngle, Wait
from brickhub.robot import Robot
from bricksrl.envs.task import SampledEntry, Task, Tensor
from bricksrl.envs.tasks.walker import shortest_angle_deg
from bricksrl.errors import DescriptionError
from bricktwin.plans.mechanism.motor_role import Role
from bricktwin.robots.as_drawn import DrawnRobot

_STEP_MS = 250
_STEPS = 50
_TURN_DEG = 30.0
"""Largest turn of a joint in a step."""
_SPEED_DEG_S = 250
_WITHIN_DEG = 5.0
"""Mean error of a joint at which the goal is reached."""
_UNIT_DEG = 100.0


def reach(drawn: DrawnRobot) -> Task:
    """Turn the joints to angles that are drawn at each start, as RoboArm-v0 does. Raises
    DescriptionError for a robot without joints."""
    joints = drawn.motors_with(Role.JOINT)
    names = [motor.name for motor in joints]
    # What turns all around may be a turntable, or gears that drive nothing: only beside a joint
    # with an end is it part of an arm.
    if not any(drawn.robot.motor(name).range_deg for name in names):
        raise DescriptionError("no motor turns a joint with an end")
    channels = [_angle(drawn.robot, name) for name in names]
    goals = tuple(
        SampledEntry(
            f"{channel.motor}_goal",
            channel.low,
            channel.high,
            "deg",
            wraps=channel.wraps,
        )
        for channel in channels
    )
    count = len(names)
    threshold_deg = _WITHIN_DEG * count

    def error_deg(observation: Tensor) -> Tensor:
        angles_deg = observation[..., :count]
        goals_deg = observation[..., count:]
        return shortest_angle_deg(angles_deg, goals_deg).sum(-1, keepdim=True)

    def is_reached(observation: Tensor) -> Tensor:
        return error_deg(observation) < threshold_deg

    return Task(
        id="Reach-v0",
        doc=f"{drawn.robot.name} turns its joints to the angles of a goal.",
        robot=drawn.robot,
        interface=Interface(
            tuple(RunAngle(name, -_TURN_DEG, _TURN_DEG, _SPEED_DEG_S) for name in names),
            tuple(channels),
            Wait(_STEP_MS),
        ),
        max_steps=_STEPS,
        reward=lambda previous, action, observation: -error_deg(observation) / _UNIT_DEG,
        success=lambda observations: is_reached(observations[..., -1, :])[..., 0],
        metrics=lambda observations: {"error_sum_deg": error_deg(observations[..., -1, :])[..., 0]},
        terminated=is_reached,
        sampled_entries=goals,
    )


def _angle(robot: Robot, name: str) -> MotorAngle:
    """The angle of a joint in its range, or all around."""
    low_deg, high_deg = robot.motor(name).range_deg or (0, 360)
    return MotorAngle(name, float(low_deg), float(high_deg))
