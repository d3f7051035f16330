"""How fast the camera task is: steps a second with the picture drawn, searched and made small, on one core.

    python benchmarks/camera_speed.py

Random actions, several runs; the median counts. Needs half a minute. MUJOCO_GL chooses what draws.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable
from typing import Any

import torch
from machine import write

import bricksrl
from bricksrl.envs.camera import CameraView, TwinCamera, find_red, shrink
from bricksrl.envs.env import HubEnv
from bricksrl.envs.tasks.robo_arm_mixed import GOAL

ENV = "RoboArm_mixed-v0"
RUNS, STEPS, REPEATS = 5, 60, 30
REPLAY_STEPS = 7500


def steps_per_second(env: HubEnv) -> tuple[float, float]:
    """Of a wall clock, and of this process's time; resets included."""
    state = env.reset()
    started_s, cpu_s = time.perf_counter(), time.process_time()
    for _ in range(STEPS):
        state["action"] = env.action_spec.rand()
        _, state = env.step_and_maybe_reset(state)
    return STEPS / (time.perf_counter() - started_s), STEPS / (time.process_time() - cpu_s)


def cpu_ms(work: Callable[[], Any]) -> float:
    """Milliseconds of this process's time that it takes."""
    work()
    started_s = time.process_time()
    for _ in range(REPEATS):
        work()
    return (time.process_time() - started_s) / REPEATS * 1000


def parts(env: HubEnv) -> dict[str, float]:
    """What a frame costs."""
    assert env.twin is not None
    camera = TwinCamera(env.twin.body, CameraView())
    frame = camera.frame()
    goal = GOAL.places[0]
    work: dict[str, Callable[[], Any]] = {
        "draw_cpu_ms": camera.frame,
        "find_red_cpu_ms": lambda: find_red(frame, GOAL.red),
        "goal_and_image_cpu_ms": lambda: shrink(frame, 64, (goal, GOAL.radius_px)),
    }
    costs = {name: round(cpu_ms(one), 2) for name, one in work.items()}
    camera.close()
    return costs


def main() -> None:
    """Measure and write."""
    torch.set_num_threads(1)
    torch.manual_seed(0)
    env = bricksrl.make(ENV, seed=0)
    assert isinstance(env, HubEnv)
    steps_per_second(env)  # the first run warms up
    runs = [steps_per_second(env) for _ in range(RUNS)]
    wall, cpu = (statistics.median(run[i] for run in runs) for i in range(2))
    step = env.rollout(1)[0]
    held = sum(step[key].numel() * step[key].element_size() for key in ("image", ("next", "image")))
    result = {
        "env": ENV,
        "drawn_with": os.environ.get("MUJOCO_GL", ""),
        "steps_per_s": round(wall, 1),
        "steps_per_cpu_s": round(cpu, 1),
        "runs": [round(run[0], 1) for run in runs],
        **parts(env),
        "images_of_replay": {"steps": REPLAY_STEPS, "megabytes": round(held * REPLAY_STEPS / 1e6, 1)},
    }
    env.close()
    print(result)
    print(write("camera_speed", result))


if __name__ == "__main__":
    main()
