"""Your own robot: a Technic hub turns a black disc with a white quarter under a colour sensor, and
learns to find white.

This robot has no MuJoCo model, so it lies on a bench: its motor turns without load, and the scene
says what its sensor reads.
"""

from torch import Tensor

from bricksrl.envs import Task
from bricksrl.hub.interface import Interface, MotorAngle, RunAngle, SensorReading, Wait
from bricksrl.robots import HubKind, Motor, MotorKind, PoweredUpSensor, Robot, SensorKind
from bricksrl.training import TrainConfig, train
from bricksrl.twin.scene import Scene

disc = Motor("disc", "A", kind=MotorKind.TECHNIC_L, gears=(12, 36))
DISC = Robot(
    "disc",
    HubKind.TECHNIC,
    motors=(disc,),
    sensors=(PoweredUpSensor("light", "B", SensorKind.COLOR),),
)


def white(observation: Tensor) -> Tensor:
    return observation[..., 1:2]


FIND_WHITE = Task(
    id="FindWhite-v0",
    doc="A disc turns until the sensor sees white.",
    robot=DISC,
    interface=Interface(
        commands=(RunAngle("disc", -90, 90, speed_deg_s=500),),
        channels=(MotorAngle("disc"), SensorReading("light", "reflection", 0, 100, "%")),
        settle=Wait(200),
    ),
    scene=Scene(
        readings={"light": lambda angles: 90.0 if 135 < angles["disc"] % 360 < 225 else 10.0}
    ),
    max_steps=20,
    reward=lambda previous, action, observation: white(observation) / 100.0,
    success=lambda observations: white(observations)[..., -1, 0] > 50.0,
    metrics=lambda observations: {"mean_reflection_pct": white(observations).mean((-2, -1))},
)

if __name__ == "__main__":
    print(
        [
            round(episode.return_, 1)
            for episode in train(TrainConfig(f"{__file__}:FIND_WHITE", episodes=30)).episodes
        ]
    )
