"""A robot of my own, and a first task for it: a motor turns a disc under a colour sensor and looks
for white.

bricksrl check my_file.py                   # does everything fit?
bricksrl train my_file.py --episodes 30     # learn it on a virtual robot
bricksrl hub check my_file.py --hub ble     # is the real one built and wired like that?
"""

from __future__ import annotations

from collections.abc import Mapping

from torch import Tensor

from bricksrl.envs import Task
from bricksrl.hub.interface import Interface, MotorAngle, RunAngle, SensorReading, Wait
from bricksrl.robots import HubKind, Motor, MotorKind, PoweredUpSensor, Robot, SensorKind
from bricksrl.twin.scene import Scene

# The robot: its hub, and what is plugged into which port. Motors turn on the bench, without load,
# when they are virtual.
ROBOT = Robot(
    "my-robot",
    HubKind.TECHNIC,  # or PRIME, ESSENTIAL, CITY
    motors=(Motor("disc", port="A", kind=MotorKind.TECHNIC_L, gears=(12, 36)),),
    sensors=(PoweredUpSensor("light", port="B", kind=SensorKind.COLOR),),
)


# What the sensors of the virtual robot measure, from the angles of its motors in degrees: a quarter
# of the disc is white.
def reflection_pct(angles: Mapping[str, float]) -> float:
    """Light that the disc reflects."""
    return 90.0 if 135 < angles["disc"] % 360 < 225 else 10.0


def white_pct(observation: Tensor) -> Tensor:
    """The second channel of the observation: the sensor's reading."""
    return observation[..., 1:2]


def reward(previous: Tensor, action: Tensor, observation: Tensor) -> Tensor:
    """Higher the more white the sensor sees."""
    return white_pct(observation) / 100.0


def success(observations: Tensor) -> Tensor:
    """White at the end of the episode."""
    return white_pct(observations)[..., -1, 0] > 50.0


def metrics(observations: Tensor) -> dict[str, Tensor]:
    """The mean over the episode."""
    return {"mean_reflection_pct": white_pct(observations).mean((-2, -1))}


TASK = Task(
    id="MyTask-v0",
    doc="A disc turns until the sensor sees white.",
    robot=ROBOT,
    interface=Interface(
        commands=(RunAngle("disc", low=-90, high=90, speed_deg_s=500),),
        channels=(
            MotorAngle("disc"),
            SensorReading("light", "reflection", low=0, high=100, unit="%"),
        ),
        settle=Wait(200),  # a step lasts 200 ms
    ),
    max_steps=20,
    reward=reward,
    success=success,
    metrics=metrics,
    scene=Scene(readings={"light": reflection_pct}),
)
