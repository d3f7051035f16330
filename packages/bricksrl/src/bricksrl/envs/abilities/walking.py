"""Walking of a drawn robot, and driving ahead: whatever turns endlessly and reaches the floor moves
it."""

from collections.abc import Sequence
from functools import partial

from brickhub.entry import Entry
from brickhub.hub.interface import Channel, Interface, MotorAngle, Pitch, Roll, RunAngle, Wait
from bricksrl.envs.task import Task, Tensor
from bricksrl.errors import DescriptionError
from bricktwin.plans.mechanism.motor_role import Role
from bricktwin.robots.as_drawn import DrawnRobot

_STEP_MS = 250
_STEPS = 100
_TURN_DEG = 100.0
"""Largest turn of a leg in a step, which a loaded motor takes about that long for."""
_SPEED_DEG_S = 600
_UNIT_MM = 20.0
"""Distance with reward 1."""
_SUCCESS_MM_S = 30.0
_FALLEN_DEG = 60.0
"""A robot that is tilted further has fallen over."""
_FORWARD = Entry(
    "forward",
    -100.0,
    100.0,
    "mm",
    limits=(-32767.0, 32767.0),
)


def walk(drawn: DrawnRobot) -> Task:
    """Walk forward: only progress is rewarded. Raises DescriptionError for a robot without legs."""
    legs = [motor.name for motor in drawn.motors_with(Role.LEG)]
    if not legs:
        has_wheels = drawn.motors_with(Role.WHEEL)
        why = "it drives on wheels" if has_wheels else "no motor turns what reaches the floor"
        raise DescriptionError(why)
    doc = f"{drawn.robot.name} walks forward: the reward is the distance in units of 20 mm."
    return _forward_task("Walk-v0", doc, drawn, legs)


def drive_ahead(drawn: DrawnRobot) -> Task:
    """Drive ahead with wheels that are no drive base, such as four, or those of a car. Raises
    DescriptionError for a robot without such wheels."""
    wheels = [motor.name for motor in drawn.motors_with(Role.WHEEL)]
    if not wheels:
        raise DescriptionError("no motor turns a wheel")
    if drawn.robot.drive_base is not None:
        raise DescriptionError("its drive base does that without learning")
    doc = f"{drawn.robot.name} drives ahead: the reward is the distance in units of 20 mm."
    return _forward_task("Ahead-v0", doc, drawn, wheels)


def _forward_task(
    env_id: str,
    doc: str,
    drawn: DrawnRobot,
    legs: Sequence[str],
) -> Task:
    """The task of some motors that move the robot forward."""
    robot = drawn.robot
    channels: list[Channel] = [MotorAngle(leg) for leg in legs]
    tilts = slice(len(legs), len(legs))
    if robot.needs_imu:
        channels += [Pitch(), Roll()]
        tilts = slice(len(legs), len(legs) + 2)
    commands = [RunAngle(leg, -_TURN_DEG, _TURN_DEG, speed_deg_s=_SPEED_DEG_S) for leg in legs]
    has_fallen = partial(_has_fallen, tilts=tilts)

    def success(observations: Tensor) -> Tensor:
        least_mm = _SUCCESS_MM_S * _STEP_MS / 1000
        falls = has_fallen(observations)[..., 0].any(-1)
        return (_forward_mm(observations)[..., 0].mean(-1) >= least_mm) & ~falls

    paired = {name for pair in robot.mirrored for name in pair}
    return Task(
        id=env_id,
        doc=doc,
        robot=robot,
        interface=Interface(tuple(commands), tuple(channels), Wait(_STEP_MS)),
        max_steps=_STEPS,
        reward=lambda previous, action, observation: _forward_mm(observation) / _UNIT_MM,
        success=success,
        metrics=lambda observations: {"mean_step_mm": _forward_mm(observations).mean((-2, -1))},
        terminated=has_fallen,
        measured_entries=(_FORWARD,),
        walks=True,
        # A leg in the middle has no mirror image.
        symmetric=paired >= set(legs),
    )


def _forward_mm(observation: Tensor) -> Tensor:
    """The distance forward of a step, the last number of its observation."""
    return observation[..., -1:]


def _has_fallen(observation: Tensor, tilts: slice) -> Tensor:
    """Whether pitch or roll, where there are such, are beyond what a standing robot has."""
    return (observation[..., tilts].abs() > _FALLEN_DEG).any(-1, keepdim=True)
