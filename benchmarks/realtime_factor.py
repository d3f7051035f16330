"""How fast the virtual robot is: simulated seconds per CPU second on one core, hub program, link and environment included.

    python benchmarks/realtime_factor.py

Each environment runs with the same random actions several times; the median counts. Needs about a minute.
"""

from __future__ import annotations

import statistics
import time
from typing import TYPE_CHECKING, Any

import torch
from machine import command, write

import bricksrl
from bricksrl.envs import list_envs

if TYPE_CHECKING:
    from bricksrl.envs.env import HubEnv

RUNS = 7
CPU_SECONDS = 2.0


def measure(env: HubEnv) -> dict[str, float]:
    """Step for ``CPU_SECONDS`` of this process's time."""
    assert env.twin is not None
    torch.manual_seed(0)
    state = env.reset()
    steps, started_s, simulated_s = 0, time.process_time(), env.twin.now_s()
    while (cpu_s := time.process_time() - started_s) < CPU_SECONDS:
        state["action"] = env.action_spec.rand()
        _, state = env.step_and_maybe_reset(state)
        steps += 1
    return {"realtime_factor": (env.twin.now_s() - simulated_s) / cpu_s, "steps_per_cpu_s": steps / cpu_s}


def main() -> None:
    """Measure every environment and write the medians."""
    command(__doc__).parse_args()
    torch.set_num_threads(1)
    results: dict[str, Any] = {}
    for env_id in list_envs():
        env = bricksrl.make(env_id, seed=0)
        if getattr(env, "twin", None) is None:  # a simulation without a hub
            continue
        measure(env)  # the first run warms up
        runs = [measure(env) for _ in range(RUNS)]
        env.close()
        results[env_id] = {name: round(statistics.median(run[name] for run in runs), 1) for name in runs[0]}
        results[env_id]["runs"] = [round(run["realtime_factor"], 1) for run in runs]
        print(env_id, results[env_id])
    print(write("realtime_factor", {"environments": results}))


if __name__ == "__main__":
    main()
