"""Speed of the camera task on one core, rendered with OpenGL and by ray casting, and cost of its
replay and its learning.

    python -m benchmarks camera_speed

Random actions; medians over several runs. Takes a minute. MUJOCO_GL selects the OpenGL library.
"""

from __future__ import annotations

import itertools
import os
import statistics
import time
from collections.abc import Callable
from typing import Any
from unittest import mock

import numpy as np
import torch
from tensordict import TensorDict

import bricksrl
from benchmarks.session import Session
from bricksrl.agents import make_learner, preset
from bricksrl.agents.replay.replay_learner import ReplayLearner
from bricksrl.envs.env import HubEnv
from bricksrl.envs.tasks.robo_arm_mixed import GOAL
from bricksrl.envs.vision.camera import CameraView, TwinCamera, Watch
from bricksrl.errors import RenderingUnavailableError

ENV = "RoboArm_mixed-v0"
RUNS, STEPS, REPEATS = 5, 60, 30
REPLAY_STEPS, EPISODE_STEPS = 7500, 30


def steps_per_second(env: HubEnv) -> tuple[float, float]:
    """Steps per second of wall time and of CPU time, resets included."""
    state = env.reset()
    started_s, cpu_s = time.perf_counter(), time.process_time()
    for _ in range(STEPS):
        state["action"] = env.action_spec.rand()
        _, state = env.step_and_maybe_reset(state)
    return STEPS / (time.perf_counter() - started_s), STEPS / (time.process_time() - cpu_s)


def cpu_ms(work: Callable[[], Any], repeats: int = REPEATS) -> float:
    """CPU milliseconds of a call."""
    work()
    started_s = time.process_time()
    for _ in range(repeats):
        work()
    return round((time.process_time() - started_s) / repeats * 1000, 2)


def moving(env: HubEnv) -> Callable[[], None]:
    """Function that moves the arm a little, so that all images differ."""
    assert env.twin is not None
    body, angle = env.twin.body, env.twin.body.model.jnt_qposadr[0]  # type: ignore[attr-defined]

    def move() -> None:
        body.data.qpos[angle] += 0.05  # type: ignore[attr-defined]

    return move


def speed() -> dict[str, Any]:
    """Steps per second, and the cost of rendering a frame and of finding the ball in it."""
    env = bricksrl.make(ENV, seed=0)
    assert isinstance(env, HubEnv)
    steps_per_second(env)  # the first run warms up
    runs = [steps_per_second(env) for _ in range(RUNS)]
    assert env.twin is not None
    view, move = CameraView(goal=GOAL), moving(env)
    camera = TwinCamera(env.twin.body, view)
    watch = Watch(view, np.random.default_rng(0), camera.frame())
    frames = itertools.cycle([(move(), camera.frame())[1] for _ in range(REPEATS)])
    result = {
        "steps_per_s": round(statistics.median(run[0] for run in runs), 1),
        "steps_per_cpu_s": round(statistics.median(run[1] for run in runs), 1),
        "runs": [round(run[0], 1) for run in runs],
        "draw_cpu_ms": cpu_ms(lambda: (move(), camera.frame())),
        "see_cpu_ms": cpu_ms(lambda: watch.see(next(frames))),
    }
    camera.close()
    env.close()
    return result


def unavailable(*_args: Any, **_kwargs: Any) -> None:
    """Replacement for OpenGL's renderer."""
    raise RenderingUnavailableError("omitted to measure without")


def learning(name: str) -> dict[str, float]:
    """Cost of an update and an action of SAC, and the size of a replay buffer of the paper's
    run."""
    env = bricksrl.make(ENV, seed=0)
    learner = make_learner("sac", env, preset(name, "sac", images=True))
    generator = torch.Generator().manual_seed(0)

    def rows(steps: int) -> dict[str, torch.Tensor]:
        image = torch.randint(0, 256, (steps, 64, 64, 3), dtype=torch.uint8, generator=generator)
        return {"observation": torch.rand(steps, 3, generator=generator), "image": image}

    for _ in range(REPLAY_STEPS // EPISODE_STEPS):
        done = torch.zeros(EPISODE_STEPS, 1, dtype=torch.bool)
        after = {
            **rows(EPISODE_STEPS),
            "reward": -torch.ones(EPISODE_STEPS, 1),
            "terminated": done,
            "done": done.clone(),
        }
        after["done"][-1] = True
        frames = {
            **rows(EPISODE_STEPS),
            "action": torch.zeros(EPISODE_STEPS, 3),
            "next": TensorDict(after, [EPISODE_STEPS]),
        }
        learner.remember(TensorDict(frames, [EPISODE_STEPS]))
    before = TensorDict(rows(1), [1])[0]
    assert isinstance(learner, ReplayLearner)
    stored = learner.memory[:]
    return {
        "update_cpu_ms": cpu_ms(lambda: learner.make_updates(1), 20),
        "act_cpu_ms": cpu_ms(lambda: learner.explore(before)),
        "replay_steps": len(learner.memory),
        "replay_megabytes": round(stored.bytes() / 1e6, 1),
    }


def main(session: Session) -> None:
    """Measure and write."""
    session.parse()
    torch.set_num_threads(1)
    torch.manual_seed(0)
    result: dict[str, Any] = {
        "env": ENV,
        "opengl": {**speed(), "drawn_with": os.environ.get("MUJOCO_GL", "")},
    }
    with mock.patch("bricktwin.twin.render.opengl.Renderer", unavailable):
        result["rays"] = speed()
    result["sac"] = {name: learning(name) for name in ("default", "paper")}
    print(result)
    session.write(result)
