"""A robot from its building plan: a car with a driven and steered front axle learns to drive in a
circle.

Ports, motors, wheels, masses and the twin are read from the LDraw file next to this one.

bricksrl plan check examples/13_front_steered.ldr
bricksrl plan steps examples/13_front_steered.ldr --out front_steered.pdf
bricksrl train examples/13_front_steered.py --episodes 30
"""

from pathlib import Path

from torch import Tensor

from bricksrl.envs import Task
from bricksrl.hub.interface import Interface, MotorAngle, RunAngle, Wait, YawRate
from bricksrl.robots import Motor
from bricksrl.training import TrainConfig, train
from bricktwin.robots.planned import robot_of_plan

steering = Motor("steering", range_deg=(-40, 40))
CAR = robot_of_plan(Path(__file__).with_suffix(".ldr"), "front-steered", motors=[steering])


def turning(observation: Tensor) -> Tensor:
    return observation[..., 1:2] / 60.0


CIRCLE = Task(
    id="Circle-v0",
    doc="A front-steered car goes round to the left, as fast as it can.",
    robot=CAR,
    interface=Interface(
        commands=(
            RunAngle("steering", -20, 20, speed_deg_s=300),
            RunAngle("drive", 0, 120, speed_deg_s=500),
        ),
        channels=(MotorAngle("steering", -45, 45), YawRate()),
        settle=Wait(250),
    ),
    max_steps=30,
    reward=lambda previous, action, observation: turning(observation),
    success=lambda observations: turning(observations)[..., -5:, 0].mean(-1) > 0.6,
    metrics=lambda observations: {"mean_yaw_deg_s": 60.0 * turning(observations).mean((-2, -1))},
)

if __name__ == "__main__":
    print(
        [
            round(episode.return_, 1)
            for episode in train(TrainConfig(f"{__file__}:CIRCLE", episodes=30)).episodes
        ]
    )
