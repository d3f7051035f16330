"""Batched simulation: thousands of robot arms at once, without a hub, on any device."""

import time

import torch
from tensordict import TensorDictBase

import bricksrl

REACH_DEG = torch.tensor([100.0, 30.0, 60.0, 25.0])


def straight_to_the_goal(state: TensorDictBase) -> TensorDictBase:
    angles, goals = state["observation"].chunk(2, dim=-1)
    error_deg = (goals - angles + 180.0) % 360.0 - 180.0
    return state.set("action", (error_deg / REACH_DEG).clamp(-1.0, 1.0))


def main(batch_size: int = 4096, steps: int = 100) -> None:
    env = bricksrl.make("RoboArmSim-v0", batch_size=batch_size, device="cpu", seed=0)
    state = env.reset()
    arrivals, started_s = 0, time.perf_counter()
    for _ in range(steps):
        # arms at their goal get a new one
        outcome, state = env.step_and_maybe_reset(straight_to_the_goal(state))
        arrivals += int(outcome["next", "terminated"].sum())
    seconds = time.perf_counter() - started_s
    print(
        f"{batch_size * steps / seconds:,.0f} steps a second, {batch_size * steps / arrivals:.2f} "
        "steps to a goal"
    )


if __name__ == "__main__":
    main()
