"""Length of the physics step: the robots at steps of 2.5 and of 5 ms, from the same seeds.

    python -m benchmarks physics_step

Each controller of ``scripted.py``, and random actions, drive each robot through the same episodes. The result has returns, task
metrics and walk metrics, each with the standard error of its mean. The longer step is good enough if none of them changes. Takes
about two minutes.
"""

from __future__ import annotations

import os
import statistics
import time
from typing import TYPE_CHECKING, Any
from unittest import mock

import mujoco
import torch
from torchrl.envs.utils import step_mdp

import bricksrl
from benchmarks.scripted import CONTROLLERS
from benchmarks.session import Session
from bricktwin.twin import mujoco_body
from bricktwin.twin.models import mjcf

if TYPE_CHECKING:
    from bricksrl.envs.env import HubEnv

STEPS_MS = (2.5, 5.0)
ENVS = ("Walker-v1", "RunAway-v0", "Spinning-v0", "RoboArm-v0")
EPISODES = 6
_BODY_STEP_MS = mjcf.TIMESTEP_S * 1000
_mj_step = mujoco.mj_step


class Stepper:
    """Replacement for ``mj_step`` that advances by the requested time in steps of another length."""

    def __init__(self, step_ms: float) -> None:
        self._step_ms, self._owed_ms, self.cpu_s = step_ms, 0.0, 0.0

    def __call__(self, model: Any, data: Any, nstep: int = 1) -> None:
        self._owed_ms += nstep * _BODY_STEP_MS
        count = int(self._owed_ms // self._step_ms)
        self._owed_ms -= count * self._step_ms
        if count:
            started_s = time.thread_time()
            _mj_step(model, data, count)
            self.cpu_s += time.thread_time() - started_s


def episode(env: HubEnv, controller: Any) -> dict[str, float]:
    """Return and metrics of one episode."""
    state, observations, total = env.reset(), [], 0.0
    while True:
        state["action"] = controller(state)
        state = env.step(state)
        after = state["next"]
        observations.append(after["observation"])
        total += float(after["reward"])
        if bool(after["done"]):
            break
        state = step_mdp(state)
    seen = env.task_observations(torch.stack(observations))
    measures = {"return": total, **{name: float(value) for name, value in env.task.metrics(seen).items()}, **env.walk_metrics()}
    if env.task.success is not None:
        measures["success"] = float(env.task.success(seen))
    return measures


def measure(env_id: str, name: str, step_ms: float) -> dict[str, Any]:
    """Means with standard errors over the episodes of one controller at one step."""
    torch.manual_seed(0)
    stepper = Stepper(step_ms)
    mujoco_body._compiled.cache_clear()
    with mock.patch.object(mujoco, "mj_step", stepper), mock.patch.object(mjcf, "TIMESTEP_S", step_ms / 1000):
        env: HubEnv = bricksrl.make(env_id, seed=0)
        controller = CONTROLLERS[env_id] if name == "scripted" else lambda _state: env.action_spec.rand()
        started_s = time.process_time()
        episodes = [episode(env, controller) for _ in range(EPISODES)]
        cpu_s = time.process_time() - started_s
        assert env.twin is not None
        assert env.twin.body.model.opt.timestep == step_ms / 1000  # type: ignore[attr-defined]
        env.close()
    mujoco_body._compiled.cache_clear()
    columns = {key: [episode_measures[key] for episode_measures in episodes] for key in episodes[0]}
    errors = {key: statistics.stdev(values) / EPISODES**0.5 for key, values in columns.items()}
    means = {key: [round(statistics.fmean(values), 3), round(errors[key], 3)] for key, values in columns.items()}
    return {"means_and_errors": means, "cpu_s": round(cpu_s, 2), "physics_cpu_s": round(stepper.cpu_s, 2)}


def main(session: Session) -> None:
    """Measure all and write the results."""
    session.parse()
    torch.set_num_threads(1)
    os.environ["XDG_CACHE_HOME"] = os.devnull  # models of another step are for nobody else
    results: dict[str, Any] = {}
    for env_id in ENVS:
        for name in ("scripted", "random"):
            results_by_step = {f"{step_ms:g}": measure(env_id, name, step_ms) for step_ms in STEPS_MS}
            results.setdefault(env_id, {})[name] = results_by_step
            for step, result in results_by_step.items():
                print(env_id, name, step, "ms:", result, flush=True)
    session.write({"episodes": EPISODES, "steps_ms": STEPS_MS, "environments": results})
