"""First run: the 2Wheeler drives away from a wall. With `hub="ble"`, the same lines move a real
robot."""

import torch
from tensordict import TensorDictBase

import bricksrl


def back_off(state: TensorDictBase) -> TensorDictBase:
    """Drive backwards, away from the wall in front of the robot, as far as a step allows."""
    return state.set("action", torch.tensor([-1.0]))


def main() -> None:
    env = bricksrl.make("RunAway-v0", seed=0)
    names = [entry.name for entry in env.task.entries]

    episode = env.rollout(20, policy=back_off)

    distances_mm = episode["next", "observation"][:, names.index("distance")]
    print("observed:", ", ".join(names))
    print("distance in mm:", distances_mm.int().tolist())
    print("return:", episode["next", "reward"].sum().item())
    print("random actions:", env.rollout(20)["next", "reward"].sum().item())
    env.close()


if __name__ == "__main__":
    main()
