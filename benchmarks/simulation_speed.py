"""Speed of the batched simulations: environment steps per second through ``EnvBase``, resets of
ended copies included.

    python -m benchmarks simulation_speed

Every batch size runs with the same random actions, on one thread and on all cores; medians over
several runs. The rate per CPU second is independent of other load. Takes about two minutes.
"""

from __future__ import annotations

import os
import statistics
import time
from typing import Any

import torch
from torchrl.envs import EnvBase

import bricksrl
from benchmarks.session import Session

ENVIRONMENTS = ("WalkerSim-v0", "RoboArmSim-v0")
BATCH_SIZES = (1, 1024, 4096, 16_384, 65_536)
RUNS = 5
SECONDS = 0.7


def measure(env: EnvBase, action: torch.Tensor) -> dict[str, float]:
    """Rates over ``SECONDS`` of steps."""
    state, calls = env.reset(), 0
    started_s, started_cpu_s = time.perf_counter(), time.process_time()
    while (wall_s := time.perf_counter() - started_s) < SECONDS:
        state["action"] = action
        _, state = env.step_and_maybe_reset(state)
        calls += 1
    steps = calls * action.shape[0]
    return {
        "steps_per_s": steps / wall_s,
        "steps_per_cpu_s": steps / (time.process_time() - started_cpu_s),
    }


def measure_batch(env_id: str, batch_size: int, threads: int) -> dict[str, Any]:
    """The medians at one batch size."""
    torch.set_num_threads(threads)
    torch.manual_seed(0)
    env = bricksrl.make(env_id, batch_size=batch_size, seed=0)
    action = env.action_spec.rand()
    measure(env, action)  # the first run warms up
    runs = [measure(env, action) for _ in range(RUNS)]
    result: dict[str, Any] = {
        name: round(statistics.median(run[name] for run in runs)) for name in runs[0]
    }
    result["runs"] = [round(run["steps_per_s"]) for run in runs]
    print(f"{env_id} batch {batch_size}, {threads} threads: {result['steps_per_s']:,} steps/s")
    return {"batch_size": batch_size, "threads": threads, **result}


def main(session: Session) -> None:
    """Measure both simulations and write the medians."""
    session.parse()
    threads = sorted({1, os.cpu_count() or 1})
    results = {
        env_id: [measure_batch(env_id, size, count) for count in threads for size in BATCH_SIZES]
        for env_id in ENVIRONMENTS
    }
    best = {
        env_id: max(entry["steps_per_s"] for entry in entries)
        for env_id, entries in results.items()
    }
    session.write({"best_steps_per_s": best, "environments": results})
