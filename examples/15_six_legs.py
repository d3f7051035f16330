"""Six legs from a building plan learn to walk in 90 seconds, by three numbers: a speed and two
phases (docs/gait.md).

    bricksrl train examples/15_six_legs.py --agent gait --episodes 3
"""

from pathlib import Path

from torch import Tensor

from brickhub.entry import Entry
from bricksrl.envs import Task
from bricksrl.hub.interface import Interface, MotorAngle, Pitch, Roll, RunAngle, Wait
from bricksrl.training import TrainConfig, train
from bricktwin.robots.planned import robot_of_plan

PLACES = ("front", "middle", "back")
LEGS = [f"{side}_{place}" for place in PLACES for side in ("left", "right")]
SIX_LEGS = robot_of_plan(
    Path(__file__).with_suffix(".ldr"),
    "six-legs",
    mirrored=tuple((f"left_{place}", f"right_{place}") for place in PLACES),
)


def forward(observation: Tensor) -> Tensor:
    return observation[..., -1:] / 20.0


WALK = Task(
    id="SixLegs-v0",
    doc="Six legs walk forward: the reward is the distance in units of 20 mm.",
    robot=SIX_LEGS,
    interface=Interface(
        commands=tuple(RunAngle(leg, 0, 100, speed_deg_s=600) for leg in LEGS),
        channels=(*(MotorAngle(leg) for leg in LEGS), Pitch(), Roll()),
        settle=Wait(250),
    ),
    max_steps=100,
    reward=lambda previous, action, observation: forward(observation),
    success=lambda observations: forward(observations)[..., 0].mean(-1) > 0.5,
    metrics=lambda observations: {"mean_step_mm": 20.0 * forward(observations).mean((-2, -1))},
    measured_entries=(Entry("forward", -100.0, 100.0, "mm", limits=(-32767.0, 32767.0)),),
    walks=True,
    symmetric=True,
)

if __name__ == "__main__":
    train(TrainConfig(f"{__file__}:WALK", "gait", episodes=3))
