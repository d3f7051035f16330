"""Your own task: the 2Wheeler stops 400 mm from a wall.

bricksrl check examples/03_own_task.py
bricksrl train examples/03_own_task.py --episodes 30
"""

from torch import Tensor

from bricksrl.envs import Task
from bricksrl.hub.interface import Distance, DriveStraight, Interface, UntilDone
from bricksrl.robots import TWO_WHEELER
from bricksrl.training import TrainConfig, train
from bricksrl.twin.scene import Scene


def error_mm(observation: Tensor) -> Tensor:
    return (observation[..., :1] - 400.0).abs()


PARK = Task(
    id="StopAtWall-v0",
    doc="The 2Wheeler stops at 400 mm from a wall.",
    robot=TWO_WHEELER,
    interface=Interface(
        commands=(DriveStraight(-100, 100),), channels=(Distance("eyes"),), settle=UntilDone()
    ),
    scene=Scene(wall_distance_mm=(150.0, 800.0)),
    max_steps=15,
    reward=lambda previous, action, observation: -error_mm(observation) / 100.0,
    success=lambda observations: error_mm(observations[..., -1, :])[..., 0] < 20.0,
    metrics=lambda observations: {"final_error_mm": error_mm(observations[..., -1, :])[..., 0]},
)


def main(episodes: int = 30) -> None:
    run = train(TrainConfig(f"{__file__}:PARK", episodes=episodes))
    print("returns:", [round(episode.return_, 1) for episode in run.episodes])


if __name__ == "__main__":
    main()
