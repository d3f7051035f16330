"""A task of my own: the 2Wheeler stops 400 mm before a wall.

bricksrl check my_file.py                   # does everything fit?
bricksrl train my_file.py --episodes 30     # learn it on a virtual robot
bricksrl train my_file.py --hub ble         # learn it on the real one
"""

from __future__ import annotations

from torch import Tensor

from bricksrl.envs import Task
from bricksrl.hub.interface import Distance, DriveStraight, Interface, UntilDone
from bricksrl.robots import TWO_WHEELER
from bricksrl.twin.scene import Scene

# The robot: TWO_WHEELER, WALKER or ROBO_ARM of bricksrl.robots, or one of your own (`bricksrl new
# robot`).
ROBOT = TWO_WHEELER

# What the agent may do and what it sees. An action is a number in -1..1 for each command, here from
# -100 to 100 mm. Other commands are RunAngle (turn a motor) and Turn; other channels MotorAngle,
# Pitch, Roll and SensorReading.
INTERFACE = Interface(
    commands=(DriveStraight(low=-100, high=100),),
    channels=(Distance("eyes"),),
    settle=UntilDone(),  # a step lasts until the robot has arrived; Wait(250) for one of 250 ms
)


# The last dimension of an observation holds the channels in their order; dimensions before it are
# steps and copies. The slice 0:1 takes the first channel, the distance in mm, and keeps the
# dimension.
def error_mm(observation: Tensor) -> Tensor:
    """Distance from the target position."""
    return (observation[..., 0:1] - 400.0).abs()


def reward(previous: Tensor, action: Tensor, observation: Tensor) -> Tensor:
    """Higher the nearer to 400 mm. Keep rewards between about -10 and 10 per step."""
    return -error_mm(observation) / 100.0


def success(observations: Tensor) -> Tensor:
    """Whether an episode succeeded, by its last observation."""
    return error_mm(observations[..., -1, :])[..., 0] < 20.0


def metrics(observations: Tensor) -> dict[str, Tensor]:
    """Numbers beside the return that `bricksrl evaluate` shows; the unit is in the name."""
    return {"final_error_mm": error_mm(observations[..., -1, :])[..., 0]}


TASK = Task(
    id="MyTask-v0",
    doc="The 2Wheeler stops 400 mm before a wall.",
    robot=ROBOT,
    interface=INTERFACE,
    max_steps=15,  # then an episode ends
    reward=reward,
    success=success,
    metrics=metrics,
    # of the virtual robot: the wall is somewhere in this range
    scene=Scene(wall_distance_mm=(150.0, 800.0)),
)
