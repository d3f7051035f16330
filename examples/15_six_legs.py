"""A robot with six legs from its building plan learns to walk in 90 seconds.

Each leg is a bent beam on a motor. The description says which motors mirror which, so that four numbers make a gait: the speed,
and how far the right side, the middle and the back lag behind. No walking is programmed.

bricksrl plan check examples/15_six_legs.ldr
bricksrl train examples/15_six_legs.py --agent gait --episodes 3
bricksrl export runs/SixLegs-v0-gait-seed-0 --format hub --out six_legs.py
"""

from pathlib import Path

from torch import Tensor

from brickhub.entry import Entry
from bricksrl.envs import Task
from bricksrl.hub.interface import Interface, MotorAngle, Pitch, Roll, RunAngle, Wait
from bricksrl.robots import Direction, HubKind, Motor, Robot
from bricksrl.training import TrainConfig, train

PLACES = ("front", "middle", "back")
LEGS = [f"{side}_{place}" for place in PLACES for side in ("left", "right")]
SIX_LEGS = Robot(
    "six-legs",
    HubKind.PRIME,
    motors=tuple(Motor(f"left_{place}", direction=Direction.COUNTERCLOCKWISE) for place in PLACES),
    needs_imu=True,
    plan=str(Path(__file__).with_suffix(".ldr")),
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
    terminated=lambda observation: (observation[..., 6:8].abs() > 60.0).any(-1, keepdim=True),
    success=lambda observations: forward(observations)[..., 0].mean(-1) > 0.5,
    metrics=lambda observations: {"mean_step_mm": 20.0 * forward(observations).mean((-2, -1))},
    measured_entries=(Entry("forward", -100.0, 100.0, "mm", limits=(-32767.0, 32767.0)),),
    walks=True,
    symmetric=True,
)

if __name__ == "__main__":
    print([round(episode.return_, 1) for episode in train(TrainConfig(f"{__file__}:WALK", "gait", episodes=3)).episodes])
