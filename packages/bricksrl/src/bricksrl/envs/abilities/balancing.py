"""Balance of a drawn robot on two wheels, which it keeps by what it learns."""

from brickhub.hub.interface import (
    Interface,
    Pitch,
    PitchRate,
    RunDuty,
    Wait,
    WheelsAngle,
    WheelsSpeed,
)
from bricksrl.envs.task import Task, Tensor
from bricksrl.errors import DescriptionError
from bricktwin.plans.planned_robot import planned_robot
from bricktwin.robots.as_drawn import DrawnRobot
from bricktwin.twin.models.balance import MOST_LEAN_DEG, lean_on_one_axle_deg
from bricktwin.twin.scene import Scene

_STEP_MS = 20
"""A robot of LEGO's height falls twice as far in 70 ms."""
_STEPS = 250
_FALLEN_DEG = 35.0
"""The hub ends a trial there, too."""
_HELD_DEG = 1.0
"""A hand that feels the balance holds it so well."""
_FAR_DEG = 360.0
"""A turn of the wheels away, the half of the reward that is for staying is a third of its best."""


def keep_upright(drawn: DrawnRobot) -> Task:
    """Keep upright on two wheels, and stay there. Raises DescriptionError without a drive base, for
    a robot that stands by itself, or whose hub does not measure how it leans."""
    base = drawn.robot.drive_base
    if base is None:
        raise DescriptionError("it has no two driven wheels on one axle")
    lean_deg = lean_on_one_axle_deg(planned_robot(drawn.path))
    if lean_deg is None:
        raise DescriptionError("it stands by itself")
    if abs(lean_deg) > MOST_LEAN_DEG:
        side = "in front of" if lean_deg < 0 else "behind"
        raise DescriptionError(
            f"its centre of mass is too far {side} its axle: it is in balance at "
            f"{abs(lean_deg):.0f} degrees; move the hub until it is above the wheels"
        )
    if not drawn.robot.needs_imu:
        has_imu = drawn.robot.hub.model.has_imu
        remedy = "put the hub in straight" if has_imu else "take a hub that has one"
        raise DescriptionError(f"no gyroscope measures how it leans; {remedy}")
    return Task(
        id="Upright-v0",
        doc=f"{drawn.robot.name} keeps upright on its two wheels, and stays where it is.",
        robot=drawn.robot,
        interface=Interface(
            (RunDuty(base.left), RunDuty(base.right)),
            (
                Pitch(),
                PitchRate(),
                WheelsAngle(base.left, base.right),
                WheelsSpeed(base.left, base.right),
            ),
            Wait(_STEP_MS),
        ),
        max_steps=_STEPS,
        reward=_nearness,
        success=lambda observations: ~_has_fallen(observations)[..., 0].any(-1),
        metrics=lambda observations: {
            "upright_s": (~_has_fallen(observations)[..., 0]).sum(-1) * _STEP_MS / 1000
        },
        terminated=_has_fallen,
        # A trial is a whole episode: who has fallen has to be put up.
        settings={
            "structure": "upright",
            "trial_steps": _STEPS,
            "settle_steps": 0,
            "falls_late": True,
            "tilt_deg": _FALLEN_DEG,
        },
        scene=Scene(held_deg=(lean_deg - _HELD_DEG, lean_deg + _HELD_DEG)),
    )


def _nearness(
    _previous: Tensor,
    _action: Tensor,
    observation: Tensor,
) -> Tensor:
    """Half for being upright, and half for nearness to where the robot began; ``[*batch, 1]``."""
    near = (-observation[..., 2:3].abs() / _FAR_DEG).exp()
    return (1.0 + near) / 2.0


def _has_fallen(observation: Tensor) -> Tensor:
    """Whether the robot leans farther than it can come back from."""
    return observation[..., :1].abs() > _FALLEN_DEG
